"""How a drive finds its zero: mode 6, a start bit, and what it says on the way (CiA 402-2, 8)."""

import asyncio
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from typing import Final

from config.axis import Axis
from drivers.canopen.codec.error import CodecError
from drivers.canopen.object_dictionary import EdsError, ObjectDictionary
from drivers.canopen.sdo_client import SdoClient, SdoError
from drivers.cia402 import objects
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.power_state import PowerGoal, PowerState, StatuswordBit
from safety.permit import PermittedHoming

# Judgements, held generous: a drive that is slower is named, and is not homed.
_POLL_S: Final = 0.02  # by SDO, a few frames each time
_MODE_WITHIN_S: Final = 1.0  # a drive changes its mode within a few of its own cycles
_STARTED_WITHIN_S: Final = 0.1  # ten cycles of the slowest bus
_ENABLED_WITHIN_S: Final = 3.0  # longer than the two seconds after which a drive is unwilling
_AT_REST_WITHIN_S: Final = 2.0  # a homing search is slow, and its ramp ends long before


class HomingError(RuntimeError):
    """The axis has no zero; the text says how far it came."""


class ModeLeftError(HomingError):
    """The axis could not be brought back into its own mode."""


class HomingProgress(Enum):
    """Bits 13, 12 and 10 of the statusword in homing mode."""

    IN_PROGRESS = "in progress"
    NOT_STARTED = "interrupted or not started"
    ATTAINED = "attained, still moving"
    DONE = "done"
    ERROR = "error"


def homing_progress(statusword: int) -> HomingProgress:
    """How far homing is."""
    if statusword & StatuswordBit.HOMING_ERROR:
        return HomingProgress.ERROR
    reached = bool(statusword & StatuswordBit.TARGET_REACHED)
    if statusword & StatuswordBit.HOMING_ATTAINED:
        return HomingProgress.DONE if reached else HomingProgress.ATTAINED
    return HomingProgress.NOT_STARTED if reached else HomingProgress.IN_PROGRESS


