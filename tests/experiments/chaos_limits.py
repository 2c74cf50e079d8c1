"""What limits are, read from the robot's YAML once more, and whether anything was outside them.

Nothing here uses the product's conversions or limits: counts come from the frames that went out, a
millimetre from gears, screws and spools as the file has them.
"""

import struct
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, pi
from pathlib import Path
from typing import Any, Final, NamedTuple

import yaml

from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.flight_recorder import RecorderStatus
from daemon.recording.format.can_batches import BusBatches

_SYNC: Final = 0x80
_RPDO_1: Final = 0x200
_PDO_STEP: Final = 0x100
_CONTROL_AND_TARGET: Final = struct.Struct("<Hi")
_ENABLED: Final = 0x0F
"""The controlword's low half when a drive is told to follow."""
_FRAME_S: Final = 0.025
"""A step of the control loop: within one, a velocity changes at once."""
_LAGS: Final = (1, 2, 3, 5, 10, 20)
"""In samples, over which velocities are compared."""
_SHAFT_BEYOND: Final = 1.25
"""A shaft that catches up with its target after a lost frame is faster than the target was."""
_SHAFT_OVERSHOOT_MM: Final = 0.2
_CATCHES_UP_S: Final = 0.05
"""One that was jammed closes its following error within some lags of its drive, 4 ms each."""


class AxisLimits(NamedTuple):
    """Of one axis, in mm, mm/s and mm/s²."""

    name: str
    counts_per_mm: float
    lowest: float
    highest: float
    velocity: float
    acceleration: float


def limits_of(path: Path) -> dict[tuple[int, int], AxisLimits]:
    """By node and number of the axis in it."""
    robot: dict[str, Any] = yaml.safe_load(path.read_text())
    found = {}
    for axis in robot["axes"]:
        drive = axis["drive"]
        per_turn_mm = (
            2.0 * pi * axis["spool_radius_mm"]
            if axis["kind"] == "tendon_motor"
            else float(axis["lead_mm"])
        )
        turns = float(axis.get("gear_ratio", 1.0)) * drive["counts_per_turn"]
        lowest, highest = axis["travel_mm"]
        found[drive["node"], drive.get("axis", 0)] = AxisLimits(
            axis["name"],
            turns / per_turn_mm * (-1.0 if drive.get("inverted") else 1.0),
            lowest,
            highest,
            axis["max_velocity_mm_s"],
            axis["max_acceleration_mm_s2"],
        )
    return found


@dataclass(frozen=True)
class Outside:
    """Something went where it may not."""

    t_s: float
    axis: str
    what: str
    value: float
    limit: float

    def __str__(self) -> str:
        return f"{self.t_s:.3f} s: {self.axis}: {self.what} {self.value:.4g}, limit {self.limit:g}"


