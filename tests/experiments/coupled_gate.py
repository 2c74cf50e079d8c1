"""Random proposals at a gate with coupled limits: `python -m tests.experiments.coupled_gate`.

What goes on the bus is held against the robot file, read and worked out here by itself: its YAML,
its coordinates, its counts. Frames come early, late and in bursts; proposals lead out, along, back
in, to places of the other side, and are not numbers; drives are settled anew meanwhile. A gate that
does not know of coupled limits gets the same proposals, and shows how often they led out.
"""

import argparse
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, nan, pi
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from config.loader import load_robot
from daemon.robot.coupled_axes import count_coupling
from drivers.axis_scale import axis_scale, count_limits
from drivers.pose import Vector
from safety.gate import Gate, Measured
from safety.permit import PermittedStep
from safety.risk_source import NoModel
from tests import SHIPPED_ROBOTS

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
MS = 1_000_000
_BUS_NS = 2 * MS
_SETTLED_EVERY = 1000
_OF_PLACES = 20
FASTER = (
    ("travel_mm: [-10.0, 10.0]", "travel_mm: [-30.0, 30.0]"),
    ("travel_mm: [-43.5, 23.5]", "travel_mm: [-83.0, 63.0]"),
    ("max_velocity_rad_s: 1.0", "max_velocity_rad_s: 6.0"),
    ("max_velocity_mm_s: 5.0", "max_velocity_mm_s: 40.0"),
    ("max_acceleration_mm_s2: 50.0", "max_acceleration_mm_s2: 120.0"),
    ("following_error_rad: 0.08", "following_error_rad: 2.0"),
    ("following_error_mm: 0.5", "following_error_mm: 20.0"),
)
"""A robot whose drives alone do not keep it from anything, and which takes long to stop."""


def faster(folder: Path) -> Path:
    """The file of that robot."""
    text = TUBES.read_text()
    for old, new in FASTER:
        assert old in text
        text = text.replace(old, new)
    path = folder / "fast_tubes.yaml"
    path.write_text(text)
    return path


class OwnReading:
    """Coupled limits as the file has them, by arithmetic of its own: nothing of config/ is used."""

    def __init__(self, path: Path) -> None:
        data = yaml.safe_load(path.read_text())
        axes = data["axes"]
        self.names = [axis["name"] for axis in axes]
        self.units_per_count = np.array([self._units_per_count(axis) for axis in axes])
        self.travel = np.array([axis.get("travel_mm") or axis["travel_rad"] for axis in axes])
        sums = dict(zip(self.names, np.eye(len(axes)), strict=True))
        constants = dict.fromkeys(self.names, 0.0)
        coordinates = data.get("coordinates", [])
        if coordinates:
            moves = [[one["moves"].get(name, 0.0) for one in coordinates] for name in self.names]
            for number, one in enumerate(coordinates):
                only = np.zeros(len(axes))
                only[number] = 1.0
                sums[one["name"]] = np.linalg.solve(np.array(moves).T, only)
                constants[one["name"]] = one.get("at_zero_mm", one.get("at_zero_rad", 0.0))
        self._sums, self._constants = sums, constants
        self.limits = data.get("coupled_limits", [])

    @staticmethod
    def _units_per_count(axis: dict[str, Any]) -> float:
        turn = axis.get("lead_mm", 2.0 * pi)
        sign = -1.0 if axis["drive"].get("inverted") else 1.0
        return float(sign * turn / (axis["drive"]["counts_per_turn"] * axis.get("gear_ratio", 1.0)))

    def sum_of(self, named: dict[str, float], counts: Vector) -> Vector:
        """(n,) of (n, m) counts."""
        row = np.sum([factor * self._sums[name] for name, factor in named.items()], axis=0)
        constant = sum(factor * self._constants[name] for name, factor in named.items())
        return np.asarray((counts * self.units_per_count) @ row + constant)

    def beyond(self, limit: dict[str, Any], counts: Vector) -> Vector:
        """(n,) mm or rad by which (n, m) counts break a limit; negative: by which they keep it."""
        value = self.sum_of(limit["sum"], counts)
        lowest = limit.get("lowest_mm", limit.get("lowest_rad", -inf))
        highest = limit.get("highest_mm", limit.get("highest_rad", inf))
        beyond = np.maximum(lowest - value, value - highest)
        for condition in limit.get("only_while", []):
            off = self.sum_of(condition["sum"], counts) - condition.get(
                "near_rad", condition.get("near_mm")
            )
            if condition["kind"] == "angle" and condition.get("comes_round", True):
                off = np.arctan2(np.sin(off), np.cos(off))
            elif condition.get("period_mm"):
                off = off - condition["period_mm"] * np.round(off / condition["period_mm"])
            within = condition.get("within_rad", condition.get("within_mm"))
            beyond = np.where(np.abs(off) < within, beyond, -inf)
        return np.asarray(beyond)

    def outside(self, counts: Vector) -> float:
        """How far the worst of (n, m) counts is beyond the limit that it breaks most; ≤ 0: none."""
        return max(float(self.beyond(limit, counts).max()) for limit in self.limits)


