"""Chambers along a rod: gas that pushes, sliders that hold, and a solver that makes use of it."""

from typing import NamedTuple

import numpy as np

from sim_backends.plants.rod_kernels import (
    ChamberDrive,
    FloatArray,
    March,
    NewtonRule,
    Start,
    settle_chambers,
)
from sim_backends.plants.shooting import CLOSE, ITERATIONS, Equilibrium, Problem, Solver, stable
from sim_backends.plants.soft_arm.gas import ATMOSPHERE_MPA, GasLines
from sim_backends.plants.soft_arm.hysteresis import StopOperators


class Chambers(NamedTuple):
    """What drives the rod in one step. A `Drive`. presence: (N, m) 1 where a chamber is, else 0."""

    presence: FloatArray
    gas: GasLines
    sliders: StopOperators

    def spread(self, pull_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self.presence * pull_n, self.presence

    def imbalance(
        self, march: March, pull_n: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        pressure, by_length = self.gas.chamber_pressure(march.length_mm)
        held, stiffness = self.sliders.force(march.length_mm)
        area = self.gas.area_mm2
        return (
            pull_n + (pressure - ATMOSPHERE_MPA) * area - held,
            np.diag(by_length * area - stiffness),
            np.eye(len(area)),
        )

    def holding(self, march: March) -> FloatArray:
        _, by_length = self.gas.chamber_pressure(march.length_mm)
        return np.diag(np.sqrt(self.sliders.sticking() - by_length * self.gas.area_mm2))

    def for_kernels(self) -> ChamberDrive:
        """The same as arrays."""
        gas, sliders = self.gas, self.sliders
        return ChamberDrive(
            self.presence,
            gas.amount,
            gas.in_chamber,
            gas.supply_mm3,
            gas.area_mm2,
            gas.kept,
            ATMOSPHERE_MPA,
            sliders.stiffness,
            sliders.threshold_mm,
            sliders.slider_mm,
        )


class ChamberSolver(Solver):
    """A `Solver` whose ordinary step is compiled as a whole: what comes out is the same bits."""

    def _guess(self, problem: Problem, start: Equilibrium, ahead: FloatArray) -> Equilibrium | None:
        drive, rod = problem.drive, self._rod
        if not isinstance(drive, Chambers):
            return super()._guess(problem, start, ahead)
        tension = np.empty_like(drive.presence)
        settled = settle_chambers(
            rod.loaded(tension, problem.force, problem.stiffness, problem.rest),
            drive.for_kernels(),
            self._scale,
            Start(start.unknowns + ahead, start.march.strain, start.response),
            NewtonRule(CLOSE, self._tolerance, ITERATIONS, rod.foundation(problem.force)),
        )
        if not settled.converged:  # it takes more than good steps
            return super()._guess(problem, start, ahead)
        unstable = settled.unstable
        if unstable and not stable(drive, settled.march, settled.response, unstable):
            return None
        return Equilibrium(settled.march, settled.unknowns, settled.response)
