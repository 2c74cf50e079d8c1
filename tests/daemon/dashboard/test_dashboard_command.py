"""`tentacled dashboard`: to whom it is open by default, and what it says where that are more."""

import asyncio
import json
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.error import HTTPError

import pytest

from daemon.commands.host import dashboard
from daemon.commands.terminal.command_line import parsed
from daemon.commands.terminal.remote_arguments import network_warnings
from daemon.dashboard.recorded_runs import RecordedRuns
from daemon.dashboard.robot_link import RobotLink
from daemon.host.clock import run_in_real_time
from daemon.remote.discovery import DAEMON_FILE
from tests.daemon.remote.conftest import tmp_path as tmp_path
from tests.daemon.remote.rig import ROBOT, serving, until
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


def test_a_page_that_others_reach_is_warned_of_with_its_port() -> None:
    (told,) = network_warnings("0.0.0.0", 8421)
    assert "8421 is open to the network" in told
    assert network_warnings(parsed(["dashboard"]).bind, 8421) == []


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


def test_a_daemon_that_comes_back_in_another_folder_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Server:
        def __init__(self) -> None:
            self.links: dict[str, RobotLink] = {}
            self.stopped_in: list[Path] = []

        def serve(self, link: RobotLink) -> None:
            self.links[link.name] = link
            self.stopped_in.append(link.folder)

    folders = [tmp_path / "a", tmp_path / "b"]
    monkeypatch.setattr(dashboard, "running_daemons", lambda _: folders)
    monkeypatch.setattr(dashboard, "_LOOKS_EACH_S", 0.05)

    async def test() -> None:
        server = Server()
        runs = RecordedRuns()
        finding = asyncio.create_task(
            dashboard._find(server, runs, parsed(["dashboard"]))  # type: ignore[arg-type]
        )
        for folder in folders:
            folder.mkdir()
            async with serving(folder):
                await until(lambda: server.links and server.links[ROBOT].status)
            await until(lambda: server.links[ROBOT].status is None)
        assert server.stopped_in == folders, "STOP goes where it is"
        finding.cancel()
        await asyncio.gather(finding, return_exceptions=True)

    run_in_real_time(test())


def test_a_robot_that_is_named_and_does_not_run_is_told(tmp_path: Path) -> None:
    about = {"robot": "soft_arm", "pid": 1, "version": "0", "simulated": True}
    about |= {"unix_socket": "zenoh.sock", "tls": None, "stop_socket": "stop.sock"}
    (tmp_path / DAEMON_FILE).write_text(json.dumps(about))
    said = dashboard.absent(["soft_arm", "soft_am"], [tmp_path])
    hint = "(did you mean 'soft_arm'?)"
    assert said == [f"no daemon runs soft_am here {hint}: the page shows it when one does"]
