"""A remote client on its first visit: take the lease, arm, follow a rectangle, switch off."""

import asyncio
import sys
from pathlib import Path
from typing import Final

from daemon.remote.address import LocalAddress
from daemon.remote.client import RobotClient
from daemon.remote.messages import Status
from safety.states import OperatingState

_DAEMON_WITHIN_S: Final = 20.0
_READY_WITHIN_S: Final = 30.0
_LOOK_EVERY_S: Final = 0.25
_LINE_EVERY_S: Final = 5.0
_ENERGISED: Final = {state.value for state in OperatingState if state.energised}
_READY: Final = OperatingState.READY.value
_RUNNING: Final = OperatingState.RUNNING.value
_HOLD: Final = OperatingState.HOLD.value


class TourError(RuntimeError):
    """The robot does not go on; the text says why."""


class Tour:
    """Once round the rectangle of 25 × 100 mm."""

    def __init__(self, directory: Path, cycle_s: float) -> None:
        self._directory = directory
        self._cycle_s = cycle_s
        self._on_terminal = sys.stdout.isatty()
        self._told_at_s = -_LINE_EVERY_S

    async def run(self) -> str:
        """Returns the folder of the recording. Raises TourError, ClientError."""
        address = LocalAddress.in_folder(self._directory)
        async with await RobotClient.connect(address, wait_s=_DAEMON_WITHIN_S) as robot:
            await self._until_ready(robot)
            await robot.acquire()
            await robot.arm()
            recording = (await robot.status()).recording
            await robot.load(_rectangle(self._cycle_s), {"kind": "broyden"})
            await robot.start()
            await self._follow(robot)
            await robot.disarm()
            await robot.release()
        if recording is None:
            raise TourError("nothing was recorded")
        return recording

    async def _until_ready(self, robot: RobotClient) -> None:
        status = await robot.status()
        try:
            async with asyncio.timeout(_READY_WITHIN_S):
                while status.state != _READY:
                    await asyncio.sleep(_LOOK_EVERY_S)
                    status = await robot.status()
                    self._show(status)
        except TimeoutError:
            raise TourError(f"the robot does not get ready:\n{_reasons(status)}") from None

    async def _follow(self, robot: RobotClient) -> None:
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            status = await robot.status()
            self._show(status)
            if status.state not in _ENERGISED:
                raise TourError(f"the robot is {status.state}:\n{_reasons(status)}")
            if status.state == _RUNNING or status.reference is None:
                continue
            duration_s = status.reference.duration_s or 0.0
            if status.reference.elapsed_s >= duration_s:
                self._show(status, last=True)
                return
            if status.state != _HOLD:
                await robot.resume()

    def _show(self, status: Status, *, last: bool = False) -> None:
        """One line that is written over on a terminal; one now and then elsewhere."""
        line = _line(status)
        if self._on_terminal:
            print(f"\r{line:<110}", end="\n" if last else "", flush=True)
            return
        now_s = status.t_ns * 1e-9
        if last or now_s - self._told_at_s >= _LINE_EVERY_S:
            self._told_at_s = now_s
            print(line, flush=True)


def _rectangle(cycle_s: float) -> dict[str, object]:
    return {
        "kind": "rectangle",
        "center_mm": [0.0, 0.0, 185.0],
        "plane": "xy",
        "width_mm": 25.0,
        "height_mm": 100.0,
        "cycle_s": cycle_s,
    }


def _line(status: Status) -> str:
    words = [f"{status.state:<8}"]
    reference = status.reference
    if reference is not None and reference.duration_s and status.state in _ENERGISED:
        if reference.note:
            words.append(reference.note)
        elif reference.cycle < 0:
            words.append("goes to the start")
        else:
            words.append(f"{reference.elapsed_s:5.1f} of {reference.duration_s:.0f} s")
        if status.error_mm is not None:
            words.append(f"error {status.error_mm:5.2f} mm")
    if status.tip_mm is not None:
        words.append("tip ({:6.1f},{:6.1f},{:6.1f}) mm".format(*status.tip_mm))
    words.append(f"{status.loop.rate_hz:4.1f} Hz")
    return "  ".join(words)


def _reasons(status: Status) -> str:
    return "\n".join(
        f"  {reason.subject}: {reason.text} {reason.detail}; {reason.remedy}"
        for reason in status.reasons
    )
