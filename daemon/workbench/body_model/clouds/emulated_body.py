"""An emulated body by itself, sent from one configuration to another as its axes would."""

from typing import Final

import numpy as np

from config.robot import Robot
from daemon.robot.axes import AxisRanges
from safety.risk.model.mixture import FloatArray
from sim_backends.lab.lab import plant_of
from sim_backends.plants.plant import BodyState, PlantError, TipLoad

_STEP_S: Final = 0.2
"""Of motion. In half of it a tendon arm comes to the same place but for 0.03 mm."""
_SETTLE_S: Final = 0.4
_FINEST: Final = 1.0 / 16.0
"""Steps are halved until they are so short where the body finds no equilibrium."""


class UnreachableError(RuntimeError):
    """The body did not come to where it was sent. Says where."""


class EmulatedBody:
    """Remembers how it came to where it is."""

    def __init__(self, robot: Robot) -> None:
        """Raises LabError."""
        assert robot.emulation is not None
        self._ranges = AxisRanges.of(robot)
        self._load = TipLoad(robot.emulation.tip_load_g)
        self._plant = plant_of(robot.emulation, robot)
        self._at = np.zeros(self._ranges.count)

    @property
    def at(self) -> FloatArray:
        """(m,) where the axes are."""
        return self._at

    def rest(self) -> None:
        """Nothing has happened yet."""
        self._plant.reset()
        self._at = np.zeros(self._ranges.count)

    def go(self, target: FloatArray) -> BodyState:
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
            return self._plant.step(target, self._load, _SETTLE_S)
        except PlantError as error:
            raise UnreachableError(str(error)) from None

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
