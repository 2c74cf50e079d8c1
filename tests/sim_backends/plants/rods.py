"""Rods to test with, and their equilibria."""

from collections.abc import Sequence

import numpy as np

from sim_backends.plants.rod import Rod, Section, helix
from sim_backends.plants.rod_kernels import FloatArray
from sim_backends.plants.shooting import ConstantPull, Equilibrium, Problem, Solver

LENGTH_MM = 200.0
TENDON_RADIUS_MM = 8.0
TENDON_ANGLES = (0.0, 2 * np.pi / 3, -2 * np.pi / 3, 0.0)
TENDON_TURNS = (0.0, 0.0, 0.0, -3 * np.pi / LENGTH_MM)
TENDON_SECTION = Section(
    bending_n_mm2=5.79e3, torsion_n_mm2=4.45e3, shear_n=2573.0 / 2.6, axial_n=2573.0
)

ARM_LENGTH_MM = 155.0
ARM_SECTION = Section(bending_n_mm2=8e3, torsion_n_mm2=5.3e3, shear_n=43.0, axial_n=130.0)
CHAMBER_RADIUS_MM = 7.5

NO_FORCE = np.zeros(3)


def tendon_rod(intervals: int = 36) -> Rod:
    """Three straight tendons and one that winds."""
    return Rod(
        LENGTH_MM,
        TENDON_SECTION,
        [
            helix(TENDON_RADIUS_MM, angle, 0.0, LENGTH_MM, turn_rad_per_mm=turn)
            for angle, turn in zip(TENDON_ANGLES, TENDON_TURNS, strict=True)
        ],
        intervals,
    )


def chamber_rod(intervals: int = 36, turn_rad: float = np.pi / 3) -> Rod:
    """Two segments with three chambers each."""
    half, third = ARM_LENGTH_MM / 2, 2 * np.pi / 3
    return Rod(
        ARM_LENGTH_MM,
        ARM_SECTION,
        [
            helix(CHAMBER_RADIUS_MM, turn + third * index, start, start + half, chamber=True)
            for turn, start in ((0.0, 0.0), (turn_rad, half))
            for index in range(3)
        ],
        intervals,
    )


def bare_rod(section: Section, length_mm: float = 100.0, intervals: int = 40) -> Rod:
    """No routes at all."""
    return Rod(length_mm, section, [], intervals)


def problem(
    rod: Rod,
    pull_n: Sequence[float] | FloatArray,
    tip_n: Sequence[float] | FloatArray = NO_FORCE,
    weight_n: Sequence[float] | FloatArray = NO_FORCE,
) -> Problem:
    """Constant pulls, a dead force at the tip and an even weight."""
    force = rod.internal_force(np.asarray(tip_n, float), np.asarray(weight_n, float))
    return Problem(force, ConstantPull(rod, np.asarray(pull_n, float)), rod.stiffness, rod.rest)


def equilibrium(
    rod: Rod,
    pull_n: Sequence[float] | FloatArray,
    tip_n: Sequence[float] | FloatArray = NO_FORCE,
    weight_n: Sequence[float] | FloatArray = NO_FORCE,
) -> Equilibrium:
    """The stable equilibrium that the load leads to when it is raised from nothing."""
    pull = np.asarray(pull_n, float)
    found = Solver(rod).raise_load(problem(rod, pull, tip_n, weight_n), pull, NO_FORCE)
    assert found is not None
    return found


def tip_mm(found: Equilibrium) -> FloatArray:
    return np.asarray(found.march.position_mm[-1])
