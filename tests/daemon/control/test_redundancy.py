"""How redundant axes are resolved where options leave it open."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from config.loader import load_robot
from config.robot import Robot
from config.tasks.controllers import TipFollowing
from daemon.control.controller import ControllerError
from daemon.control.redundancy import Redundancy, TensionKeeping, damped_solution
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS

BENDS_MM, LENGTHENS_MM = 280.0, 14.0


@cache
def robot(name: str) -> Robot:
    return load_robot(SHIPPED_ROBOTS / f"{name}.yaml").robot


def redundancy(name: str, **options: object) -> Redundancy:
    return Redundancy(TipFollowing.model_validate(options), AxisRanges.of(robot(name)))


def jacobian(of: Redundancy) -> Vector:
    """(3, m) of a body that all axes bend, and that they hardly lengthen together."""
    waves = np.linspace(0.0, 2.0 * np.pi, of.unit.size, endpoint=False)
    rows = np.stack([np.cos(waves), np.sin(waves), np.ones(waves.size)])
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    return np.asarray(np.array([[BENDS_MM], [BENDS_MM], [LENGTHENS_MM]]) * rows / of.unit)


@pytest.mark.parametrize("name", ["tendon_arm", "three_tendon_arm"])
def test_what_only_all_tendons_together_would_do_is_not_asked_of_them(name: str) -> None:
    tendons = redundancy(name)
    scaled = jacobian(tendons) * tendons.unit
    damping_mm = tendons.damping_mm(jacobian(tendons))
    bent = damped_solution(scaled, np.array([1.0, 0.0, 0.0]), damping_mm)
    lengthened = damped_solution(scaled, np.array([0.0, 0.0, 1.0]), damping_mm)
    np.testing.assert_allclose(scaled @ bent, [1.0, 0.0, 0.0], atol=1e-9)
    assert np.linalg.norm(lengthened) < np.linalg.norm(bent)
    assert tendons.posture_gain_per_s == 1.0


def test_other_axes_may_all_go_together() -> None:
    arm = redundancy("soft_arm")
    scaled = jacobian(arm) * arm.unit
    lengthened = damped_solution(scaled, np.array([0.0, 0.0, 1.0]), arm.damping_mm(jacobian(arm)))
    np.testing.assert_allclose(scaled @ lengthened, [0.0, 0.0, 1.0], atol=1e-9)
    assert arm.posture_gain_per_s == 0.1


def test_what_options_say_counts_for_tendons_too() -> None:
    stated = redundancy("tendon_arm", damping_mm=3.0, posture_gain_per_s=0.0)
    assert stated.damping_mm(jacobian(stated)) == 3.0
    assert stated.posture_gain_per_s == 0.0


def test_weights_for_another_robot_are_refused() -> None:
    with pytest.raises(ControllerError, match="axis_weights are 2, and the robot has 6 axes"):
        redundancy("soft_arm", axis_weights=[1.0, 2.0])


LOWEST_N, HIGHEST_N, SPARED_N, STEP_S = 0.1, 9.7, 0.48, 0.025
"""Of the tendon arm's straight tendons."""
FASTEST_MM = 5.0 * STEP_S
MOST_MM = 10.0


def keeping(tensions_n: list[float]) -> TensionKeeping:
    """Of the tendon arm, whose tensions are these."""
    arm = robot("tendon_arm")
    one = TensionKeeping(arm, AxisRanges.of(arm))
    one.see(np.array(tensions_n), STEP_S)
    return one


def bounds(tensions_n: list[float], most_mm: float = MOST_MM) -> tuple[Vector, Vector]:
    return keeping(tensions_n).bounds(np.full(4, -most_mm), np.full(4, most_mm))


def evened(step_mm: list[float], tensions_n: list[float]) -> Vector:
    return keeping(tensions_n).evened(np.array(step_mm))


STEP_MM = [0.01, -0.12, 0.1, -0.12]


def test_tendons_as_tight_as_they_should_be_go_as_they_are_led() -> None:
    tensions_n = [1.2, 8.0, 3.0, 4.0]
    np.testing.assert_array_equal(bounds(tensions_n), np.outer([-MOST_MM, MOST_MM], np.ones(4)))
    np.testing.assert_array_equal(evened(STEP_MM, tensions_n), STEP_MM)


def test_a_nearly_slack_tendon_is_not_let_go_of() -> None:
    lowest, highest = bounds([LOWEST_N + SPARED_N, 3.0, 3.0, 3.0])
    np.testing.assert_allclose(lowest, [0.0, -MOST_MM, -MOST_MM, -MOST_MM], atol=1e-12)
    np.testing.assert_allclose(highest, MOST_MM)


def test_a_tendon_that_gets_slack_is_let_go_of_ever_more_slowly() -> None:
    lowest, _ = bounds([LOWEST_N + 1.25 * SPARED_N, 3.0, 3.0, 3.0])
    np.testing.assert_allclose(lowest[0], -0.25 * FASTEST_MM)


def test_all_are_pulled_together_where_one_is_slack_whatever_the_tip_asks_of_them() -> None:
    tight = evened(STEP_MM, [LOWEST_N, 3.0, 3.0, 3.0])
    np.testing.assert_allclose(np.diff(tight), np.diff(STEP_MM), atol=1e-12)
    np.testing.assert_allclose(tight.mean(), 0.2 * FASTEST_MM)


def test_together_they_are_not_let_go_of_where_one_would_get_slack() -> None:
    tight = evened([-0.1, -0.1, -0.1, -0.1], [LOWEST_N + SPARED_N, 3.0, 3.0, 3.0])
    np.testing.assert_allclose(tight, 0.0, atol=1e-12)


