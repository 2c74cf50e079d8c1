"""Buckling: only stable equilibria come back, whatever the way to them."""

from functools import partial

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from sim_backends.plants.rod import Rod, Section, helix
from sim_backends.plants.rod_kernels import FloatArray, March
from sim_backends.plants.shooting import Equilibrium, Problem, Solver
from tests.sim_backends.plants.rods import (
    NO_FORCE,
    bare_rod,
    chamber_rod,
    equilibrium,
    problem,
    tip_mm,
)

LENGTH_MM, BENDING = 100.0, 1e4
SLENDER = Section(bending_n_mm2=BENDING, torsion_n_mm2=8e3, shear_n=1e6, axial_n=1e6)
CRITICAL_N = np.pi**2 * BENDING / (4 * LENGTH_MM**2)


def column(load_n: float) -> tuple[Rod, Problem, Equilibrium]:
    """A slender column, its problem under `load_n`, and its straight unloaded state."""
    rod = bare_rod(SLENDER, LENGTH_MM)
    loaded = problem(rod, [], [0.0, 0.0, -load_n])
    straight = Solver(rod).unloaded(loaded, np.zeros(0))
    assert straight is not None
    return rod, loaded, straight


def unstable_directions(load_n: float) -> int:
    rod, loaded, straight = column(load_n)
    held = rod.loaded(np.zeros((rod.intervals, 0)), loaded.force, rod.stiffness, rod.rest)
    march = rod.march(held, NO_FORCE, straight.march.strain)
    assert march is not None
    answer = rod.tangent(held, march, np.zeros((rod.intervals, 0)))
    assert answer is not None
    return answer[1]


@pytest.mark.parametrize(
    ("load", "directions"), [(0.5, 0), (0.98, 0), (1.02, 2), (8.5, 2), (9.5, 4), (26.0, 6)]
)
def test_a_round_column_turns_unstable_in_two_planes_at_each_critical_load(
    load: float, directions: int
) -> None:
    """Euler's loads of a cantilever are 1, 9, 25 ... times the first."""
    assert unstable_directions(load * CRITICAL_N) == directions


def test_its_own_weight_buckles_a_column_at_greenhills_height() -> None:
    rod = bare_rod(SLENDER, LENGTH_MM)
    critical = 7.8373 * BENDING / LENGTH_MM**2
    for share, leans in ((0.97, False), (1.05, True)):
        found = equilibrium(rod, [], NO_FORCE, [0.0, 0.0, -share * critical])
        assert (np.linalg.norm(tip_mm(found)[:2]) > 1.0) == leans


def elastica(load: float) -> FloatArray:
    """Tip of a slender cantilever under `load` times its critical load (Euler)."""
    k = brentq(lambda k: (2 * ellipk(k * k) / np.pi) ** 2 - load, 1e-9, 1 - 1e-9)
    whole = ellipk(k * k)
    height = LENGTH_MM * (2 * ellipe(k * k) / whole - 1)
    return np.array([2 * k * LENGTH_MM / whole, height])


@pytest.mark.parametrize("load", [1.05, 1.5, 3.0, 8.0])
def test_past_its_critical_load_a_column_ends_on_the_elastica(load: float) -> None:
    rod, loaded, straight = column(load * CRITICAL_N)
    ahead = np.zeros(3)
    found = Solver(rod).find(lambda t: problem(rod, [], t * -loaded.force[0]), straight, ahead)
    pressed = Solver(rod).find(lambda t: problem(rod, [], t * loaded.force[0]), straight, ahead)
    assert found is not None
    assert tip_mm(found)[:2] == pytest.approx([0.0, 0.0], abs=1e-9), "pulled, it stays straight"
    assert pressed is not None
    aside = np.linalg.norm(tip_mm(pressed)[:2])
    assert [aside, tip_mm(pressed)[2]] == pytest.approx(elastica(load), abs=0.02)


def test_the_straight_branch_is_refused_past_the_critical_load() -> None:
    for share, accepted in ((0.98, True), (1.03, False), (5.0, False)):
        rod, loaded, straight = column(share * CRITICAL_N)
        assert (Solver(rod).settle(loaded, straight) is not None) == accepted


def test_a_bent_column_stands_up_again_when_the_load_goes() -> None:
    rod, loaded, _ = column(2.0 * CRITICAL_N)
    bent = equilibrium(rod, [], [0.0, 0.0, -2.0 * CRITICAL_N])
    free = Solver(rod).find(
        lambda t: problem(rod, [], (1.0 - t) * loaded.force[0]), bent, np.zeros(3)
    )
    assert free is not None
    np.testing.assert_allclose(tip_mm(free), [0.0, 0.0, LENGTH_MM], atol=1e-6)


