"""Where a body may be asked to go: actuation vectors that it can hold.

Not every vector is one. Three straight tendons that all pull by a centimetre do not make a shape
but tear; a tendon that pays out what nothing takes up hangs loose. So a body has parameters, each
from 0 to 1, of which its vectors are made, and of those only such are taken that the plant can
reach, with the forces on its axes within their limits and its tip within the workspace.
"""

from dataclasses import dataclass
from math import pi
from typing import Final, Protocol

import numpy as np

from config.emulation.plants import TendonArmPlant
from config.robot import Robot
from daemon.robot.axes import AxisRanges
from sim_backends.lab.bodies import plant_of
from sim_backends.plants.plant import FloatArray, PlantError, TipLoad

_LOOSER_MM: Final = 0.4
_TIGHTER_MM: Final = 1.0
"""How much all straight tendons together may be paid out or pulled in beside the bending."""
_AT_REST_S: Final = 60.0
_TIP_MARGIN_MM: Final = 3.0
"""A controller overshoots the ends of the workspace a little."""


class Manifold(Protocol):
    """Parameters of a kind of body."""

    @property
    def parameters(self) -> int:
        """q."""
        ...

    def actuation(self, parameters: FloatArray) -> FloatArray:
        """(m,) of (q,) parameters in [0, 1]."""
        ...


@dataclass(frozen=True)
class BoxManifold:
    """Every axis by itself: right where actuators do not pull against each other.

    Of an axis that comes round to the same body again, one round.
    """

    ranges: AxisRanges

    @property
    def parameters(self) -> int:
        return self.ranges.count

    def actuation(self, parameters: FloatArray) -> FloatArray:
        lowest, highest = self.ranges.one_round
        return np.asarray(lowest + parameters * (highest - lowest))


@dataclass(frozen=True)
class TendonManifold:
    """Which way the straight tendons bend the arm, how far, how tight they are; then the others.

    Directions and amounts are spread evenly over a disc.
    """

    ranges: AxisRanges
    angles_rad: FloatArray
    """(m,) of the tendons."""
    straight: FloatArray
    """(m,) one where a tendon is straight, else zero."""

    @classmethod
    def of(cls, ranges: AxisRanges, plant: TendonArmPlant) -> "TendonManifold":
        return cls(
            ranges,
            np.array([tendon.angle_rad for tendon in plant.tendons]),
            np.array([float(tendon.turns == 0.0) for tendon in plant.tendons]),
        )

    @property
    def parameters(self) -> int:
        return 3 + int((self.straight == 0.0).sum())

    def actuation(self, parameters: FloatArray) -> FloatArray:
        furthest = float(np.minimum(self.ranges.highest, -self.ranges.lowest).min())
        way, far = 2.0 * pi * parameters[0], furthest * np.sqrt(parameters[1])
        together = -_LOOSER_MM + (_LOOSER_MM + _TIGHTER_MM) * parameters[2]
        u: FloatArray = self.straight * (far * np.cos(way - self.angles_rad) + together)
        others = self.straight == 0.0
        u[others] = (self.ranges.lowest + self.ranges.travel * 0.5)[others]
        u[others] += (parameters[3:] - 0.5) * self.ranges.travel[others]
        return u


def manifold_of(robot: Robot) -> Manifold:
    """Of the robot's emulated plant."""
    ranges = AxisRanges.of(robot)
    if robot.emulation is not None and isinstance(robot.emulation.plant, TendonArmPlant):
        return TendonManifold.of(ranges, robot.emulation.plant)
    return BoxManifold(ranges)


class Candidates:
    """A sequence of parameters that fills its cube evenly, and which of them a body can hold."""

    def __init__(self, robot: Robot, seed: int) -> None:
        """Raises LabError."""
        assert robot.emulation is not None
        self._manifold = manifold_of(robot)
        self._ranges = AxisRanges.of(robot)
        self._workspace = robot.workspace
        self._limits = [axis.tension_range_n or (-np.inf, np.inf) for axis in robot.axes]
        self._plant = plant_of(robot.emulation, robot)
        self._load = TipLoad(robot.emulation.tip_load_g)
        self._seed = seed

    def parameters(self, begin: int, count: int) -> FloatArray:
        """(count, q) members of the sequence from number `begin` on."""
        q = self._manifold.parameters
        shift = np.random.default_rng(self._seed).random(q)
        # The root of x^(q+1) = x + 1: its powers make the golden ratio's lattice in q dimensions.
        root = 1.5
        for _ in range(60):
            root = (1.0 + root) ** (1.0 / (q + 1.0))
        ways = root ** -np.arange(1.0, q + 1.0)
        number = np.arange(begin, begin + count)[:, None]
        return np.asarray((shift + number * ways) % 1.0)

    def actuation(self, parameters: FloatArray) -> FloatArray:
        """(n, m) of (n, q)."""
        return np.array([self._manifold.actuation(one) for one in parameters])

    def possible(self, u: FloatArray) -> bool:
        """Whether the body can hold (m,) u, come to from rest."""
        if not ((u >= self._ranges.lowest) & (u <= self._ranges.highest)).all():
            return False
        if not bool(self._ranges.coupled.inside(u)):
            return False
        self._plant.reset()
        try:
            state = self._plant.step(u, self._load, _AT_REST_S)
        except PlantError:
            return False
        forces = state.actuator_forces
        held = all(low <= f <= high for f, (low, high) in zip(forces, self._limits, strict=True))
        return held and self._inside(state.tip.position_mm)

    def _inside(self, tip_mm: FloatArray) -> bool:
        if self._workspace is None:
            return True
        ends = (self._workspace.x_mm, self._workspace.y_mm, self._workspace.z_mm)
        return all(
            low - _TIP_MARGIN_MM <= x <= high + _TIP_MARGIN_MM
            for x, (low, high) in zip(tip_mm, ends, strict=True)
        )