def test_a_nearly_torn_tendon_is_pulled_no_further_even_where_another_one_is_slack() -> None:
    tensions_n = [0.0, HIGHEST_N - SPARED_N, 3.0, 3.0]
    lowest, highest = bounds(tensions_n)
    np.testing.assert_allclose(highest, [MOST_MM, 0.0, MOST_MM, MOST_MM], atol=1e-12)
    np.testing.assert_allclose(lowest, [0.0, -MOST_MM, -MOST_MM, -MOST_MM], atol=1e-12)
    together = [0.1, 0.1, 0.1, 0.1]
    np.testing.assert_allclose(evened(together, tensions_n), 0.0, atol=1e-12)


def test_where_a_tension_is_not_known_nothing_is_done_about_it() -> None:
    lowest, highest = bounds([np.nan, 3.0, 3.0, 3.0])
    assert (lowest[0], highest[0]) == (-MOST_MM, MOST_MM)
    np.testing.assert_array_equal(evened(STEP_MM, [np.nan, 3.0, 3.0, 3.0]), STEP_MM)


def test_an_exploration_bends_the_body_as_it_would_with_all_tendons_tighter() -> None:
    one = keeping([LOWEST_N + SPARED_N, 3.0, 3.0, 3.0])
    step_mm = np.array([-0.1, 0.05, 0.05, 0.0])
    np.testing.assert_allclose(one.tightened(step_mm), step_mm + 0.1, atol=1e-12)
    np.testing.assert_array_equal(keeping([3.0] * 4).tightened(step_mm), step_mm)


def test_a_tension_that_falls_counts_as_it_will_be_when_all_that_was_told_has_arrived() -> None:
    one = keeping([3.0] * 4)
    for falls_n in np.arange(0.05, 1.0, 0.05):  # 2 N/s
        one.see(np.array([3.0 - falls_n, 3.0, 3.0, 3.0]), STEP_S, late_s=1.0)
    np.testing.assert_allclose(one.ahead(1.0)[0], 2.05 - 2.0, atol=0.1)
    lowest, _ = one.bounds(np.full(4, -MOST_MM), np.full(4, MOST_MM))
    np.testing.assert_allclose(lowest, [0.0, -MOST_MM, -MOST_MM, -MOST_MM])
    one.begin()
    one.see(np.array([2.05, 3.0, 3.0, 3.0]), STEP_S, late_s=1.0)
    np.testing.assert_array_equal(one.ahead(1.0), [2.05, 3.0, 3.0, 3.0])


@pytest.mark.parametrize("tensions_n", [None, np.full(4, np.nan)])
def test_what_was_known_of_tensions_once_counts_no_more_where_nobody_knows(
    tensions_n: Vector | None,
) -> None:
    one, step_mm = keeping([LOWEST_N, 3.0, 3.0, 3.0]), np.array(STEP_MM)
    one.see(tensions_n, STEP_S)
    np.testing.assert_array_equal(one.evened(step_mm), step_mm)
    np.testing.assert_array_equal(one.tightened(step_mm), step_mm)
    same = one.bounds(np.full(4, -MOST_MM), np.full(4, MOST_MM))
    np.testing.assert_array_equal(same, np.outer([-MOST_MM, MOST_MM], np.ones(4)))


@pytest.mark.parametrize("tension_n", [0.0, LOWEST_N + SPARED_N, 3.0, 20.0])
def test_a_step_that_takes_no_time_is_a_number(tension_n: float) -> None:
    one, still = keeping([3.0] * 4), np.zeros(4)
    one.see(np.array([tension_n, 3.0, 3.0, 3.0]), 0.0)
    for step in (one.evened(still), one.tightened(still), *one.bounds(still - 1.0, still + 1.0)):
        assert np.isfinite(step).all()


def test_what_an_axis_end_asks_of_a_tendon_comes_after_its_tension() -> None:
    torn = keeping([HIGHEST_N, 3.0, 3.0, 3.0])
    lowest, highest = torn.bounds(np.full(4, 0.05), np.full(4, MOST_MM))
    assert (lowest[0], highest[0]) == (0.0, 0.0)
    assert (lowest[1], highest[1]) == (0.05, MOST_MM)


TENSIONS_N = st.lists(st.floats(-1.0, 20.0), min_size=4, max_size=4)


@given(TENSIONS_N, st.floats(0.0, 10.0))
def test_standing_still_is_always_allowed_and_nothing_that_was_not(
    tensions_n: list[float], most_mm: float
) -> None:
    lowest, highest = bounds(tensions_n, most_mm)
    assert ((-most_mm <= lowest) & (lowest <= 0.0)).all()
    assert ((highest <= most_mm) & (highest >= 0.0)).all()


@given(TENSIONS_N, st.lists(st.floats(-0.2, 0.2), min_size=4, max_size=4))
def test_keeping_tendons_tight_bends_no_body_and_pulls_none_that_is_nearly_torn(
    tensions_n: list[float], step_mm: list[float]
) -> None:
    kept = evened(step_mm, tensions_n)
    np.testing.assert_allclose(np.diff(kept - step_mm), 0.0, atol=1e-12)
    slack = min(tensions_n) <= LOWEST_N + SPARED_N
    torn = max(tensions_n[:3]) >= HIGHEST_N - SPARED_N or tensions_n[3] >= 16.8 - SPARED_N
    if torn:
        assert kept.mean() <= 1e-12
    elif slack:
        assert kept.mean() >= -1e-12
