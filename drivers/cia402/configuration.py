"""What a node is told before it may run: one table, written and read back object by object."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from math import ceil
from typing import Final, Protocol

from config.axis import Axis
from config.bus import Bus
from drivers.axis_scale import axis_scale, count_limits
from drivers.canopen.codec import cob_ids
from drivers.cia402 import objects
from safety.limits import HIGHEST_COUNT, LOWEST_COUNT


class Need(Enum):
    """What it means when a node does not have an object."""

    REQUIRED = "the node cannot be used"
    SAFETY = "the node may be used, and the operator is told what it will not do"
    WHERE_PRESENT = "it does without what the object is about"
    OPTIONAL = "nothing"


@dataclass(frozen=True)
class Setting:
    """One object to write and read back."""

    index: int
    subindex: int
    values: tuple[int, ...]
    """Acceptable values, best first: products differ in what they offer."""
    purpose: str
    need: Need = Need.REQUIRED

    def __str__(self) -> str:
        return f"0x{self.index:04X}:{self.subindex:02X} ({self.purpose})"


_MS: Final = 1000
_US: Final = 1_000_000
_MILLISECONDS_INDEX: Final = -3

_ON_CONNECTION_LOST: Final = {"quick_stop": 3, "disable_voltage": 2, "fault": 1}
_ON_QUICK_STOP: Final = {"ramp_then_off": 2, "ramp_then_hold": 6}
_ON_FAULT: Final = {"off": 0, "ramp_then_off": 2}

_RAMP_FIRST: Final = 1
_AS_THE_ENCODER: Final = 0
"""Of 0x607E: bit 7 would turn positions round, bit 6 velocities."""
_LEEWAY: Final = 1.05
"""For a cycle longer than the last: on a good host SYNC is within a twentieth of its time."""
_SYNC_IS_HEARD: Final = (cob_ids.SYNC, 1 << 31 | cob_ids.SYNC)
"""As of CiA 301 bit 31 means nothing; some nodes show it."""
_TO_PRE_OPERATIONAL: Final = 0
_TO_STOPPED: Final = 2


def node_settings(bus: Bus, axes: Sequence[Axis]) -> list[Setting]:
    """Everything for one node: how it watches the master, then each of its axes."""
    drive = axes[0].drive
    master = bus.master_node << 16 | round(bus.master_heartbeat_timeout_s * _MS)
    settings = [
        Setting(objects.GUARD_TIME, 0, (0,), "node guarding off", Need.OPTIONAL),
        Setting(objects.CONSUMER_HEARTBEAT, 1, (master,), "watch the master's heartbeat"),
        Setting(
            objects.ERROR_BEHAVIOUR,
            1,
            (_TO_PRE_OPERATIONAL, _TO_STOPPED),
            "leave operational when the master is lost",
            Need.SAFETY,
        ),
        _sync_period(bus),
        Setting(
            objects.PRODUCER_HEARTBEAT,
            0,
            (round(drive.heartbeat_period_s * _MS),),
            "own heartbeat",
        ),
    ]
    for axis in axes:
        settings += _axis_settings(bus, axis)
    return settings


def sync_settings(bus: Bus) -> list[Setting]:
    """Which SYNC a node takes, for one that somebody else may have left with another one. The
    counter cannot be changed while a period is set."""
    return [
        replace(_sync_period(bus), values=(0,)),
        Setting(objects.SYNC_COUNTER, 0, (0,), "SYNC without a counter", Need.WHERE_PRESENT),
        Setting(objects.SYNC_COB_ID, 0, _SYNC_IS_HEARD, "which SYNC it takes", Need.WHERE_PRESENT),
        _sync_period(bus),
    ]


def _sync_period(bus: Bus) -> Setting:
    period_us = round(bus.cycle_period_s * _US)
    index = objects.COMMUNICATION_CYCLE_PERIOD
    return Setting(index, 0, (period_us,), "SYNC period", Need.OPTIONAL)


class _MakeSetting(Protocol):
    def __call__(
        self, index: int, value: int, purpose: str, need: Need = ..., subindex: int = ...
    ) -> Setting: ...


def _axis_settings(bus: Bus, axis: Axis) -> Iterator[Setting]:
    number = axis.drive.axis

    def setting(
        index: int, value: int, purpose: str, need: Need = Need.REQUIRED, subindex: int = 0
    ) -> Setting:
        return Setting(objects.of_axis(index, number), subindex, (value,), purpose, need)

    period_ms = round(bus.cycle_period_s * _MS)
    yield setting(objects.INTERPOLATION_PERIOD, period_ms, "interpolation period", Need.OPTIONAL, 1)
    yield setting(
        objects.INTERPOLATION_PERIOD, _MILLISECONDS_INDEX, "its unit, ms", Need.OPTIONAL, 2
    )
    safe = axis.safe
    yield setting(
        objects.ABORT_CONNECTION_OPTION,
        _ON_CONNECTION_LOST[safe.connection_lost],
        "reaction to a lost connection",
        Need.SAFETY,
    )
    yield setting(objects.QUICK_STOP_OPTION, _ON_QUICK_STOP[safe.quick_stop], "end of a quick stop")
    for index, purpose in (
        (objects.SHUTDOWN_OPTION, "end of a shutdown"),
        (objects.DISABLE_OPERATION_OPTION, "end of an operation that is disabled"),
    ):
        yield setting(index, _RAMP_FIRST, purpose, Need.WHERE_PRESENT)
    yield setting(objects.FAULT_REACTION_OPTION, _ON_FAULT[safe.fault], "fault", Need.SAFETY)
    # Which way an axis counts is the robot file's to say; turned round here too, it would run the
    # other way. Before the limits, which are in counts that have their sign.
    yield setting(objects.POLARITY, _AS_THE_ENCODER, "direction of counting", Need.WHERE_PRESENT)
    yield from _limits(bus, axis, setting)
    yield setting(objects.MODE, objects.MODES[axis.drive.mode].number, "mode of operation")


def _limits(bus: Bus, axis: Axis, setting: _MakeSetting) -> Iterator[Setting]:
    scale, limits = axis_scale(axis), count_limits(axis)
    yield setting(objects.FOLLOWING_ERROR_WINDOW, limits.max_lag, "following error", Need.SAFETY)
    yield setting(
        objects.FOLLOWING_ERROR_TIMEOUT,
        round(axis.following_error_time_s * _MS),
        "time of a following error",
        Need.SAFETY,
    )
    # Positions count on from turn to turn: a drive that begins anew takes the shorter way.
    for subindex, end in ((1, LOWEST_COUNT), (2, HIGHEST_COUNT)):
        purpose = "no modulo counting"
        yield setting(objects.POSITION_RANGE_LIMIT, end, purpose, Need.WHERE_PRESENT, subindex)
    # Zero is this far from the home position, and the drive corrects its limits by it.
    offset = -scale.counts(axis.homing_position)
    needed = Need.REQUIRED if offset else Need.WHERE_PRESENT
    yield setting(objects.HOME_OFFSET, offset, "zero, from where homing ends", needed)
    lowest, highest = limits.lowest + offset, limits.highest + offset
    yield setting(objects.SOFTWARE_POSITION_LIMIT, lowest, "lowest position", Need.SAFETY, 1)
    yield setting(objects.SOFTWARE_POSITION_LIMIT, highest, "highest position", Need.SAFETY, 2)
    yield setting(objects.MAX_TORQUE, axis.drive.max_torque_permille, "most torque", Need.SAFETY)
    deceleration = _in_drive_units(axis, scale.magnitude(axis.quick_stop_deceleration))
    yield setting(objects.QUICK_STOP_DECELERATION, deceleration, "quick stop ramp")
    velocity = _in_drive_units(axis, limits.max_velocity)
    acceleration = _in_drive_units(axis, limits.max_acceleration)
    # At its highest velocity an axis is told whole counts, of which one more may be in a step and
    # in a cycle, and a cycle may be a little longer than the last: that is none of its limits.
    most = _in_drive_units(axis, ceil(_LEEWAY * limits.max_velocity + 2.0 / bus.cycle_period_s))
    yield setting(objects.MAX_PROFILE_VELOCITY, most, "highest velocity", Need.OPTIONAL)
    profiled = Need.REQUIRED if axis.drive.mode in ("pp", "pv") else Need.OPTIONAL
    yield setting(objects.PROFILE_VELOCITY, velocity, "profile velocity", profiled)
    yield setting(objects.PROFILE_ACCELERATION, acceleration, "profile acceleration", profiled)
    yield setting(objects.PROFILE_DECELERATION, acceleration, "profile deceleration", profiled)


def _in_drive_units(axis: Axis, counts: int) -> int:
    return max(1, round(counts / axis.drive.velocity_unit_counts_s))
