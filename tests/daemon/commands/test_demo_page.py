"""The page beside the tour: its address comes first, and nothing of it can fail the tour."""

import re
import socket
import sys
import urllib.error
import urllib.request
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

from daemon.commands.host.dashboard import _PORT, _listening
from daemon.commands.host.demo import _page


def test_the_address_is_told_and_leads_to_a_page_that_ends_with_the_tour(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with ExitStack() as held:
        with suppress(OSError):  # where somebody else has it, that is as good
            held.enter_context(socket.create_server(("127.0.0.1", _PORT)))
        held.enter_context(_page(tmp_path, tmp_path))
        said = capfd.readouterr().out
        found = re.search(r"http://localhost:(\d+)/\?token=\S+", said)
        assert found is not None, said
        assert int(found[1]) != _PORT, "somebody has that port: another is taken"
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        with opener.open(found[0]) as answer:
            assert b"STOP" in answer.read()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(found[0], timeout=2.0)


def test_the_tour_goes_on_without_a_page(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\nexit 1\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    with _page(tmp_path, tmp_path):
        assert "goes on without" in capfd.readouterr().err


def test_a_port_that_was_asked_for_is_not_exchanged_for_another() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(OSError, match="in use"):
            _listening("127.0.0.1", port)