class HomingProcedure:
    """One axis looks for its zero. The bus cycle must go on meanwhile.

    It gives up as soon as the axis is told something else than to be enabled, and as soon as it
    leaves that state by itself.
    """

    def __init__(
        self,
        channel: AxisChannel,
        dictionary: ObjectDictionary,
        sdo: SdoClient,
        permitted: PermittedHoming,
    ) -> None:
        self._channel = channel
        self._axis = channel.axis
        self._dictionary = dictionary
        self._sdo = sdo
        self._permitted = permitted

    async def run(self) -> None:
        """Home the axis; afterwards it is off, and in its own mode again. Raises HomingError, and
        ModeLeftError where it stays in homing mode.
        """
        channel = self._channel
        channel.zero_found = False
        try:
            async with asyncio.timeout(self._axis.homing.timeout_s):
                await self._set_up()
                await self._enable()
                await self._seek()
            channel.zero_found, channel.zero_lost = True, False
        except TimeoutError as error:  # with words where a part of it took too long
            progress = homing_progress(channel.statusword).value
            whole = f"not within {self._axis.homing.timeout_s:g} s: {progress}"
            raise HomingError(f"{self._axis.name}: {str(error) or whole}") from None
        except (SdoError, EdsError, CodecError) as error:
            raise HomingError(f"{self._axis.name}: {error}") from error
        finally:
            await self._come_to_rest()

    async def _come_to_rest(self) -> None:
        """Stop, where it still moves; power off; back to its own mode."""
        channel = self._channel
        channel.start_homing = False
        if channel.goal is PowerGoal.ENABLED:
            if not channel.zero_found:
                self._goal(PowerGoal.QUICK_STOP)
                await self._wait(lambda: channel.goal_reached)
            self._goal(PowerGoal.OFF)
        await self._wait(lambda: not channel.state.energised)
        channel.homing = False
        try:
            await self._change_mode(objects.MODES[self._axis.drive.mode].number)
        except (SdoError, TimeoutError) as error:
            raise ModeLeftError(f"{self._axis.name}: it stays in homing mode: {error}") from error

    async def _wait(self, over: Callable[[], bool]) -> None:
        """Until it is over; no longer than coming to rest may take."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_AT_REST_WITHIN_S):
                while not over():
                    await asyncio.sleep(_POLL_S)

    async def _set_up(self) -> None:
        permitted, unit = self._permitted, self._axis.drive.velocity_unit_counts_s
        wanted = _homing_speed(self._axis, self._channel)
        speed = max(1, round(min(wanted, permitted.max_velocity) / unit))
        await self._write(objects.HOMING_METHOD, 0, self._axis.homing.method)
        for subindex in (1, 2):
            await self._write(objects.HOMING_SPEEDS, subindex, speed)
        acceleration = objects.of_axis(objects.HOMING_ACCELERATION, self._axis.drive.axis)
        if self._dictionary.has(acceleration):
            most = max(1, round(permitted.max_acceleration / unit))
            await self._write(objects.HOMING_ACCELERATION, 0, most)
        await self._change_mode(objects.HOMING_MODE)

    async def _change_mode(self, number: int) -> None:
        """Change the mode and wait until the drive shows it."""
        await self._write(objects.MODE, 0, number)
        display = objects.of_axis(objects.MODE_DISPLAY, self._axis.drive.axis)
        try:
            async with asyncio.timeout(_MODE_WITHIN_S):
                while await self._sdo.read(display, size=1) != bytes([number]):
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            text = f"told mode {number}, the drive does not show it within {_MODE_WITHIN_S:g} s"
            raise TimeoutError(text) from None

    async def _enable(self) -> None:
        self._channel.homing = True
        self._goal(PowerGoal.ENABLED)
        try:
            async with asyncio.timeout(_ENABLED_WITHIN_S):
                while self._channel.state is not PowerState.OPERATION_ENABLED:
                    self._check_progress()
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            state = self._channel.state.value
            text = f"told to enable, the drive is {state} after {_ENABLED_WITHIN_S:g} s"
            raise TimeoutError(text) from None

    def _check_progress(self) -> None:
        if self._channel.goal is not PowerGoal.ENABLED:
            raise HomingError(f"{self._axis.name}: stopped while homing")

    async def _seek(self) -> None:
        """Raise the start bit and keep it until the drive is done."""
        self._channel.start_homing = True
        await asyncio.sleep(_STARTED_WITHIN_S)  # until then it may still show an earlier homing
        while True:
            if self._channel.state is not PowerState.OPERATION_ENABLED:
                state = self._channel.state.value
                raise HomingError(f"{self._axis.name}: went into {state} while homing")
            self._check_progress()
            progress = homing_progress(self._channel.statusword)
            if progress is HomingProgress.IN_PROGRESS:
                self._check_place()
            if progress is HomingProgress.DONE:
                self._check_position()
                return
            if progress is HomingProgress.ERROR:
                raise HomingError(f"{self._axis.name}: the drive found no zero")
            await asyncio.sleep(_POLL_S)

    def _check_place(self) -> None:
        """Until the zero is found, places are still those of the one before."""
        permitted, at = self._permitted, self._channel.position_counts
        if not permitted.lowest <= at <= permitted.highest:
            end = self._channel.scale.position(at)
            raise HomingError(
                f"{self._axis.name}: stopped at {end:.2f} {self._axis.unit}: a coupled limit ends "
                "there, with the other axes where they are"
            )

    def _check_position(self) -> None:
        """Makes differ in the sign of the home offset: the axis is now near where it was found."""
        home, told = self._channel.scale.counts(self._axis.homing_position), self._channel
        if abs(told.position_counts + home) < abs(told.position_counts - home):
            raise HomingError(
                f"{self._axis.name}: it found its zero and says that it is at "
                f"{told.scale.position(told.position_counts):.3g} {told.scale.unit}, not at "
                f"{self._axis.homing_position:.3g}: it counts its home offset the other way round"
            )

    def _goal(self, goal: PowerGoal) -> None:
        self._channel.set_goal(goal, self._channel.received_ns or 0)

    async def _write(self, index: int, subindex: int, value: int) -> None:
        index = objects.of_axis(index, self._axis.drive.axis)
        await self._sdo.write(index, subindex, self._dictionary.encode(index, subindex, value))


def _homing_speed(axis: Axis, channel: AxisChannel) -> int:
    """Counts/s."""
    return channel.scale.magnitude(axis.homing_speed)
