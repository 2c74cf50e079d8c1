"""A late body is led, and slowed where it would be off too far."""

from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from config.tasks.trajectory import Star
from daemon.control.controller import Phase
from daemon.control.leading import Leading
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from tests.daemon.control.closed_loop import DT_S
from tests.daemon.control.leading.late_body import by_cycle, circle, loop_on, observed

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests


def led_through_a_corner(dead_s: float, first_order_s: float) -> tuple[Vector, Vector]:
    """Times from a right angle at 20 mm/s, and how far aside of its line a tip is then that is
    exactly so late; mm."""
    leading, corner_s = Leading(gain_per_s=7.0, by_cycles=False), 4.0
    leading.lag.lag_s = dead_s + first_order_s
    leading.lag.dead_share = dead_s / (dead_s + first_order_s)

    def at(t_s: float) -> tuple[Vector, Vector]:
        along, across = 20.0 * min(t_s, corner_s), 20.0 * max(t_s - corner_s, 0.0)
        velocity = np.array([20.0, 0.0, 0.0] if t_s < corner_s else [0.0, 20.0, 0.0])
        return np.array([along, across, 0.0]), velocity

    told = tip = at(0.0)[0]
    late, moved, aside = deque([told] * round(dead_s / DT_S)), np.zeros(3), []
    t_s = DT_S * np.arange(round(7.0 / DT_S))
    for now_s in t_s.tolist():
        observation = observed(now_s, tip, told, at)
        leading.take_stock(observation, DT_S, moved)
        moved = leading.step(observation, DT_S)
        told = told + moved
        late.append(told)
        tip = tip + (1.0 - np.exp(-DT_S / first_order_s)) * (late.popleft() - tip)
        aside.append(abs(tip[1]) if now_s < corner_s else abs(tip[0] - 20.0 * corner_s))
    return np.asarray(t_s - corner_s, dtype=np.float64), np.array(aside)


@pytest.mark.parametrize(("dead_s", "first_order_s"), [(0.25, 0.5), (0.1, 0.5), (0.5, 0.3)])
def test_a_tip_that_is_late_leaves_its_line_only_as_far_before_a_corner_as_that_is_rounded(
    dead_s: float, first_order_s: float
) -> None:
    t_s, aside = led_through_a_corner(dead_s, first_order_s)
    rounded_s = 0.65 * first_order_s + 0.1
    assert aside[np.abs(t_s) > rounded_s].max() < 0.45
    # What a parabola over the rounding leaves of 20 mm/s in each direction.
    assert aside.max() < 20.0 * 0.65 * first_order_s / 4.0 + 0.3


def led_round(radius_mm: float, dead_s: float, first_order_s: float) -> Vector:
    """How far off a tip at 30 mm/s is, step by step, that is exactly so late and is told evenly
    from step to step; mm."""
    leading, rate = Leading(gain_per_s=7.0, by_cycles=False), 30.0 / radius_mm
    leading.lag.take_for(dead_s + first_order_s, dead_s / (dead_s + first_order_s))

    def at(t_s: float) -> tuple[Vector, Vector]:
        there = radius_mm * np.array([np.cos(rate * t_s), np.sin(rate * t_s), 0.0])
        return there, rate * np.array([-there[1], there[0], 0.0])

    told = tip = at(0.0)[0]
    late, moved, off = deque([told] * round(dead_s / DT_S + 2)), np.zeros(3), []
    kept = np.exp(-DT_S / first_order_s)
    for now_s in (DT_S * np.arange(round(6.0 / DT_S))).tolist():
        leading.take_stock(observed(now_s, tip, told, at), DT_S, moved)
        moved = leading.step(observed(now_s, tip, told, at), DT_S)
        off.append(float(np.linalg.norm(at(now_s)[0] - tip)))
        told = told + moved
        late.append(told)
        late.popleft()
        behind = first_order_s / DT_S * (late[1] - late[0])
        tip = late[1] - behind + kept * (tip - late[0] + behind)
    return np.array(off)