class Springs:
    """Routes held at their unloaded length by springs, N/mm."""

    def __init__(self, rod: Rod, stiffness: float) -> None:
        self._rod, self._stiffness = rod, stiffness

    def spread(self, pull_n: FloatArray) -> tuple[FloatArray, FloatArray]:
        return self._rod.presence * pull_n, self._rod.presence

    def imbalance(
        self, march: March, pull_n: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        each = np.eye(len(pull_n))
        pull = self._stiffness * (march.length_mm - LENGTH_MM)
        return pull_n - pull, -self._stiffness * each, each

    def holding(self, march: March) -> FloatArray:
        return np.diag(np.full(len(march.length_mm), np.sqrt(self._stiffness)))


def test_springs_on_the_routes_hold_a_column_that_alone_would_buckle() -> None:
    """Springs on three chambers add a moment 3/2 k r² θ(tip) everywhere, and θ'' = −λ² θ + const.

    With c = 3/2 k r² L / EI the critical load λ² EI solves cos λL + c sin λL / λL = 0.
    """
    stiffness, radius = 4.0, 5.0
    routes = [helix(radius, 2 * np.pi / 3 * i, 0.0, LENGTH_MM, chamber=True) for i in range(3)]
    rod = Rod(LENGTH_MM, SLENDER, routes, 40)
    c = 1.5 * stiffness * radius**2 * LENGTH_MM / BENDING
    phase = brentq(lambda x: np.cos(x) + c * np.sin(x) / x, 0.1, np.pi - 1e-9)
    critical = phase**2 * BENDING / LENGTH_MM**2
    assert critical > 1.3 * CRITICAL_N
    for share, stands in ((0.97, True), (1.04, False)):
        force = rod.internal_force(np.array([0.0, 0.0, -share * critical]), NO_FORCE)
        held = Problem(force, Springs(rod, stiffness), rod.stiffness, rod.rest)
        straight = Solver(rod).unloaded(held, np.zeros(3))
        assert straight is not None
        settled = Solver(rod).settle(held, straight)
        assert (settled is not None) == stands
        found = Solver(rod).raise_load(held, np.zeros(3), NO_FORCE)
        assert found is not None
        assert (np.linalg.norm(tip_mm(found)[:2]) < 1e-3) == stands


def test_a_long_way_is_taken_in_steps_and_leads_to_the_same_place() -> None:
    rod = chamber_rod(20)
    down = np.array([0.0, 0.0, -0.3])
    start = equilibrium(rod, [0.0] * 6, down)
    goal = np.array([-25.0, 0.0, 0.0, 0.0, -25.0, 0.0])
    jump = Solver(rod).find(lambda t: problem(rod, t * goal, down), start, np.zeros(9))
    here = start
    for step in range(1, 101):
        there = Solver(rod).settle(problem(rod, step / 100 * goal, down), here)
        assert there is not None
        here = there
    assert jump is not None
    np.testing.assert_allclose(tip_mm(jump), tip_mm(here), atol=1e-5)


def test_a_bent_strip_keeps_its_side_until_it_snaps_through() -> None:
    """Stiff across, it has two stable sides: a small pull to the other side does not turn it."""
    rod = Rod(LENGTH_MM, SLENDER, [helix(5.0, np.pi, 0.0, LENGTH_MM)], 40)
    strip = rod.stiffness * [1, 1, 1, 10, 1, 10]
    solver = Solver(rod)

    def pulled(pull: float) -> Problem:
        loaded = problem(rod, [pull], [0.0, 0.0, -1.3 * CRITICAL_N])
        return loaded._replace(stiffness=strip)

    def between(newtons: int, t: float) -> Problem:
        return pulled(max(0.0, newtons - 1.0 + t))

    here = solver.raise_load(pulled(0.0), np.zeros(1), np.array([1.0, 0.0, 0.0]))
    places = []
    for newtons in range(7):
        assert here is not None
        here = solver.find(partial(between, newtons), here, np.zeros(4))
        assert here is not None
        places.append(tip_mm(here)[0])
    np.testing.assert_array_equal(np.sign(places), [1, 1, 1, 1, -1, -1, -1])
    fresh = solver.raise_load(pulled(1.0), np.zeros(1), NO_FORCE)
    assert fresh is not None
    assert tip_mm(fresh)[0] < -50.0, "loaded afresh, it goes where it is pulled"


def test_none_where_there_is_no_equilibrium() -> None:
    rod = chamber_rod(20)
    start = equilibrium(rod, [0.0] * 6)
    crushing = problem(rod, [300.0] * 6)
    assert Solver(rod).find(lambda t: crushing, start, np.zeros(9)) is None
