"""The law that all Jacobian controllers share."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from config.loader import load_robot
from config.tasks.controllers import TipFollowing
from daemon.control import jacobian_kernels as kernels
from daemon.control.controller import ControllerError, Observation, Phase
from daemon.control.redundancy import bounded_step, damped_solution
from daemon.control.tip_following import TipFollower
from daemon.learning.forward.stop_operators import HeldBack
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT

GENERATOR = np.random.default_rng(2)
JACOBIAN = GENERATOR.normal(size=(3, 6))
WIDE = np.full(6, 1e6)
NONE = np.zeros(6)


def seen(**changes: object) -> Observation:
    still = Observation(
        t_ns=0,
        dt_s=DT_S,
        u=np.full(6, 20.0),
        targets=np.full(6, 20.0),
        tip_mm=np.array([0.0, 0.0, 180.0]),
        tip_velocity_mm_s=np.zeros(3),
        reference_mm=np.array([0.0, 0.0, 180.0]),
        reference_velocity_mm_s=np.zeros(3),
    )
    return still._replace(**changes)  # type: ignore[arg-type]


def follower(**options: object) -> TipFollower:
    return TipFollower(TipFollowing.model_validate(options), ROBOT)


def test_the_tip_is_asked_to_move_with_the_reference_and_to_lose_its_error() -> None:
    law = follower(gain_per_s=4.0)
    velocity, error = np.array([3.0, 0.0, 0.0]), np.array([0.0, 2.0, 0.0])
    step = law.tip_step(seen(reference_velocity_mm_s=velocity, reference_mm=seen().tip_mm + error))
    np.testing.assert_allclose(step, [3.0 * DT_S, 2.0 * 4.0 * DT_S, 0.0])


def test_a_large_error_is_worked_off_at_a_limited_speed() -> None:
    law = follower(max_tip_speed_mm_s=20.0)
    step = law.tip_step(seen(reference_mm=np.array([300.0, 0.0, 580.0])))
    assert np.linalg.norm(step) == pytest.approx(20.0 * DT_S)
    assert step[0] == pytest.approx(step[2] * 300.0 / 400.0)


@pytest.mark.parametrize("dt_s", [3.0, 1e9])
def test_a_late_step_does_not_make_the_tip_leap(dt_s: float) -> None:
    law = follower(max_tip_speed_mm_s=20.0)
    step = law.tip_step(seen(reference_mm=np.array([300.0, 0.0, 580.0]), dt_s=dt_s))
    assert np.linalg.norm(step) <= 20.0 * 0.2 * (1 + 1e-9)


def test_no_axis_is_asked_to_be_faster_than_it_can_and_the_tip_comes_as_near_as_it_can() -> None:
    law = follower(max_tip_speed_mm_s=1000.0, posture_gain_per_s=0.0, damping_mm=1e-6)
    wanted, most = np.array([20.0, 10.0, 5.0]), 10.0 * DT_S
    step = law.axis_step(JACOBIAN, wanted, seen())
    assert np.abs(step).max() == pytest.approx(most)
    others = np.random.default_rng(4).uniform(-most, most, size=(20_000, 6))
    others[10_000:] = np.clip(step + 0.1 * others[10_000:], -most, most)
    missed_mm = np.linalg.norm(wanted - others @ JACOBIAN.T, axis=1)
    assert np.linalg.norm(wanted - JACOBIAN @ step) <= missed_mm.min() + 1e-9


def test_what_one_axis_is_too_slow_for_the_others_take_over() -> None:
    law = follower(max_tip_speed_mm_s=1000.0, posture_gain_per_s=0.0, damping_mm=1e-6)
    slowly = law.axis_step(JACOBIAN, np.array([0.02, 0.01, 0.005]), seen())
    most = 10.0 * DT_S
    wanted = JACOBIAN @ slowly * (1.1 * most / np.abs(slowly).max())
    step = law.axis_step(JACOBIAN, wanted, seen())
    assert np.abs(step).max() <= most * (1.0 + 1e-12)
    np.testing.assert_allclose(JACOBIAN @ step, wanted, rtol=1e-6)


def test_redundant_axes_go_to_the_posture_and_the_tip_stays() -> None:
    law = follower(posture=[10.0, 10.0, 10.0, 30.0, 30.0, 30.0], posture_gain_per_s=1.0)
    targets = np.full(6, 20.0)
    for _ in range(1000):
        step = law.axis_step(JACOBIAN, np.zeros(3), seen(targets=targets))
        assert np.abs(JACOBIAN @ step).max() < 1e-3
        targets = targets + step
    posture = np.array([10.0, 10.0, 10.0, 30.0, 30.0, 30.0])
    left = posture - targets
    # What is left of the way is what only the tip's directions could make.
    null_space = np.linalg.svd(JACOBIAN)[2][3:]
    np.testing.assert_allclose(null_space @ left, 0.0, atol=1e-3)


def turned(law: TipFollower) -> Vector:
    """(6,) asked for, after all axes went up and turned round."""
    targets, step = np.full(6, 10.0), np.zeros(6)
    for k in range(80):
        targets = targets + (0.3 if k < 60 else -0.05)
        law.tip_step(seen(targets=targets, t_ns=round(k * DT_S * 1e9), believed=False))
        step = law.axis_step(JACOBIAN, np.array([0.05, 0.02, -0.03]), seen(targets=targets))
    return step


def test_axes_that_turned_go_further_where_the_body_holds_some_of_it_back() -> None:
    options = {"lead": True, "posture_gain_per_s": 0.0, "damping_mm": 1e-6}
    plain, knowing = follower(**options), follower(**options)
    knowing.expect_hysteresis(HeldBack(0.3, np.zeros(6), np.full(6, 50.0)))
    # All of a motion on sticks after a turn but for the least stop, which slipped meanwhile.
    ratio = turned(knowing) @ turned(plain) / (turned(plain) @ turned(plain))
    assert 1.1 < ratio < 1.4


@pytest.mark.parametrize("play_mm", [0.005, 0.25])
def test_an_axis_that_turns_is_asked_for_its_play_as_well(play_mm: float) -> None:
    options = {"lead": True, "posture_gain_per_s": 0.0, "damping_mm": 1e-6}
    plain, knowing = with_play(follower(**options), 0.0), with_play(follower(**options), play_mm)
    without, asked = turned(plain), turned(knowing)
    assert (without > 0.0).any() and (without < 0.0).any()
    # They went down at last, and are at that end of their play.
    lost = np.where(without > 0.0, np.minimum(2.0 * play_mm, 2.0 * without), 0.0)
    np.testing.assert_allclose(asked, without + lost, atol=1e-9)


def test_for_its_play_no_axis_is_asked_to_go_faster_than_it_may() -> None:
    law = with_play(follower(lead=True, max_tip_speed_mm_s=1e6), 0.25)
    turned(law)
    step = law.axis_step(JACOBIAN, np.array([5.0, 2.0, -3.0]), seen(targets=np.full(6, 20.0)))
    fastest = law.axes.max_velocity * DT_S
    assert (np.abs(step) <= fastest).all()
    assert (step == fastest).any()


def with_play(law: TipFollower, play_mm: float) -> TipFollower:
    law.expect_hysteresis(HeldBack(None, np.zeros(6), np.full(6, 50.0)))
    assert law._hysteresis is not None
    law._hysteresis._play.share = play_mm / 50.0
    return law


def test_hysteresis_counts_only_where_the_body_is_led() -> None:
    law = follower(posture_gain_per_s=0.0)
    before = turned(law)
    law.expect_hysteresis(HeldBack(0.3, np.zeros(6), np.full(6, 50.0)))
    np.testing.assert_array_equal(turned(law), before)
    np.testing.assert_array_equal(law.free(np.ones(6)), np.ones(6))


@pytest.mark.parametrize(
    ("options", "times"),
    [
        ({"lead": True}, 4.0),
        ({"lead": True, "by_cycles": False}, 4.0),
        ({"lead": False}, 1.0),
        ({"lead": True, "posture_gain_per_s": 0.2}, 2.0),
        ({"lead": True, "posture_gain_per_s": 1.0}, 1.0),
    ],
)
def test_the_posture_draws_harder_where_a_body_is_led(
    options: dict[str, object], times: float
) -> None:
    plainly = follower(posture=[10.0] * 6, **{**options, "lead": False})
    law = follower(posture=[10.0] * 6, **options)
    freely, led = (one.axis_step(JACOBIAN, np.zeros(3), seen()) for one in (plainly, law))
    assert np.abs(freely).max() > 0.0
    np.testing.assert_allclose(led, times * freely, atol=1e-9)


def on_the_way(law: TipFollower, targets: Vector, lag_s: float = 0.8) -> Vector:
    """(m,) shares of their speed with which axes go that are told to leave the tip where it is."""
    law.leading.lag.lag_s = lag_s
    there = seen(targets=targets, ahead=lambda _: (np.zeros(3), np.zeros(3)))
    step = law.axis_step(JACOBIAN, np.zeros(3), there)
    return np.asarray(step / (law.axes.max_velocity * DT_S))


def test_on_the_way_to_a_path_a_late_bodys_axes_leave_their_ends() -> None:
    options = {"lead": True, "probe": False, "posture": [25.0] * 6, "posture_gain_per_s": 1e-9}
    targets = np.array([0.0, 2.5, 20.0, 20.0, 47.5, 50.0])
    speeds = on_the_way(follower(**options), targets)
    assert speeds[0] >= 0.5 - 1e-9
    assert speeds[1] >= 0.25 - 1e-9
    assert speeds[4] <= -0.25 + 1e-9
    assert speeds[5] <= -0.5 + 1e-9
    np.testing.assert_allclose(on_the_way(follower(**options), targets, lag_s=0.1), 0.0, atol=1e-6)
    alone = follower(**{**options, "posture_gain_per_s": 0.0})
    np.testing.assert_allclose(on_the_way(alone, targets), 0.0, atol=1e-9)


def test_on_a_path_a_late_bodys_axes_may_go_to_their_ends() -> None:
    law = follower(lead=True, probe=False, posture_gain_per_s=1e-9)
    law.leading.lag.lag_s = 0.8
    on_path = seen(targets=np.zeros(6), on_path=True, ahead=lambda _: (np.zeros(3),) * 2)
    np.testing.assert_allclose(law.axis_step(JACOBIAN, np.zeros(3), on_path), 0.0, atol=1e-6)


def test_axes_that_are_to_be_left_alone_are_left_alone_on_every_path() -> None:
    law = follower(posture=[10.0] * 6, posture_gain_per_s=0.0, lead=True)
    np.testing.assert_allclose(law.axis_step(JACOBIAN, np.zeros(3), seen()), 0.0)


def test_tubes_are_drawn_to_how_they_are_turned_against_each_other_and_not_all_together() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    law = TipFollower(TipFollowing.model_validate({"posture_gain_per_s": 1.0}), robot)
    turned = np.array([2.3, 2.0, 1.7, 5.0, -10.0])
    drawn = law.drawn(seen(u=turned, targets=turned))
    np.testing.assert_allclose(drawn / DT_S, [-0.3, 0.0, 0.3, -5.0, 0.0], atol=1e-9)


def test_on_a_path_tubes_are_drawn_to_how_they_were_turned_when_it_began() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    law = TipFollower(TipFollowing.model_validate({"posture_gain_per_s": 1.0}), robot)
    places = [np.array([turned, turned, turned, 0.0, -10.0]) for turned in (2.0, 2.5)]
    for targets, on_path, back in (
        (places[0], False, 0.0),
        (places[0], True, 0.0),
        (places[1], True, -0.5),
        (places[1], False, 0.0),
        (places[1], True, 0.0),
    ):
        drawn = law.drawn(seen(u=targets, targets=targets, on_path=on_path))
        np.testing.assert_allclose(drawn[:3] / DT_S, back, atol=1e-9)


def test_the_posture_may_be_the_one_at_the_start() -> None:
    law = follower(posture="start", posture_gain_per_s=1.0)
    here = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0])
    law.reset(seen(targets=here))
    np.testing.assert_allclose(law.axis_step(JACOBIAN, np.zeros(3), seen(targets=here)), 0.0)


def test_a_posture_must_have_one_position_per_axis() -> None:
    with pytest.raises(ControllerError, match="posture has 2 positions, and the robot 6 axes"):
        follower(posture=[1.0, 2.0])


def test_an_axis_at_its_end_stays_there_and_the_others_take_over() -> None:
    law = follower(posture_gain_per_s=0.0, damping_mm=1e-6)
    targets = np.full(6, 20.0)
    free = law.axis_step(JACOBIAN, np.array([0.05, 0.02, 0.03]), seen(targets=targets))
    worst = int(np.argmax(np.abs(free)))
    targets[worst] = 50.0 if free[worst] > 0 else 0.0
    held = law.axis_step(JACOBIAN, np.array([0.05, 0.02, 0.03]), seen(targets=targets))
    assert held[worst] == 0.0
    np.testing.assert_allclose(JACOBIAN @ held, [0.05, 0.02, 0.03], atol=1e-6)


def test_a_jacobian_that_is_not_finite_is_an_error_and_no_step() -> None:
    broken = JACOBIAN.copy()
    broken[1, 2] = np.nan
    with pytest.raises(ControllerError, match="learn it anew"):
        follower().axis_step(broken, np.ones(3), seen())


def test_a_tip_that_is_not_a_number_is_an_error_and_no_step() -> None:
    with pytest.raises(ControllerError, match="not a number"):
        follower().tip_step(seen(tip_mm=np.array([0.0, np.nan, 0.0])))


def test_where_a_body_rests_is_seen_where_motion_begins_with_all_axes_at_zero() -> None:
    law = follower(lead=True, probe=False)
    bent, straight = np.array([20.0, 5.0, 180.0]), np.array([0.5, 0.0, 168.0])
    known = []
    for targets, tip_mm in (
        (np.array([20.0, 0.0, 0.0, 0.0, 0.0, 0.0]), bent),
        (np.full(6, 0.3), straight),
        (np.full(6, 20.0), bent),
    ):
        law.reset(seen(targets=targets, tip_mm=tip_mm))
        known.append(law.leading.load.rest_mm)
    assert known == [None, straight, straight]


def test_a_tip_that_is_not_a_number_teaches_a_path_that_is_repeated_nothing() -> None:
    law = follower(lead=True, probe=False)
    law.reset(seen())
    for k in range(240):
        now = seen(t_ns=round(k * DT_S * 1e9))._replace(phase=Phase(k * DT_S % 2.0, 2.0))
        if k == 90:
            with pytest.raises(ControllerError, match="not a number"):
                law.tip_step(now._replace(tip_mm=np.full(3, np.nan)))
        else:
            assert np.isfinite(law.tip_step(now)).all()


def test_without_limits_the_step_is_the_pseudo_inverse_with_a_null_space_part() -> None:
    wanted, drawn = np.array([1.0, -2.0, 0.5]), GENERATOR.normal(size=6)
    step = bounded_step(JACOBIAN, wanted, drawn, -WIDE, WIDE, 1e-9)
    inverse = np.linalg.pinv(JACOBIAN)
    expected = inverse @ wanted + (np.eye(6) - inverse @ JACOBIAN) @ drawn
    np.testing.assert_allclose(step, expected, atol=1e-9)


def test_a_direction_that_hardly_moves_is_given_up_gently() -> None:
    rows = np.linalg.qr(GENERATOR.normal(size=(6, 3)))[0].T
    jacobian = np.diag([100.0, 50.0, 0.01]) @ rows
    step = damped_solution(jacobian, np.array([1.0, 1.0, 1.0]), 5.0)
    np.testing.assert_allclose((jacobian @ step)[:2], [1.0, 1.0], rtol=1e-6)
    assert np.linalg.norm(step) < 0.1
    assert not damped_solution(np.zeros((3, 6)), np.ones(3), 5.0).any()


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    axes=st.integers(1, 9),
    reach=st.floats(1e-6, 10.0),
    room=st.floats(0.0, 1.0),
)
def test_a_step_is_finite_and_within_its_limits(
    seed: int, axes: int, reach: float, room: float
) -> None:
    generator = np.random.default_rng(seed)
    jacobian = generator.normal(size=(3, axes)) * 10.0 ** generator.integers(-3, 3)
    low, high = -room * generator.random(axes), room * generator.random(axes)
    step = bounded_step(
        jacobian, reach * generator.normal(size=3), generator.normal(size=axes), low, high, 5.0
    )
    assert np.isfinite(step).all()
    assert (low <= step).all()
    assert (step <= high).all()


@settings(max_examples=200, deadline=None)
@given(seed=st.integers(0, 10**6), axes=st.integers(1, 9), damping=st.floats(1e-2, 10.0))
def test_the_nearest_step_within_bounds_is_that_of_plain_bounded_least_squares(
    seed: int, axes: int, damping: float
) -> None:
    generator = np.random.default_rng(seed)
    jacobian = generator.normal(size=(3, axes)) * 10.0 ** generator.uniform(-2, 2, size=(3, 1))
    wanted = generator.normal(size=axes) * 10.0 ** generator.uniform(-2, 2)
    reach = 10.0 ** generator.uniform(-2, 1, size=(2, axes))
    low, high = -reach[0], reach[1]
    step = kernels.step_within(jacobian, wanted, low, high, damping)
    assert (low <= step).all()
    assert (step <= high).all()
    rows = np.concatenate([jacobian, damping * np.eye(axes)])
    plain = lsq_linear(rows, rows @ wanted, (low, high), method="bvls", tol=1e-14).x
    missed, least = (float(np.sum((rows @ (x - wanted)) ** 2)) for x in (step, plain))
    assert missed <= least * (1.0 + 1e-6) + 1e-9


def test_the_least_hurried_step_goes_as_far_with_axes_that_hurry_less() -> None:
    shortest = np.linalg.pinv(JACOBIAN) @ np.array([3.0, -2.0, 1.0])
    fastest = np.full(6, 0.5 * np.abs(shortest).max())
    bounds = kernels.StepBounds(NONE, -WIDE, WIDE)
    step = kernels.least_hurried_step(JACOBIAN, shortest, bounds, fastest, 1e-3)
    assert np.abs(step).max() < 0.95 * np.abs(shortest).max()
    made, wanted = JACOBIAN @ step, JACOBIAN @ shortest
    assert made @ wanted == pytest.approx(wanted @ wanted, rel=0.03)


def test_an_axis_outside_its_travel_may_come_back_and_not_go_further() -> None:
    axes = AxisRanges.of(ROBOT)
    lowest, highest = axes.step_range(np.array([-2.0, 52.0, 25.0, 0.0, 50.0, 1.0]))
    np.testing.assert_allclose(lowest, [0.0, -52.0, -25.0, 0.0, -50.0, -1.0])
    np.testing.assert_allclose(highest, [52.0, 0.0, 25.0, 50.0, 0.0, 49.0])


def plainly_damped(jacobian: Vector, wanted: Vector, damping: float) -> Vector:
    """By numpy's singular values."""
    left, values, right = np.linalg.svd(jacobian, full_matrices=False)
    grown = (np.maximum(1.0 - values / damping, 0.0) * damping) ** 2
    return np.asarray(right.T @ (values / (values**2 + grown + 1e-12) * (left.T @ wanted)))


