"""A remote client on its first visit: arm, follow a rectangle, feel a load, switch off."""

import asyncio
import math
import shutil
import sys
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Final

from daemon.messages import Status
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import RefusedError
from daemon.remote.reason_groups import reason_lines
from daemon.robot.lab_connections import LabRefusedError, LabUnreachableError, ask
from safety.states import OperatingState

_DAEMON_WITHIN_S: Final = 20.0
_READY_WITHIN_S: Final = 30.0
_LOOK_EVERY_S: Final = 0.25
_LINE_EVERY_S: Final = 5.0
_CLOSELY_S: Final = 4.0
"""After the load was hung on every look is shown: the error jumps and falls."""
_LOAD_G: Final = 14.2
"""Of Ho 2018. Hung on half-way: the controller has never felt it."""
_ENERGISED: Final = {state.value for state in OperatingState if state.energised}
_READY: Final = OperatingState.READY.value
_ARMED: Final = OperatingState.ARMED.value
_RUNNING: Final = OperatingState.RUNNING.value
_HOLD: Final = OperatingState.HOLD.value


class TourError(RuntimeError):
    """The robot does not go on; the text says why."""


class Tour:
    """Once round the rectangle of 25 × 100 mm, learning on the way."""

    def __init__(self, directory: Path, cycle_s: float, controller: Mapping[str, object]) -> None:
        """controller: as an experiment file would name it."""
        self._directory = directory
        self._cycle_s = cycle_s
        self._controller = dict(controller)
        self._loaded_at_s = -math.inf
        self._on_terminal = sys.stdout.isatty()
        self._printed_at_s = -_LINE_EVERY_S

    async def run(self) -> str:
        """Returns the folder of the recording. Raises TourError, ClientError."""
        address = LocalAddress.in_folder(self._directory)
        async with await RobotClient.connect(address, wait_s=_DAEMON_WITHIN_S) as robot:
            await robot.acquire()
            await robot.load(_rectangle(self._cycle_s), self._controller)
            await self._arm(robot)
            recording = (await robot.status()).recording
            await robot.start()
            await self._follow(robot)
            await robot.disarm()
            await robot.release()
        if recording is None:
            raise TourError("nothing was recorded")
        return recording

    async def _arm(self, robot: RobotClient) -> None:
        """As soon as everything is ready, which on a busy machine may come and go."""
        status = await robot.status()
        try:
            async with asyncio.timeout(_READY_WITHIN_S):
                while status.state != _ARMED:
                    if status.state == _READY:
                        with suppress(RefusedError):
                            await robot.arm()
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
            if status.reference is None:
                continue
            elapsed_s, duration_s = status.reference.elapsed_s, status.reference.duration_s or 0.0
            if elapsed_s >= 0.5 * duration_s and self._loaded_at_s < 0.0:
                self._loaded_at_s = status.t_ns * 1e-9
                await self._hang_on()
            if status.state == _RUNNING:
                continue
            if elapsed_s >= duration_s:
                self._show(status, last=True)
                return
            if status.state != _HOLD:
                with suppress(RefusedError):  # it may be held anew meanwhile: then once more
                    await robot.resume()

    async def _hang_on(self) -> None:
        """As a hand would: the controller is not told."""
        request = {"do": "load", "tip_load_g": _LOAD_G}
        try:
            await asyncio.to_thread(ask, self._directory, request)
        except (LabRefusedError, LabUnreachableError) as error:
            raise TourError(f"nothing can be hung on the tip: {error}") from None
        line_end = "\n" if self._on_terminal else ""
        print(f"{line_end}{_LOAD_G:g} g hang on the tip now", flush=True)

    def _show(self, status: Status, *, last: bool = False) -> None:
        """One line that is written over on a terminal; one now and then elsewhere."""
        line = _line(status)
        if self._on_terminal:
            columns = shutil.get_terminal_size().columns - 1
            print(f"\r\x1b[K{line[:columns]}", end="\n" if last else "", flush=True)
            return
        now_s = status.t_ns * 1e-9
        closely = now_s - self._loaded_at_s < _CLOSELY_S
        if last or closely or now_s - self._printed_at_s >= _LINE_EVERY_S:
            self._printed_at_s = now_s
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
        elif reference.cycle < 0 and reference.elapsed_s <= 0.0:
            words.append("goes to the start")
        else:
            words.append(f"{reference.elapsed_s:5.1f} of {reference.duration_s:.0f} s")
            if reference.pace < 1.0:
                words.append(f"slowed to {reference.pace:.0%}")
        if status.error_mm is not None:
            words.append(f"error {status.error_mm:5.2f} mm")
    if status.tip_mm is not None:
        words.append("tip ({:6.1f},{:6.1f},{:6.1f}) mm".format(*status.tip_mm))
    words.append(f"{status.loop.rate_hz:.0f} Hz")
    return "  ".join(words)


def _reasons(status: Status) -> str:
    return "\n".join(reason_lines(status.reasons))