@pytest.mark.parametrize(
    ("dead_s", "first_order_s"), [(0.05, 0.65), (0.25, 0.5), (0.3, 0.1), (0.05, 0.05)]
)
def test_a_tip_whose_lag_is_known_follows_a_narrow_circle(
    dead_s: float, first_order_s: float
) -> None:
    """Half a step that is counted wrongly, and a bend that is rounded like a corner, cost a
    millimetre here."""
    off_mm = led_round(14.0, dead_s, first_order_s)
    assert off_mm[len(off_mm) // 2 :].max() < 0.3


def led_through_play(half_mm: float, speed_mm_s: float, cycles: int, seed: int) -> list[float]:
    """The mean error of each cycle of a circle, of a tip 0.2 s late behind play in each direction,
    whose filter takes as long again; mm."""
    radius_mm, dead_steps, lag_s, noise_mm = 25.0, 8, 0.42, 0.2
    leading, random = Leading(gain_per_s=7.0, by_cycles=True), np.random.default_rng(seed)
    leading.lag.lag_s = lag_s
    cycle_s = 2.0 * np.pi * radius_mm / speed_mm_s

    def at(t_s: float) -> tuple[Vector, Vector]:
        angle, rate = 2.0 * np.pi * t_s / cycle_s, 2.0 * np.pi / cycle_s
        there = radius_mm * np.array([np.cos(angle), np.sin(angle), 0.0])
        return there, rate * np.array([-there[1], there[0], 0.0])

    told = driven = seen = at(0.0)[0]
    late, moved, errors = deque([told] * dead_steps), np.zeros(3), []
    for k in range(round(cycles * cycle_s / DT_S)):
        t_s = k * DT_S
        driven = np.clip(driven, told - half_mm, told + half_mm)
        late.append(driven)
        tip = late.popleft()
        seen = seen + 0.4 * (tip + noise_mm * random.normal(size=3) - seen)
        reference = at(t_s)[0]
        observation = observed(t_s, seen, told, at, Phase(t_s % cycle_s, cycle_s))
        leading.take_stock(observation, DT_S, moved)
        moved = leading.step(observation, DT_S)
        told = told + moved
        errors.append(float(np.linalg.norm(reference - tip)))
    return [float(part.mean()) for part in np.array_split(errors, cycles)]


@pytest.mark.parametrize(("half_mm", "settled_mm"), [(1.5, 0.95), (3.5, 1.05)])
def test_a_late_tip_behind_play_does_not_chatter_and_learns_its_cycles(
    half_mm: float, settled_mm: float
) -> None:
    means = np.mean([led_through_play(half_mm, 20.0, 4, seed) for seed in (1, 2, 3)], axis=0)
    assert means[-1] < settled_mm < 0.8 * means[0]


def test_a_fast_circle_is_followed_to_the_tracker_s_noise_in_a_few_cycles(model: str) -> None:
    means = by_cycle(loop_on("as_made", model), 20.0, 3)
    assert means[0] < 0.8
    assert means[-1] < 0.35


def test_a_body_a_second_late_is_followed_as_well_after_some_cycles(model: str) -> None:
    means = by_cycle(loop_on("slow", model), 20.0, 3)
    assert means[0] < 4.0
    assert means[-1] < 0.8


STAR = Star(
    kind="star",
    center_mm=(0.0, 0.0, 185.0),
    radius_mm=30.0,
    inner_radius_mm=14.0,
    cycle_s=10.9,
    cycles=2,
)
"""At 20 mm/s."""


def test_a_late_body_is_slowed_where_it_would_be_off_too_far_and_not_once_it_has_learnt(
    model: str,
) -> None:
    loop = loop_on("slow", model)
    cycles = loop.follow_at_its_pace(STAR)
    lasted = [len(cycle.errors_mm) * DT_S / STAR.cycle_s for cycle in cycles]
    assert 1.1 < lasted[0] < 2.5
    assert lasted[-1] < 0.5 * (1.0 + lasted[0])
    assert all(cycle.errors_mm.mean() < 1.1 for cycle in cycles)
    hurried = loop_on("slow", model)
    first = hurried.follow(STAR.model_copy(update={"cycles": 1}))
    assert cycles[0].errors_mm.mean() < 0.75 * first.mean_mm


def test_what_a_late_body_is_off_by_is_no_more_than_expected_and_no_less_than_two_fifths(
    model: str,
) -> None:
    loop, off, expected = loop_on("slow", model), [], []
    trajectory = make_trajectory(circle(20.0, 3), Path())
    for k in range(round(trajectory.duration_s / DT_S)):
        t_s = k * DT_S
        ahead = partial(lambda begin_s, lead_s: trajectory.at(begin_s + lead_s), t_s)
        loop.step(*trajectory.at(t_s), ahead, Phase(t_s % trajectory.cycle_s, trajectory.cycle_s))
        assert loop.proposal.expected_mm is not None
        off.append(float(np.linalg.norm(loop.tip_mm - trajectory.at(t_s)[0])))
        expected.append(loop.proposal.expected_mm)
    came, foretold = np.array_split(off, 3), np.array_split(expected, 3)
    ratios = [np.sqrt((a**2).mean() / (b**2).mean()) for a, b in zip(came, foretold, strict=True)]
    assert all(0.4 < ratio < 1.1 for ratio in ratios), ratios
    assert np.mean(np.array(off) < 2.0 * np.array(expected)) > 0.95


def test_a_prompt_body_keeps_the_path_s_time(model: str) -> None:
    (first, _) = loop_on("as_made", model).follow_at_its_pace(circle(20.0, 2))
    assert len(first.errors_mm) == pytest.approx(circle(20.0, 2).cycle_s / DT_S, abs=1)


@pytest.mark.parametrize("lag_s", [0.46, pytest.param(0.3, marks=pytest.mark.long)])
def test_learning_makes_no_body_worse_whose_lag_is_about_where_prediction_begins(
    lag_s: float, model: str
) -> None:
    body = {"pneumatic_lag_s": lag_s, "hysteresis": 0.29, "backlash_mm": 0.13, "creep": 0.24}
    on, off = (by_cycle(loop_on(body, model, learning), 20.0, 2) for learning in (True, False))
    assert all(learnt <= 1.1 * fixed + 0.1 for learnt, fixed in zip(on, off, strict=True))


def test_a_path_beyond_what_axes_reach_is_not_slowed_and_its_error_is_expected(model: str) -> None:
    loop = loop_on("as_made", model)
    too_high = circle(20.0, 2).model_copy(update={"center_mm": (0.0, 0.0, 238.0)})
    *_, last = loop.follow_at_its_pace(too_high)
    assert last.errors_mm.mean() > 3.0  # the axes are at their upper ends
    assert len(last.errors_mm) == pytest.approx(too_high.cycle_s / DT_S, rel=0.05)
    assert loop.proposal.expected_mm == pytest.approx(last.errors_mm.mean(), rel=0.4)