def plainly_bounded(
    jacobian: Vector, wanted: Vector, drawn: Vector, lowest: Vector, highest: Vector, damping: float
) -> Vector:
    """One axis after the other is taken out, each time the one that is furthest beyond."""
    step, free = drawn.copy(), np.ones(len(drawn), dtype=bool)
    while free.any():
        missing = wanted - jacobian @ step
        trial = drawn[free] + plainly_damped(jacobian[:, free], missing, damping)
        beyond = np.maximum(lowest[free] - trial, trial - highest[free])
        if beyond.max() <= 0.0:
            step[free] = trial
            break
        index = np.flatnonzero(free)[beyond.argmax()]
        step[index] = np.clip(trial[beyond.argmax()], lowest[index], highest[index])
        free[index] = False
    return step


@pytest.mark.parametrize("seed", range(60))
def test_the_compiled_step_is_the_plain_one(seed: int) -> None:
    generator = np.random.default_rng(seed)
    axes = int(generator.integers(1, 9))
    jacobian = generator.normal(size=(3, axes)) * 10.0 ** generator.uniform(-2, 2, size=(3, 1))
    wanted, drawn = generator.normal(size=3), 0.3 * generator.normal(size=axes)
    damping = float(10.0 ** generator.uniform(-3, 2))
    np.testing.assert_allclose(
        damped_solution(jacobian, wanted, damping),
        plainly_damped(jacobian, wanted, damping),
        rtol=1e-6,
        atol=1e-9,
    )
    reach = 10.0 ** generator.uniform(-2, 2, size=axes)
    plain = plainly_bounded(jacobian, wanted, drawn, -reach, reach, damping)
    whole = jacobian @ (drawn + plainly_damped(jacobian, wanted - jacobian @ drawn, damping))
    left = float(np.sum((jacobian @ plain - whole) ** 2))
    for jacobians in (jacobian, np.asfortranarray(jacobian)):
        found = bounded_step(jacobians, wanted, drawn, -reach, reach, damping)
        assert (np.abs(found) <= reach).all()
        if left < 0.0009 * float(np.sum(whole**2)):
            np.testing.assert_allclose(found, plain, rtol=1e-6, atol=1e-9)
        else:
            assert np.sum((jacobian @ found - whole) ** 2) <= left * (1.0 + 1e-9)


