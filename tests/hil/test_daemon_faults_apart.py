"""Causes that need a daemon of their own: another robot file, or what it does not outlive."""

import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest
import yaml

from daemon.recording.run_folder import free_mb
from daemon.recording.run_reader import RunReader
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import box, turned
from tests.hil.daemon_rig import (
    AS_SHIPPED,
    CIRCLE,
    MODEL,
    PATIENT,
    Rig,
    farthest,
    rig,
    robot_file,
    short_folder,
)
from tests.hil.test_daemon_faults import (
    STANDS_WITHIN_MM,
    TIMES,
    S,
    assert_told,
    frozen,
    goes_on,
    holds,
)

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("daemon_faults")]

COMING_ON: Final = {"ready to switch on", "switched on", "operation enabled"}
ATTEMPTS: Final = 5
SPARE_MB: Final = 300.0


def test_a_loop_that_is_late_holds_and_goes_on_when_resumed() -> None:
    """With times as shipped: a busy machine may make more of it, so there are a few attempts."""
    with rig(AS_SHIPPED) as one:
        for _ in range(ATTEMPTS):
            one.running()
            frozen(0.12)(one)
            assert_told(one, "loop_late")
            one.until_it_was(S.HOLD, S.FAULT)
            if not one.events("state", S.FAULT.value):
                holds(one)
                one.resumed()
                return
    pytest.fail("it always came to a fault")


@pytest.mark.parametrize(
    ("name", "settings", "detail"),
    [
        ("risk_too_high", {"threshold": 0.0}, "clearance"),
        ("risk_unavailable", {"latest_after_s": 1e-6}, "late"),
    ],
)
def test_a_step_whose_risk_may_not_be_taken_holds_as_often_as_it_is_asked_for(
    name: str, settings: dict[str, float], detail: str
) -> None:
    """With the shipped model of the arm, in a room: no risk at all, or no time to tell it."""
    with rig_in_a_room(settings) as one:
        one.armed(despite_contact=True)  # standing still has a risk as well
        assert "soft_arm.npz" in one.status().risk.source
        before = one.actuators()
        one.user.do(one.client.load(CIRCLE, MODEL))
        one.from_now_on()
        one.user.do(one.client.start())
        for _ in range(2):
            assert_told(one, name)
            holds(one)
            assert any(detail in reason.detail for reason in one.status().reasons)
            assert farthest(before, one.actuators()) < STANDS_WITHIN_MM
            one.from_now_on()
            one.resumed()
        one.until_told(name)


@contextmanager
def rig_in_a_room(risk: dict[str, float]) -> Iterator[Rig]:
    """The shipped arm, asked for its risk before every step."""
    with short_folder() as folder:
        path = robot_file(folder, PATIENT, **TIMES)
        write_mesh(folder / "room.stl", turned(box((220.0, 220.0, 280.0), (0.0, 0.0, 110.0), 1)))
        robot = yaml.safe_load(path.read_text())
        surface = {"mesh": "room.stl", "free": "inside", "grid_mm": 3.0}
        robot["risk"] = {"model": "builtin:soft_arm.npz", "surface": surface, **risk}
        path.write_text(yaml.safe_dump(robot))
        one = Rig(folder, path)
        try:
            yield one
        finally:
            one.leave()


def test_drives_that_come_on_when_something_went_missing_meanwhile_go_off_again() -> None:
    """A cause that lets an energised robot go on is still one that forbids arming."""
    with rig(PATIENT, TIMES | {"arm_within_s": 10.0}) as one:
        one.ready()
        one.inject("drive.can0/4.refuses_enable=2s")
        with ThreadPoolExecutor(1) as beside:
            arming = beside.submit(one.user.refused, one.client.arm())
            one.until(lambda: bool(one.drive_states() & COMING_ON))
            while not arming.done():  # it is started again, and would be there in time
                if (recorder := one.daemon.recorder_pid()) is not None:
                    os.kill(recorder, signal.SIGKILL)
                time.sleep(0.01)
            refusal = arming.result()
        assert {reason.name for reason in refusal.reasons} <= {"recorder_failed", "not_recorded"}
        one.until_without_torque()
        assert one.state in (S.STANDBY, S.READY)


def test_a_recorder_that_dies_is_started_again_and_the_robot_goes_on() -> None:
    with rig(PATIENT, TIMES) as one:
        one.running()
        folder = Path(one.status().recording or "")
        recorder = one.daemon.recorder_pid()
        assert recorder is not None
        os.kill(recorder, signal.SIGKILL)
        assert_told(one, "recorder_failed")
        goes_on(one)
        one.until(lambda: (folder / "run-2.mcap.part").exists())
        one.until(lambda: "recorder_failed" not in one.causes())
        one.user.do(one.client.stop())
        one.until_without_torque()
        one.armed()
        told = RunReader(folder / "run-2.mcap").messages(["/event"])
        assert any(b"recording_gap" in event.data for event in told)


def test_a_disk_without_room_stops_nobody_but_forbids_the_next_arming() -> None:
    """Of what is free just now, nearly all is declared to be needed."""
    with short_folder() as folder:
        free = free_mb(folder)
    assert free is not None
    with rig(PATIENT, TIMES | {"disk_free_mb": round(free - SPARE_MB, 1)}) as one:
        one.running()
        with filled(one.folder / "runs", 2 * SPARE_MB):
            assert_told(one, "disk_low")
            goes_on(one)
            one.user.do(one.client.stop())
            one.until_state(S.STANDBY)
            one.user.do(one.client.acquire())
            refusal = one.user.refused(one.client.arm())
            assert [reason.name for reason in refusal.reasons] == ["disk_low"]
        one.until_state(S.READY)
        one.armed()


@contextmanager
def filled(folder: Path, mb: float) -> Iterator[None]:
    """So much less room on the disk."""
    path = folder / "ballast"
    with path.open("wb") as file:
        os.posix_fallocate(file.fileno(), 0, int(mb * 1e6))
    try:
        yield
    finally:
        path.unlink()
