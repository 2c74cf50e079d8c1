"""The properties that make a Prandtl-Ishlinskii operator one."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.plants.soft_arm.hysteresis import StopOperators

STIFFNESS = np.array([[0.3, 0.2, 0.1]])
THRESHOLD = np.array([0.5, 1.0, 2.0])

turning_points = st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=12)


def at_rest() -> StopOperators:
    return StopOperators(STIFFNESS, THRESHOLD, np.zeros((1, 3)))


def moved(operators: StopOperators, path: Sequence[float]) -> StopOperators:
    for place in path:
        operators = operators.after(np.array([place]))
    return operators


def force(operators: StopOperators, place: float) -> float:
    return float(operators.force(np.array([place]))[0][0])


@given(turning_points)
def test_only_the_turning_points_count_not_how_fast_or_finely_they_are_reached(
    path: list[float],
) -> None:
    fine = [a + t * (b - a) for a, b in pairwise([0.0, *path]) for t in (0.1, 0.35, 0.8, 1.0)]
    coarse, finely = moved(at_rest(), path), moved(at_rest(), fine)
    np.testing.assert_allclose(coarse.slider_mm, finely.slider_mm, atol=1e-12)


@given(turning_points, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_an_inner_loop_is_forgotten_when_it_closes(path: list[float], a: float, b: float) -> None:
    """Return-point memory: back at the point where it left the outer branch, it goes on as if it
    had not left."""
    top = max([0.0, *path]) + 3.0
    outer = moved(at_rest(), [*path, top])
    inside, further = sorted([top - abs(a), top - abs(b)])
    looped = moved(outer, [inside, further, top])
    np.testing.assert_allclose(looped.slider_mm, outer.slider_mm, atol=1e-12)


@given(turning_points)
def test_a_large_move_wipes_out_all_memory(path: list[float]) -> None:
    fresh, used = moved(at_rest(), [9.0]), moved(at_rest(), [*path, 9.0])
    np.testing.assert_allclose(used.slider_mm, fresh.slider_mm)


@given(turning_points)
def test_no_closed_loop_gives_work_away(path: list[float]) -> None:
    operators, work, here = moved(at_rest(), path), 0.0, path[-1]
    start = operators
    for corner in (*path, path[-1]):
        for place in np.linspace(here, corner, 40)[1:]:
            mean = 0.5 * (force(operators, here) + force(operators, place))
            work += mean * (place - here)
            operators, here = operators.after(np.array([place])), place
    stored = [0.5 * (STIFFNESS * (path[-1] - o.slider_mm) ** 2).sum() for o in (start, operators)]
    assert work >= stored[1] - stored[0] - 1e-2


def test_stiff_after_a_reversal_and_slack_once_every_slider_slips() -> None:
    slopes = [float(moved(at_rest(), [9.0]).force(np.array([place]))[1][0]) for place in (8.5, 0.0)]
    assert slopes == pytest.approx([STIFFNESS.sum(), 0.0])
    assert at_rest().sticking() == pytest.approx(STIFFNESS.sum())


def test_the_force_is_bounded_by_what_the_sliders_hold() -> None:
    most = float(STIFFNESS[0] @ THRESHOLD)
    assert force(at_rest(), 100.0) == pytest.approx(most)
    assert force(at_rest(), -100.0) == pytest.approx(-most)


@given(turning_points, st.floats(-5.0, 5.0))
def test_force_and_slope_belong_together(path: list[float], place: float) -> None:
    operators = moved(at_rest(), path)
    slope = float(operators.force(np.array([place]))[1][0])
    above, below = force(operators, place + 1e-6), force(operators, place - 1e-6)
    between = (above - below) / 2e-6
    assert 0.0 <= slope <= STIFFNESS.sum() + 1e-12
    kink = np.isclose(np.abs(place - operators.slider_mm), THRESHOLD, atol=1e-5).any()
    assert kink or slope == pytest.approx(between, abs=1e-6)
