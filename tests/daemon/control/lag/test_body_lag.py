"""The lag is found from motion, what is under way is known, and both are as they are defined."""

from itertools import pairwise

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from config.tasks.controllers import Broyden, TipFollowing
from config.tasks.trajectory import Circle
from daemon.control.lag import lag_kernels as kernels
from daemon.control.lag.body_lag import (
    DEAD_SHARES,
    LONGEST_S,
    BodyLag,
    Underway,
    parts,
)
from daemon.control.tip_following import TipFollower
from daemon.controllers.broyden import BroydenController
from drivers.pose import Vector
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import DT_S, PISTON_MM2, ROBOT, Followed, started
from tests.daemon.control.test_tip_following import seen

STEPS = 1600
FINE_S = 2e-4
GENERATOR = np.random.default_rng(5)


def wandering() -> Vector:
    """(n, 3) mm told, at up to some 30 mm/s, never the same way for long."""
    t_s = DT_S * np.arange(STEPS)
    phases = np.array([0.0, 1.0, 2.0])
    slow = 20.0 * np.sin(0.5 * t_s[:, None] + phases)
    return np.asarray(slow + 6.0 * np.sin(1.7 * t_s[:, None] + 2.0 * phases))


def circle(speed_mm_s: float = 20.0) -> Vector:
    angle = speed_mm_s / 30.0 * DT_S * np.arange(STEPS)
    return 30.0 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)


def late(told: Vector, dead_s: float, lag_s: float) -> Vector:
    """(n, 3) what comes out of a dead time and a first-order lag."""
    shift = round(dead_s / DT_S)
    due = np.concatenate([np.tile(told[:1], (shift, 1)), told])[: len(told)]
    out, kept = [told[0]], np.exp(-DT_S / lag_s)
    for then, now in pairwise(due):
        behind = lag_s / DT_S * (now - then)  # of what goes in evenly
        out.append(now - behind + kept * (out[-1] - then + behind))
    return np.array(out)


def found(told: Vector, tip: Vector, noise_mm: float = 0.1, begin_s: float = 0.0) -> BodyLag:
    lag = BodyLag(begin_s)
    noisy = tip + noise_mm * np.random.default_rng(1).normal(size=tip.shape)
    for k in range(len(told)):
        lag.add(k * DT_S, DT_S, told[k], noisy[k])
    return lag


def test_what_has_settled_is_kept_and_gains_are_found_further_on() -> None:
    lag = found(wandering(), late(0.5 * wandering(), 0.1, 0.2))
    assert lag.settle()
    settled_s = lag.lag_s
    assert settled_s == pytest.approx(0.3, abs=0.05)
    np.testing.assert_array_equal(lag.gains, np.ones(3))
    lag.break_off()
    told, tip = circle(), late(0.8 * circle(), 0.35, 0.65)
    for k in range(len(told)):
        lag.add(k * DT_S, DT_S, told[k], tip[k])
    assert lag.lag_s == settled_s
    assert (lag.gains[:2] < 0.95).all()


def test_a_path_that_has_a_lag_shorter_is_right() -> None:
    """Play looks like lag where motions are small."""
    lag = found(wandering(), late(wandering(), 0.1, 0.3))
    assert lag.settle()
    assert lag.lag_s > 0.36
    lag.break_off()
    told, tip = circle(), late(0.9 * circle(), 0.1, 0.1)
    for k in range(len(told)):
        lag.add(k * DT_S, DT_S, told[k], tip[k])
    assert lag.lag_s == pytest.approx(0.2, abs=0.08)


def test_who_has_seen_nothing_goes_on_looking() -> None:
    lag = BodyLag(0.1)
    assert not lag.settle()
    assert lag.lag_s == 0.1
    told = wandering()
    tip = late(told, 0.2, 0.4)
    for k in range(len(told)):
        lag.add(k * DT_S, DT_S, told[k], tip[k])
    assert lag.lag_s == pytest.approx(0.6, abs=0.08)


def test_as_late_as_other_motions_have_told_it_is_looked_for_with_that_dead_time() -> None:
    lag = BodyLag(0.1)
    lag.take_for(0.6, 0.6)
    assert (lag.lag_s, lag.dead_share) == (0.6, 0.6)
    told, tip = wandering(), late(wandering(), 0.48, 0.32)
    for k in range(len(told)):
        lag.add(k * DT_S, DT_S, told[k], tip[k])
    assert lag.lag_s == pytest.approx(0.8, abs=0.06)
    assert lag.dead_share == 0.6