class TargetWitness(DirectRecorder):
    """A recorder that keeps the targets of every SYNC, and can be made to fail for a while."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.limits = limits_of(path)
        self.broken = ""
        """Why it does not record at the moment; empty: it does."""
        self._last: dict[tuple[int, int], int] = {}
        self._fresh: set[tuple[int, int]] = set()
        """Axes that were sent a target since the last SYNC."""
        self._runs: dict[tuple[int, int], list[list[tuple[int, int]]]] = defaultdict(list)
        """By axis: stretches of (time of the SYNC in ns, target) while it is told to follow."""

    def can_tap(self, bus: str) -> BusBatches:
        return _Tee(super().can_tap(bus), self)

    @property
    def status(self) -> RecorderStatus:
        status = super().status
        return status._replace(failed=self.broken) if self.broken else status

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        """Targets count with the SYNC that follows them.

        A cycle whose target a full line refused is left out: the axis is told nothing then, and
        the next target is compared with the last one that went out.
        """
        for can_id, data in frames:
            if can_id == _SYNC:
                for axis in self._fresh & self._last.keys():
                    run = self._runs[axis][-1]
                    if run and run[-1][0] == t_ns:
                        run.pop()  # a quick stop has a SYNC of its own
                    run.append((t_ns, self._last[axis]))
                self._fresh.clear()
                continue
            number, node = divmod(can_id - _RPDO_1, _PDO_STEP)
            axis = node, number
            if axis not in self.limits or len(data) != _CONTROL_AND_TARGET.size:
                continue
            control, target = _CONTROL_AND_TARGET.unpack(data)
            if control & _ENABLED != _ENABLED:
                self._last.pop(axis, None)
                continue
            if axis not in self._last:
                self._runs[axis].append([])
            self._last[axis] = target
            self._fresh.add(axis)

    def take_outside(self) -> list[Outside]:
        """What was outside its limits since the last time; the stretches are forgotten."""
        found = [
            outside
            for axis, runs in self._runs.items()
            for run in runs
            for outside in targets_outside(self.limits[axis], run)
        ]
        for axis, runs in self._runs.items():
            runs[:] = [runs[-1][-max(_LAGS) :]] if axis in self._last else []
        return sorted(found, key=lambda one: one.t_s)


class _Tee(BusBatches):
    """Tells the witness too."""

    __slots__ = ("_batches", "_witness")

    def __init__(self, batches: BusBatches, witness: TargetWitness) -> None:
        self._batches = batches
        self._witness = witness

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        self._batches.received(can_id, data, t_ns)

    def sent(self, frames: Sequence[tuple[int, bytes]], t_ns: int) -> None:
        self._batches.sent(frames, t_ns)
        self._witness.sent(frames, t_ns)


def targets_outside(limits: AxisLimits, run: Sequence[tuple[int, int]]) -> list[Outside]:
    """Of one axis that followed without a break: the first of each kind."""
    scale = limits.counts_per_mm
    count_mm = 1.0 / abs(scale)
    times = [t_ns * 1e-9 for t_ns, _ in run]
    places = [target / scale for _, target in run]
    found: dict[str, Outside] = {}

    def look(t_s: float, what: str, value: float, limit: float, allowance: float) -> None:
        if value > limit + allowance and what not in found:
            found[what] = Outside(t_s, limits.name, what, value, limit)

    velocities: list[tuple[float, float, float]] = []
    for index, (t_s, place) in enumerate(zip(times, places, strict=True)):
        before = places[index - 1] if index else place
        # What is outside may come back, and may not go further out.
        look(t_s, "target", place, max(limits.highest, before), count_mm)
        look(t_s, "target below", -place, -min(limits.lowest, before), count_mm)
        if index:
            dt_s = t_s - times[index - 1]
            velocity = (place - before) / dt_s
            velocities.append((t_s, dt_s, velocity))
            look(t_s, "velocity", abs(velocity), limits.velocity, 2.0 * count_mm / dt_s)
    for lag in _LAGS:
        for (t_0, dt_0, v_0), (t_s, dt_1, v_1) in zip(velocities, velocities[lag:], strict=False):
            within_s = t_s - t_0 + _FRAME_S
            rounding = 2.0 * count_mm / dt_0 + 2.0 * count_mm / dt_1
            change = abs(v_1 - v_0)
            look(
                t_s,
                "acceleration",
                change / within_s,
                limits.acceleration,
                rounding / within_s,
            )
    return list(found.values())


class ShaftWitness:
    """Where the emulated shafts really are, and how fast."""

    def __init__(self, limits: Sequence[AxisLimits]) -> None:
        self._limits = limits
        self._before: tuple[float, Sequence[float]] | None = None
        self._found: dict[tuple[str, str], Outside] = {}
        self._jammed_s: dict[int, float] = {}
        """By place: when it was last held by something."""

    def look(self, t_s: float, shafts: Sequence[float], jammed: Sequence[bool] = ()) -> None:
        """shafts: counts, in the order of the axes. jammed: whether something holds them.

        One that comes free goes to its target, which is no farther than its following error, as
        fast as its motor can.
        """
        self._jammed_s |= {place: t_s for place, now in enumerate(jammed) if now}
        for place, (limits, counts) in enumerate(zip(self._limits, shafts, strict=True)):
            at = counts / limits.counts_per_mm
            self._note(t_s, limits, "shaft", at, limits.highest + _SHAFT_OVERSHOOT_MM)
            self._note(t_s, limits, "shaft below", -at, _SHAFT_OVERSHOOT_MM - limits.lowest)
            loose = t_s - self._jammed_s.get(place, -inf) > _CATCHES_UP_S
            if loose and self._before is not None and t_s > self._before[0]:
                before_s, before = self._before
                moved = abs(counts - before[place]) / abs(limits.counts_per_mm)
                velocity = moved / (t_s - before_s)
                fastest = limits.velocity * _SHAFT_BEYOND
                self._note(t_s, limits, "shaft's velocity", velocity, fastest)
        self._before = t_s, list(shafts)

    def take_outside(self) -> list[Outside]:
        """What was outside since the last time."""
        found, self._found = self._found, {}
        return list(found.values())

    def _note(self, t_s: float, limits: AxisLimits, what: str, value: float, limit: float) -> None:
        if value > limit + 1e-6 and (limits.name, what) not in self._found:
            self._found[limits.name, what] = Outside(t_s, limits.name, what, value, limit)


def in_order(
    limits: Mapping[tuple[int, int], AxisLimits], drives: Sequence[str]
) -> list[AxisLimits]:
    """As the lab counts its shafts. drives: their names, as `can0/3`."""
    nodes = [int(name.rpartition("/")[2]) for name in drives]
    return [limits[node, n] for node in nodes for n in range(8) if (node, n) in limits]