@dataclass
class Found:
    """What came of many proposals."""

    proposals: int = 0
    cut: dict[str, int] = field(default_factory=dict)
    """How often each limit cut a step."""
    refused: int = 0
    without_step: int = 0
    places: int = 0
    """On the bus, that were looked at."""
    outside: int = 0
    worst: float = -inf
    """By how much the worst place was beyond a limit, mm or rad."""
    nearest: dict[str, float] = field(default_factory=dict)
    """How near each limit was come to from inside, mm or rad."""
    without_limits_outside: int = 0
    """Places that a gate without coupled limits let be outside, of the same proposals."""

    def __str__(self) -> str:
        cut = ", ".join(f"{name} {count}" for name, count in sorted(self.cut.items()))
        near = ", ".join(f"{name} {gap:.4f}" for name, gap in sorted(self.nearest.items()))
        return (
            f"{self.proposals} proposals, {self.places} places on the bus: {self.outside} outside "
            f"(worst {self.worst:+.5f})\n"
            f"cut short: {cut}; refused {self.refused}; no step {self.without_step}\n"
            f"come as near as: {near}\n"
            f"without coupled limits: {self.without_limits_outside} places outside"
        )


class _Player:
    """A gate whose axes follow it, and what it sends on the bus."""

    def __init__(self, path: Path, coupled: bool) -> None:
        robot = load_robot(path).robot
        self.limits = [count_limits(axis) for axis in robot.axes]
        self.gate = Gate(
            self.limits,
            [axis_scale(axis).counts_per_unit for axis in robot.axes],
            [None] * len(robot.axes),
            NoModel(),
            0.5,
            0.02,
            count_coupling(robot) if coupled else (),
        )
        self.last: PermittedStep | None = None
        self.at: tuple[int, ...] = (0,) * len(robot.axes)

    def settle(self, at: tuple[int, ...]) -> None:
        self.at, self.last = at, None
        self.gate.settle(at)

    def until(self, begin_ns: int, end_ns: int) -> Iterator[tuple[int, ...]]:
        """What goes on the bus between two moments."""
        for t_ns in (*range(begin_ns, end_ns, _BUS_NS), end_ns):
            if self.last is not None:
                self.at = self.last.targets(t_ns)
            yield self.at


