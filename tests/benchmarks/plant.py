"""How long one step of the pneumatic arm takes, and one equilibrium of a tendon-driven rod."""

import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial

import numpy as np

from config.emulation.plants import SoftArmPlant
from sim_backends.plants.plant import FloatArray, TipLoad
from sim_backends.plants.rod import Rod, Section, helix
from sim_backends.plants.shooting import ConstantPull, Problem, Solver, warm_up
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.benchmarks.timing import Figures, pieces

PISTON_MM2 = np.pi / 4.0 * 25.0**2
STROKE_MM = 50.0
PERIOD_S = 0.025
STEP_MM = 0.25
"""Ten millimetres a second, the fastest that the drives move."""


def measure(tiny: bool = False) -> Figures:
    """Milliseconds per step, by what the plant does: median, p99 and worst. Kernels are warm."""
    warm_up()
    steps = 20 if tiny else 3000
    still = [np.array([15.0, 0.0, 5.0, 0.0, 20.0, 0.0])] * steps
    moving = list(_walk(steps))
    filling = [TipLoad(mass) for mass in np.linspace(14.0, 30.0, steps)]
    return pieces(
        {
            "arm_still_unloaded": partial(_arm, still, [TipLoad()] * steps),
            "arm_still_30_g": partial(_arm, still, [TipLoad(30.0)] * steps),
            "arm_moving_unloaded": partial(_arm, moving, [TipLoad()] * steps),
            "arm_moving_14_g": partial(_arm, moving, [TipLoad(14.2)] * steps),
            "arm_moving_14_to_30_g": partial(_arm, moving, filling),
            "tendons_18_intervals_gravity_and_30_g": partial(_tendons, 18, steps),
            "tendons_36_intervals_gravity_and_30_g": partial(_tendons, 36, steps),
        }
    )


def _arm(positions: Iterable[FloatArray], loads: Iterable[TipLoad]) -> Figures:
    arm = SoftArm(SoftArmPlant(kind="soft_arm"), [PISTON_MM2] * 6)
    return _timed(
        partial(arm.step, position, load, PERIOD_S)
        for position, load in zip(positions, loads, strict=True)
    )


def _walk(steps: int) -> Iterator[FloatArray]:
    generator, here, done = np.random.default_rng(0), np.zeros(6), 0
    while done < steps:
        goal = generator.uniform(0.0, STROKE_MM, 6)
        count = min(steps - done, int(np.ceil(np.abs(goal - here).max() / STEP_MM)))
        for k in range(1, count + 1):
            yield here + (goal - here) * k / count
        here, done = goal, done + count


def _tendons(intervals: int, steps: int) -> Figures:
    """Three straight tendons and a winding one, 0.2 m, mounted level; tensions move by 0.05 N."""
    length = 200.0
    section = Section(bending_n_mm2=5.79e3, torsion_n_mm2=4.45e3, shear_n=990.0, axial_n=2573.0)
    routes = [helix(8.0, angle, 0.0, length) for angle in (0.0, 2.0944, -2.0944)]
    routes.append(helix(8.0, 0.0, 0.0, length, turn_rad_per_mm=-3 * np.pi / length))
    rod = Rod(length, section, routes, intervals)
    solver, level = Solver(rod), np.array([0.0, -0.294, 0.0])
    force = rod.internal_force(level, level)

    def problem(pull: FloatArray) -> Problem:
        return Problem(force, ConstantPull(rod, pull), rod.stiffness, rod.rest)

    phases = np.linspace(0.0, 0.0125 * steps, steps)[:, None] + np.array([0.0, 2.1, 4.2, 1.0])
    goals = 2.5 + 2.0 * np.sin(phases)
    start = solver.raise_load(problem(goals[0]), goals[0], np.zeros(3))
    assert start is not None
    last = [start, start]

    def step(goal: FloatArray) -> None:
        goes_on = last[1].unknowns - last[0].unknowns
        found = solver.find(lambda _: problem(goal), last[1], goes_on)
        assert found is not None
        last[:] = [last[1], found]

    return _timed(partial(step, goal) for goal in goals)


def _timed(steps: Iterable[Callable[[], object]]) -> Figures:
    durations = []
    for step in steps:
        started = time.perf_counter()
        step()
        durations.append(1e3 * (time.perf_counter() - started))
    return {
        "median_ms": round(float(np.median(durations)), 4),
        "p99_ms": round(float(np.quantile(durations, 0.99)), 4),
        "worst_ms": round(max(durations), 4),
    }
