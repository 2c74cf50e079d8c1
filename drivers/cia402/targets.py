"""What a drive in each mode is sent for one permitted step: mode bits and a target."""

from typing import Final, Protocol

from drivers.cia402.modes import MODES
from drivers.cia402.power_state import Control, Status
from safety.permit import PermittedStep

_INT32_LOW: Final = -(1 << 31)
_INT32_HIGH: Final = (1 << 31) - 1


class Target(Protocol):
    """The target of one axis, cycle after cycle, while it is enabled and follows."""

    def hold(self, position: int) -> None:
        """Stay at `position` counts until there is a step; called each cycle before enabling."""
        ...

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int
    ) -> tuple[int, int]:
        """Mode bits of the controlword, and the value of the target object."""
        ...


class CyclicPosition:
    """CSP: the point of the step that is due now."""

    def __init__(self, index: int) -> None:
        self._index = index
        self._held = 0

    def hold(self, position: int) -> None:
        self._held = position

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int
    ) -> tuple[int, int]:
        del position, statusword
        if step is not None:
            self._held = step.target(self._index, t_ns)
        return 0, self._held


class Velocity:
    """CSV and PV: the step's velocity, and what brings the axis back onto its line."""

    _CATCH_UP_PER_S: Final = 5.0

    def __init__(self, index: int, max_velocity: int, unit_counts_s: float) -> None:
        self._index = index
        self._max_velocity = max_velocity
        self._unit_counts_s = unit_counts_s
        self._held = 0

    def hold(self, position: int) -> None:
        self._held = position

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int
    ) -> tuple[int, int]:
        del statusword
        velocity = 0.0
        if step is not None:
            self._held = step.target(self._index, t_ns)
            velocity = step.velocity(self._index, t_ns)
        velocity += self._CATCH_UP_PER_S * (self._held - position)
        velocity = max(-self._max_velocity, min(self._max_velocity, velocity))
        value = round(velocity / self._unit_counts_s)
        return 0, max(_INT32_LOW, min(_INT32_HIGH, value))


class ProfilePosition:
    """PP: each step's end as a set-point of its own, handed over by the drive's handshake.

    A new set-point is offered with bit 4 until the drive acknowledges it, then taken back until the
    drive is ready for the next. Steps that come meanwhile are left out but for the newest.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._wanted = self._offered = 0
        self._offering = False

    def hold(self, position: int) -> None:
        self._wanted = self._offered = position
        self._offering = False

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int
    ) -> tuple[int, int]:
        del t_ns, position
        if step is not None:
            self._wanted = step.to_counts[self._index]
        acknowledged = bool(statusword & Status.SETPOINT_ACKNOWLEDGED)
        if self._offering:
            self._offering = not acknowledged
        elif not acknowledged and self._wanted != self._offered:
            self._offered, self._offering = self._wanted, True
        bits = Control.CHANGE_IMMEDIATELY | (Control.NEW_SETPOINT if self._offering else 0)
        return bits, self._offered


def target_of(mode: str, index: int, max_velocity: int, unit_counts_s: float) -> Target:
    """The target of an axis in `mode`, at place `index` of the actuation vector."""
    if MODES[mode].is_velocity:
        return Velocity(index, max_velocity, unit_counts_s)
    return ProfilePosition(index) if mode == "pp" else CyclicPosition(index)