@pytest.mark.parametrize(
    ("dead_s", "lag_s"), [(0.0, 0.1), (0.05, 0.1), (0.25, 0.5), (0.1, 0.5), (0.25, 1.0)]
)
@pytest.mark.parametrize("path", [wandering, circle])
def test_the_sum_of_dead_time_and_lag_is_found(dead_s: float, lag_s: float, path: object) -> None:
    told = wandering() if path is wandering else circle()
    lag = found(told, late(told, dead_s, lag_s))
    # Where dead time has another share than is taken for given, it is another sum that fits.
    assert lag.lag_s == pytest.approx(dead_s + lag_s, rel=0.2, abs=0.09)


def steps() -> Vector:
    """(n, 3) mm told: out, across and back in each direction, at rest between."""
    told, wait = np.zeros((STEPS, 3)), round(0.8 / DT_S)
    for k in range(9):
        told[(k + 1) * wait : (k + 2) * wait, k // 3] = (5.0, -5.0, 0.0)[k % 3]
    return told[: 11 * wait]


def settled(tip: Vector, noise_mm: float = 0.1) -> BodyLag:
    """As such steps tell it that made the tip go to (n, 3)."""
    noisy = tip + noise_mm * np.random.default_rng(1).normal(size=tip.shape)
    lag = BodyLag(dead_shares=DEAD_SHARES)
    for k, told in enumerate(steps()):
        lag.add(k * DT_S, DT_S, told, noisy[k])
    assert lag.settle()
    return lag


@pytest.mark.parametrize(
    ("dead_s", "lag_s"),
    [
        (0.25, 0.05),
        (0.2, 0.15),
        (0.2, 0.4),
        (0.2, 0.7),
        (0.05, 0.3),
        (0.05, 0.7),
        (0.1, 0.6),
        (0.12, 0.9),
    ],
)
def test_steps_tell_dead_time_and_lag_from_each_other(dead_s: float, lag_s: float) -> None:
    lag = settled(1.2 * late(steps(), dead_s, lag_s))
    assert lag.lag_s == pytest.approx(dead_s + lag_s, rel=0.1, abs=0.03)
    assert lag.dead_share * lag.lag_s == pytest.approx(dead_s, abs=0.15 * lag.lag_s + 0.02)


def test_creep_does_not_make_a_dead_time_look_like_a_longer_lag() -> None:
    # 0.15 of a lag of 1.0 s leaves 3 % less than 0.25 of one of 0.77 s does here.
    at_once = late(steps(), 0.175, 0.6)
    lag = settled(0.7 * at_once + 0.3 * late(at_once, 0.0, 3.0))
    assert lag.lag_s == pytest.approx(0.775, rel=0.1)


def test_a_tip_that_is_at_once_where_it_is_told_to_be_has_no_lag() -> None:
    assert settled(steps(), noise_mm=0.0).lag_s == 0.0


def test_a_jacobian_that_is_off_by_gains_does_not_hide_the_lag() -> None:
    told = wandering()
    gains = np.array([1.5, 0.7, 1.2])
    lag = found(told, gains * late(told, 0.25, 0.5))
    assert lag.lag_s == pytest.approx(0.75, abs=0.12)
    np.testing.assert_allclose(lag.gains, gains, rtol=0.15)  # drawn together a little


def test_what_is_no_answer_to_what_was_told_changes_nothing() -> None:
    told = wandering()
    pushed = np.cumsum(GENERATOR.normal(size=told.shape), axis=0)
    assert found(told, pushed, begin_s=0.1).lag_s == 0.1
    rest = np.zeros_like(told)
    assert found(rest, rest, begin_s=0.1).lag_s == 0.1
    even = np.linspace(0.0, 800.0, STEPS)[:, None] * np.ones(3)  # any lag explains it
    assert found(even, even, begin_s=0.1).lag_s == 0.1


def test_the_lag_stays_within_what_is_looked_for() -> None:
    told = wandering()
    assert 0.0 <= found(told, late(told, 3.0, 1.0)).lag_s <= LONGEST_S
    assert found(told, told).lag_s < 0.05


def test_what_was_told_has_arrived_after_a_while_and_not_before_the_dead_time() -> None:
    underway, lag_s = Underway(), 0.8
    dead_s, first_order_s = parts(lag_s)
    underway.tell(0.0, DT_S, np.zeros(3), lag_s)
    underway.tell(DT_S, DT_S, np.array([2.0, 0.0, 0.0]), lag_s)
    left = []
    for k in range(2, 200):
        underway.tell(k * DT_S, DT_S, np.zeros(3), lag_s)
        left.append(underway.left_mm[0])
    times = DT_S * np.arange(1, 199)
    before = times < dead_s - DT_S
    np.testing.assert_allclose(np.array(left)[before], 2.0)
    expected = 2.0 * np.exp(-(times - dead_s) / first_order_s)
    after = times > dead_s + DT_S
    np.testing.assert_allclose(np.array(left)[after], expected[after], atol=0.13)
    underway.begin()
    assert (underway.left_mm == 0.0).all()


def test_without_a_lag_leading_is_the_plain_law() -> None:
    observation = seen(
        reference_mm=np.array([1.0, 2.0, 181.0]), reference_velocity_mm_s=np.array([4.0, 0.0, 1.0])
    )
    plain = TipFollower(TipFollowing(), ROBOT).tip_step(observation)
    leading = TipFollower(TipFollowing(lead=True), ROBOT).tip_step(observation)
    np.testing.assert_allclose(leading, plain, atol=1e-12)


def followed(body: str, lead: bool, speed_mm_s: float, monkeypatch: pytest.MonkeyPatch) -> Followed:
    """The last cycle but one of a circle of 30 mm radius."""
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", "body": body})
    monkeypatch.setattr(closed_loop, "soft_arm", lambda _: SoftArm(plant, [PISTON_MM2] * 6))
    controller = BroydenController(Broyden(kind="broyden", lead=lead), ROBOT)
    loop = started(controller, np.array([30.0, 0.0, 185.0]))
    options = Circle(
        kind="circle",
        center_mm=(0.0, 0.0, 185.0),
        radius_mm=30.0,
        cycle_s=60.0 * np.pi / speed_mm_s,
        cycles=2,
    )
    return loop.follow(options)


def test_a_slow_body_is_followed_that_is_lost_without_leading(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert followed("slow", False, 5.0, monkeypatch).mean_mm > 20.0
    led = followed("slow", True, 5.0, monkeypatch)
    assert led.mean_mm < 2.5
    assert led.errors_mm[len(led.errors_mm) // 2 :].mean() < 1.6


def test_leading_does_not_harm_a_body_that_is_not_slow(monkeypatch: pytest.MonkeyPatch) -> None:
    plain, led = (followed("as_made", lead, 20.0, monkeypatch) for lead in (False, True))
    assert led.mean_mm < 1.15 * plain.mean_mm


def arrived_by_hand(times: Vector, told: Vector, dead_s: float, first_order_s: float) -> Vector:
    """(n, 3) what has arrived, from the first row on, by fine steps."""
    fine_s = np.arange(times[0], times[-1] + FINE_S, FINE_S)
    due = np.stack([np.interp(fine_s - dead_s, times, axis) for axis in told.T], axis=1)
    share = 1.0 - np.exp(-FINE_S / first_order_s)
    for k in range(1, len(due)):
        due[k] = due[k - 1] + share * (due[k] - due[k - 1])
    return np.stack([np.interp(times, fine_s, axis) for axis in due.T], axis=1)


def test_what_arrives_is_what_was_told_a_dead_time_ago_through_a_first_order_lag() -> None:
    random = np.random.default_rng(5)
    times = np.cumsum(random.uniform(0.01, 0.06, 90))
    told = np.cumsum(np.cumsum(random.normal(0.0, 0.1, (90, 3)), axis=0), axis=0)
    dead_s, first_order_s = np.array([0.0, 0.11, 0.4, 5.0]), np.array([1e-9, 0.2, 0.3, 0.5])
    arrived = np.tile(told[:, None, :], (1, 4, 1))
    for k in range(1, 90):
        upto = slice(0, k + 1)
        kernels.arrive(times[upto], told[upto], arrived[upto], dead_s, first_order_s)
    for row in range(4):
        expected = arrived_by_hand(times, told, dead_s[row], first_order_s[row])
        assert np.allclose(arrived[:, row], expected, atol=0.1)


def test_only_a_motion_is_added_to_what_the_motions_told() -> None:
    random = np.random.default_rng(6)
    arrived, tips = random.normal(size=(8, 2, 3)), random.normal(size=(8, 3))
    sums, gain_sums = np.ones((3, 2, 3)), np.ones((2, 2, 3))
    kept = np.array([0.5, 0.25])
    assert not kernels.add_span(2, arrived, tips, sums, gain_sums, kept, 3.0, 50.0)
    assert (sums == 1.0).all()
    assert (gain_sums == 1.0).all()
    assert kernels.add_span(2, arrived, tips, sums, gain_sums, kept, 3.0, 0.1)
    x, y = arrived[-1] - arrived[2], tips[-1] - tips[2]
    assert np.allclose(sums, 0.5 + 3.0 * np.array([x * x, x * y, np.tile(y * y, (2, 1))]))
    assert np.allclose(gain_sums, 0.25 + 3.0 * np.array([x * x, x * y]))


def test_a_lag_is_known_after_minutes_as_after_seconds() -> None:
    """What is kept of the last seconds is moved on in its arrays, and does not grow."""
    lag, told, waiting = BodyLag(), np.zeros(3), []
    for k in range(6000):
        told = told + 0.5 * np.array([np.cos(0.02 * k), np.sin(0.031 * k), 0.2])
        waiting.append(told)
        tip = waiting[max(k - 12, 0)]
        lag.add(0.025 * k, 0.025, told, tip)
    assert abs(lag.lag_s - 0.3) < 0.05
