"""Errors of our own are kept with their tracebacks: in the recording, and for stderr."""

import asyncio
import io
import logging
from pathlib import Path
from typing import NoReturn

import msgspec
import pytest

from daemon.host.logs import logging_to_stderr
from daemon.messages import InternalError
from daemon.recording.format.channels import TOPICS
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from daemon.service.motion_loader import in_a_thread
from daemon.service.operation.internal_errors import InternalErrors
from drivers.clock import Clock
from safety.states import OperatingState
from tests.daemon.service.rig import Rig, on_a_rig


def a_formula_that_breaks(*_: object) -> NoReturn:
    raise ZeroDivisionError("a formula of ours")


def recorded(folder: Path) -> list[InternalError]:
    run = RunReader(folder / RUN_FILE)
    return [
        msgspec.json.decode(one.data, type=InternalError)
        for one in run.messages([TOPICS[InternalError]])
    ]


def test_an_error_in_the_control_step_is_a_fault_with_its_traceback_recorded_and_on_stderr(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        monkeypatch.setattr(rig.service.loop, "_decide", a_formula_that_breaks)
        await rig.until_state(OperatingState.FAULT, within_s=1.0)
        assert "internal_error" in rig.causes
        await asyncio.sleep(5.0)  # it goes on failing with each frame

    out = io.StringIO()
    with logging_to_stderr("experiment", out):
        on_a_rig(scene, folder=tmp_path)
    errors = recorded(tmp_path)
    assert len(errors) == 1, "one and the same is kept once in ten seconds"
    assert errors[0].place.startswith("daemon.service.robot_service:")
    assert errors[0].text == "control step"
    for text in (errors[0].traceback, out.getvalue()):
        assert "in a_formula_that_breaks" in text
        assert "ZeroDivisionError: a formula of ours" in text
    assert out.getvalue().count("ZeroDivisionError: a formula of ours") == 1


def test_two_runs_record_the_same_of_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        monkeypatch.setattr(rig.service.loop, "_decide", a_formula_that_breaks)
        await rig.until_state(OperatingState.FAULT, within_s=1.0)

    found = []
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        on_a_rig(scene, folder=tmp_path / name)
        found.append(recorded(tmp_path / name))
    assert found[0] == found[1] != []


class _Now(Clock):
    def now_ns(self) -> int:
        return 7


def test_an_error_of_another_thread_is_published_on_the_loop() -> None:
    published: list[object] = []

    async def scene() -> None:
        errors = InternalErrors(_Now(), published.append, in_a_thread)
        errors.open()
        log = logging.getLogger("of.a.thread")
        await asyncio.to_thread(log.error, "from elsewhere: %d", 3)
        await asyncio.sleep(0)
        await errors.end()
        log.error("after the end")

    asyncio.run(scene())
    (error,) = published
    assert isinstance(error, InternalError)
    assert (error.text, error.traceback, error.t_ns) == ("from elsewhere: 3", "", 7)
