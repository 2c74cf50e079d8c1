"""An emulated body by itself, sent from one configuration to another as its axes would."""

from typing import Final

import numpy as np
from numpy.random import Generator
from scipy.interpolate import CubicSpline

from config.robot import Robot
from daemon.robot.axes import AxisRanges
from safety.risk.model.mixture import FloatArray
from sim_backends.lab.bodies import another_body, plant_of
from sim_backends.plants.plant import BodyState, PlantError, TipLoad

_STEP_S: Final = 0.2
"""Of motion. In half of it a tendon arm comes to the same place but for 0.03 mm."""
_SETTLE_S: Final = 0.4
_EVEN: Final = 1.05
"""Times as long as the shortest piece: so much unevenness a load makes of even pieces."""
_FINEST: Final = 1.0 / 16.0
"""Steps are halved until they are so short where the body finds no equilibrium."""


class UnreachableError(RuntimeError):
    """The body did not come to where it was sent. Says where."""


class EmulatedBody:
    """Remembers how it came to where it is."""

    def __init__(self, robot: Robot, body: int = 0) -> None:
        """body: the seed of another one of the same design; 0: the robot file's own.

        Raises LabError.
        """
        assert robot.emulation is not None
        emulation = another_body(robot.emulation, body) if body else robot.emulation
        self._ranges = AxisRanges.of(robot)
        self._load = TipLoad(emulation.tip_load_g)
        self._plant = plant_of(emulation, robot)
        self._at = np.zeros(self._ranges.count)
        self._nodes = len(self._plant.step(self._at, TipLoad(), 0.0).centreline_mm)
        self.rest()

    @property
    def at(self) -> FloatArray:
        """(m,) where the axes are."""
        return self._at

    def rest(self) -> None:
        """Nothing has happened yet."""
        self._plant.reset()
        self._at = np.zeros(self._ranges.count)

    def wait(self, for_s: float) -> None:
        """Rest where it is, and creep. Raises PlantError."""
        self._plant.step(self._at, self._load, for_s)

    def go(self, target: FloatArray, settle_s: float = _SETTLE_S) -> BodyState:
        """To (m,) target as fast as the axes can, and wait a little there: on a straight line, or
        on several where that keeps to coupled limits.

        Raises UnreachableError.
        """
        ways = self._ranges.coupled.way(self._at, target)
        if ways is None:
            raise UnreachableError("no way there keeps to the coupled limits")
        for place in ways:
            self._go_straight(place)
        try:
            state = self._plant.step(target, self._load, settle_s)
        except PlantError as error:
            raise UnreachableError(str(error)) from None
        return state._replace(centreline_mm=evenly_spaced(state.centreline_mm, self._nodes))

    def _go_straight(self, target: FloatArray) -> None:
        step = 1.0
        while np.abs(target - self._at).max() > 0.0:
            most_s = float((np.abs(target - self._at) / self._ranges.max_velocity).max())
            share = min(1.0, step * _STEP_S / most_s)
            there = target if share == 1.0 else self._at + share * (target - self._at)
            try:
                self._plant.step(there, self._load, share * most_s)
            except PlantError as error:
                step *= 0.5
                if step < _FINEST:
                    raise UnreachableError(str(error)) from None
                continue
            self._at = there


def evenly_spaced(centreline_mm: FloatArray, nodes: int) -> FloatArray:
    """(nodes, 3) of a body whose (n, 3) nodes may be fewer or more, and closer in some places.

    What is as it is wanted is left as it is.
    """
    chords = np.linalg.norm(np.diff(centreline_mm, axis=0), axis=1)
    if len(centreline_mm) == nodes and chords.max() <= _EVEN * chords.min():
        return centreline_mm
    arc = np.concatenate([[0.0], np.cumsum(chords)])
    return np.asarray(CubicSpline(arc, centreline_mm)(np.linspace(0.0, arc[-1], nodes)))


class Bodies:
    """Several bodies of one design, each built when it is first asked for."""

    def __init__(self, robot: Robot, count: int, first: int = 1) -> None:
        """count: 0: the robot file's own alone. first: the seed of the first of them."""
        self._robot, self._count, self._first = robot, count, first
        self._built: dict[int, EmulatedBody] = {}

    def rested(self, random: Generator) -> EmulatedBody:
        """One of them, by chance. Raises LabError."""
        number = self._first + int(random.integers(self._count)) if self._count else 0
        if number not in self._built:
            self._built[number] = EmulatedBody(self._robot, number)
        self._built[number].rest()
        return self._built[number]