def play(path: Path, proposals: int, seed: int) -> Found:
    """So many proposals, the same for the same seed."""
    own, found = OwnReading(path), Found()
    knowing, unknowing = _Player(path, True), _Player(path, False)
    random = np.random.default_rng(seed)
    names = [limit["name"] for limit in own.limits]
    found.nearest = dict.fromkeys(names, inf)
    t_ns, goal, left = 0, np.zeros(len(own.names)), 0
    waiting: list[tuple[int, ...]] = []
    idle: list[tuple[int, ...]] = []
    for number in range(proposals):
        if number % _SETTLED_EVERY == 0:
            at = _inside(own, random)
            knowing.settle(at)
            unknowing.settle(at)
        if left == 0:
            goal, left = _goal(own, random), int(random.integers(1, 300))
        left -= 1
        duration_ns = 25 * MS if random.random() < 0.7 else int(random.integers(5, 60)) * MS
        after_ns = duration_ns if random.random() < 0.6 else int(random.integers(0, 120 * MS))
        wanted = _wanted(own, random, goal, np.array(knowing.at))
        holds = random.random() < 0.02
        for player in (knowing, unknowing):
            here = [at + int(random.integers(-40, 41)) for at in player.at]
            measured = Measured(here, [None] * len(here))
            if holds:
                decision = player.gate.hold(measured, t_ns, duration_ns)
            else:
                decision = player.gate.decide(wanted, measured, t_ns, duration_ns)
            if player is knowing:
                _count(found, decision.limits, bool(decision.refused), decision.step is None)
            player.last = decision.step or player.last
        waiting += knowing.until(t_ns, t_ns + after_ns)
        idle += unknowing.until(t_ns, t_ns + after_ns)
        t_ns += after_ns
        found.proposals += 1
        if len(waiting) > 20_000 or number == proposals - 1:
            _judge(own, found, np.array(waiting), np.array(idle))
            waiting, idle = [], []
    return found


def _judge(own: OwnReading, found: Found, sent: Vector, idle: Vector) -> None:
    found.places += len(sent)
    for limit in own.limits:
        beyond = own.beyond(limit, sent)
        found.outside += int((beyond > 0.0).sum())
        found.worst = max(found.worst, float(beyond.max()))
        inside = -beyond[np.isfinite(beyond)]
        if inside.size:
            found.nearest[limit["name"]] = min(found.nearest[limit["name"]], float(inside.min()))
        found.without_limits_outside += int((own.beyond(limit, idle) > 0.0).sum())


def _count(found: Found, limits: tuple[str, ...], refused: bool, nothing: bool) -> None:
    for limit in limits:
        if limit.startswith("coupled limit: "):
            name = limit.removeprefix("coupled limit: ")
            found.cut[name] = found.cut.get(name, 0) + 1
    found.refused += refused
    found.without_step += nothing


def _inside(own: OwnReading, random: np.random.Generator) -> tuple[int, ...]:
    """A place inside, half of the time one that is near a limit."""
    many = random.uniform(own.travel[:, 0], own.travel[:, 1], (500, len(own.names)))
    many = np.round(many / own.units_per_count)
    beyond = np.max([own.beyond(limit, many) for limit in own.limits], axis=0)
    inside, beyond = many[beyond < 0.0][:_OF_PLACES], beyond[beyond < 0.0][:_OF_PLACES]
    chosen = inside[int(np.argmax(beyond)) if random.random() < 0.5 else 0]
    return tuple(int(count) for count in chosen)


def _goal(own: OwnReading, random: np.random.Generator) -> Vector:
    """Anywhere in the travels, often at their corners."""
    share = random.random(len(own.names))
    corner = random.random(len(own.names)) < 0.4
    share[corner] = np.round(share[corner])
    return np.asarray(own.travel[:, 0] + share * (own.travel[:, 1] - own.travel[:, 0]))


def _wanted(own: OwnReading, random: np.random.Generator, goal: Vector, at: Vector) -> list[float]:
    """Targets in counts: towards a goal, or anything."""
    kind = random.random()
    if kind < 0.8:
        way = goal / own.units_per_count - at
        return list(at + way * random.choice([0.002, 0.02, 0.2, 1.0]))
    if kind < 0.98:
        return list(at + random.normal(0.0, 1.0, len(at)) * 10.0 ** random.uniform(0.0, 5.0))
    odd = [nan, inf, -inf, 1e300, -1e18, 0.0]
    return [float(random.choice(odd)) if random.random() < 0.5 else float(one) for one in at]


def main() -> int:
    """Ends with 1 where a place was outside."""
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.coupled_gate")
    parser.add_argument("--robot", type=Path, help="default: the tubes, and again with fast axes")
    parser.add_argument("--proposals", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    with TemporaryDirectory() as folder:
        robots = [arguments.robot] if arguments.robot else [TUBES, faster(Path(folder))]
        outside = 0
        for robot in robots:
            found = play(robot, arguments.proposals // len(robots), arguments.seed)
            print(f"{robot.name}: {found}")
            outside += found.outside
    return int(outside > 0)


if __name__ == "__main__":
    sys.exit(main())