def at_their_ends(seed: int) -> tuple[Vector, Vector, Vector, Vector]:
    """A Jacobian, a wanted motion, and bounds of six axes of which two stand at their lower ends
    and two at their upper ones."""
    generator = np.random.default_rng(seed)
    jacobian, wanted = 30.0 * generator.normal(size=(3, 6)), 0.5 * generator.normal(size=3)
    at_low, at_high = generator.permutation(np.repeat([[1, 0], [0, 1], [0, 0]], 2, axis=0)).T
    return jacobian, wanted, -1.0 * (at_low == 0), 1.0 * (at_high == 0)


HELD_IN_VAIN = [32, 80, 82, 92, 100, 134, 162, 249, 256]
"""Of the first 300, where the axes that are left alone make a twentieth less than could be made."""


@pytest.mark.parametrize("seed", [*range(20), *HELD_IN_VAIN])
def test_axes_at_their_ends_come_back_where_the_others_alone_cannot_move_the_tip(seed: int) -> None:
    jacobian, wanted, low, high = at_their_ends(seed)
    nearest = lsq_linear(jacobian, wanted, (low, high), method="bvls").x

    def lacking(step: Vector) -> float:
        missed, least = (np.linalg.norm(jacobian @ x - wanted) for x in (step, nearest))
        return float((missed - least) / np.linalg.norm(wanted))

    step = bounded_step(jacobian, wanted, NONE, low, high, 1.0)
    assert (low <= step).all()
    assert (step <= high).all()
    assert lacking(step) < 0.05
    held = bounded_step(jacobian, wanted, NONE, low, high, 1.0, lets_go=False)
    assert (lacking(held) > 0.05) == (seed in HELD_IN_VAIN)


@pytest.mark.parametrize("lag_s", [0.15, 0.6])
def test_across_a_long_lag_axes_that_were_set_to_their_ends_stay_there(lag_s: float) -> None:
    jacobian, wanted, low, high = at_their_ends(HELD_IN_VAIN[0])
    law = follower(lead=True, posture_gain_per_s=0.0, damping_mm=1.0)
    law.leading.lag.lag_s = lag_s
    targets = np.where(low == 0.0, law.axes.lowest, np.where(high == 0.0, law.axes.highest, 25.0))
    unit, little = law.redundancy.unit, 0.002 * wanted  # which no axis has to hurry for
    step = law.axis_step(jacobian / unit, little, seen(targets=targets)) / unit
    lowest, highest = law.axes.step_range(targets)
    lowest, highest, prompt = lowest / unit, highest / unit, lag_s < 0.2
    same = bounded_step(jacobian, little, NONE, lowest, highest, 1.0, prompt)
    other = bounded_step(jacobian, little, NONE, lowest, highest, 1.0, not prompt)
    np.testing.assert_allclose(step, same, atol=1e-9)
    assert np.abs(step - other).max() > 1e-4
