"""`tentacled dashboard`: to whom it is open by default, and what it says where that are more."""

import urllib.request
from collections.abc import Iterator
from urllib.error import HTTPError

import pytest

from daemon.commands.host import dashboard
from daemon.commands.terminal.command_line import parsed
from tests.hil.processes import Process, command


@pytest.fixture
def open_to_all() -> Iterator[str]:
    server = Process(command("dashboard", "nobody", "--port", "0", "--no-token"))
    try:
        yield server.next_line()[1]
    finally:
        server.leave()


def status(address: str) -> int:
    try:
        with urllib.request.urlopen(address) as answer:
            return int(answer.status)
    except HTTPError as error:
        return error.code


def test_nobody_but_this_machine_reaches_it_unless_it_is_told_so() -> None:
    bound = parsed(["dashboard"]).bind
    assert bound == "127.0.0.1"
    listening, _ = dashboard._listening(bound, 0)
    with listening:
        assert listening.getsockname()[0] == "127.0.0.1"


def test_a_page_that_others_reach_is_warned_of_with_its_port(
    capsys: pytest.CaptureFixture[str],
) -> None:
    dashboard._tell(parsed(["dashboard", "--bind", "0.0.0.0"]), 8421, {})
    assert "8421 is open to the network" in capsys.readouterr().err
    dashboard._tell(parsed(["dashboard"]), 8421, {})
    assert capsys.readouterr().err == ""


def test_authentication_is_left_to_a_proxy_only_where_that_is_asked_for(open_to_all: str) -> None:
    assert "token" not in open_to_all and "whoever reaches it commands" in open_to_all
    assert status(open_to_all.split()[0]) == 200
    server = Process(command("dashboard", "nobody", "--port", "0"))
    try:
        line = server.next_line()[1]
        assert line.startswith("operator: ") and "?token=" in line
        assert status(line.split()[1].partition("?")[0]) == 401
        assert server.next_line()[1].startswith("viewer: ")
    finally:
        server.leave()
