"""A late body is led, a repeated path is learnt, and what was no part of the path is not."""

from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from config.emulation import SoftArmPlant
from config.tasks.controllers import ForwardJacobian
from config.tasks.trajectory import Circle, Rectangle, Star
from daemon.control.controller import Observation, Phase
from daemon.control.lag.body_lag import parts
from daemon.control.lag.disturbance import Jump
from daemon.control.lag.load import Hung
from daemon.control.leading import Leading
from daemon.control.repeated_path import CycleCorrection
from daemon.controllers.forward_jacobian import ForwardJacobianController
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import (
    DT_S,
    PISTON_MM2,
    ROBOT,
    ClosedLoop,
    pretrained,
    started,
)

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

CYCLE_S = 8.0
START_MM = np.array([30.0, 0.0, 185.0])


def path(t_s: float) -> Vector:
    angle = 2.0 * np.pi * t_s / CYCLE_S
    return np.asarray(20.0 * np.array([np.cos(angle), np.sin(angle), 0.0]))


def disturbance(t_s: float) -> Vector:
    return np.asarray(np.array([2.0, 1.0, 0.0]) * np.sin(4.0 * np.pi * t_s / CYCLE_S))


def go_round(
    cycles: CycleCorrection, rounds: int, off: float = 1.0, dt_s: float = DT_S
) -> list[float]:
    """The largest error of each round: the tip shows what it is led by, and is pushed aside."""
    worst = []
    for _ in range(rounds):
        errors = []
        for k in range(round(CYCLE_S / dt_s)):
            t_s = k * dt_s
            error = off * disturbance(t_s) - cycles.at(t_s)[0]
            cycles.add(Phase(t_s, CYCLE_S), dt_s, 0.0, error, path(t_s))
            errors.append(float(np.linalg.norm(error)))
        worst.append(max(errors))
    return worst


@pytest.mark.parametrize("dt_s", [DT_S, 0.1, 0.14])
def test_what_comes_back_in_every_cycle_is_led_the_other_way(dt_s: float) -> None:
    """However seldom the tip is seen: at the places between that, too, the correction is smooth."""
    cycles = CycleCorrection(CYCLE_S)
    worst = go_round(cycles, rounds=8, dt_s=dt_s)
    assert worst[0] > 2.0
    assert worst[-1] < 0.15 * worst[0]
    between = [cycles.at(t_s) for t_s in np.arange(0.0, CYCLE_S, 0.01)]
    away = [at[0] - disturbance(0.01 * k) for k, at in enumerate(between)]
    assert max(np.linalg.norm(one) for one in away) < 0.5
    fastest = max(
        np.linalg.norm(disturbance(t_s + 0.05) - disturbance(t_s)) / 0.05 for t_s in (0, 1)
    )
    assert max(np.linalg.norm(at[1]) for at in between) < 1.5 * fastest


def test_a_correction_goes_over_from_one_cycle_into_the_next_without_a_jump() -> None:
    cycles = CycleCorrection(CYCLE_S)
    go_round(cycles, rounds=4)
    times = np.arange(-1.0, 1.0, 0.01)
    places = np.array([cycles.at(t_s)[0] for t_s in times])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 2.0 * np.linalg.norm(disturbance(0.01))
    rates = np.array([cycles.at(t_s)[1] for t_s in times])
    np.testing.assert_allclose(
        np.cumsum(rates[:-1] * 0.01, axis=0), places[1:] - places[0], atol=0.05
    )


def test_a_single_large_error_is_not_believed_in_full() -> None:
    cycles = CycleCorrection(CYCLE_S)
    for k in range(round(CYCLE_S / DT_S)):
        error = np.array([40.0, 0.0, 0.0]) if 3.0 < k * DT_S < 3.4 else np.zeros(3)
        cycles.add(Phase(k * DT_S, CYCLE_S), DT_S, 0.0, error, path(k * DT_S))
    assert max(np.linalg.norm(cycles.at(t_s)[0]) for t_s in np.arange(2.5, 4.0, 0.05)) <= 2.5


def test_another_path_of_the_same_length_is_not_taken_for_the_one_that_was_learnt() -> None:
    cycles = CycleCorrection(CYCLE_S)
    go_round(cycles, rounds=2)
    assert all(
        cycles.path.fits(Phase(t_s, CYCLE_S), path(t_s)) for t_s in np.arange(0.0, 8.0, 0.06)
    )
    assert not cycles.path.fits(Phase(1.0, CYCLE_S), path(1.0) + np.array([0.0, 8.0, 0.0]))
    assert not cycles.path.fits(Phase(1.0, CYCLE_S + 1.0), path(1.0))


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(60, epochs=8).save(path)
    return str(path)


def loop_on(
    body: str | dict[str, float],
    model: str,
    monkeypatch: pytest.MonkeyPatch,
    learning: bool = True,
) -> ClosedLoop:
    """body: a named one, or what is different on another."""
    figures = {"body": body} if isinstance(body, str) else body
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", **figures})
    monkeypatch.setattr(closed_loop, "soft_arm", lambda _: SoftArm(plant, [PISTON_MM2] * 6))
    options = ForwardJacobian(
        kind="forward_jacobian",
        model=model,
        learning=learning,
        lead=True,
        gain_per_s=6.0,
        max_tip_speed_mm_s=80.0,
    )
    return started(ForwardJacobianController(options, ROBOT, 1), START_MM)


def circle(speed_mm_s: float, cycles: int) -> Circle:
    return Circle(
        kind="circle",
        center_mm=(0.0, 0.0, 185.0),
        radius_mm=30.0,
        cycle_s=60.0 * np.pi / speed_mm_s,
        cycles=cycles,
    )


def by_cycle(loop: ClosedLoop, speed_mm_s: float, cycles: int) -> list[float]:
    errors = loop.follow(circle(speed_mm_s, cycles)).errors_mm
    return [float(part.mean()) for part in np.array_split(errors, cycles)]


def observed(
    t_s: float,
    tip_mm: Vector,
    told_mm: Vector,
    at: Callable[[float], tuple[Vector, Vector]],
    phase: Phase | None = None,
) -> Observation:
    """Of a tip whose axes are its coordinates. at: the reference and its velocity, by time."""
    reference_mm, velocity_mm_s = at(t_s)
    return Observation(
        t_ns=round(t_s * 1e9),
        dt_s=DT_S,
        tip_mm=tip_mm,
        tip_velocity_mm_s=velocity_mm_s,
        u=told_mm,
        targets=told_mm,
        reference_mm=reference_mm,
        reference_velocity_mm_s=velocity_mm_s,
        ahead=lambda lead_s: at(t_s + lead_s),
        phase=phase,
    )


def test_a_path_repeats_from_its_second_round_on_and_no_more_when_it_is_left() -> None:
    def at(t_s: float) -> tuple[Vector, Vector]:
        return path(t_s), np.zeros(3)

    leading, repeats = Leading(gain_per_s=4.0, by_cycles=True), []
    for k in range(round(3.0 * CYCLE_S / DT_S)):
        t_s = k * DT_S
        phase = Phase(t_s % CYCLE_S, CYCLE_S) if t_s < 2.5 * CYCLE_S else None
        leading.step(observed(t_s, path(t_s), path(t_s), at, phase), DT_S)
        repeats.append(leading.repeats)
    ends = [round(rounds * CYCLE_S / DT_S) for rounds in (1.0, 2.5)]
    first, later, left = np.split(np.array(repeats), ends)
    assert not first[:-1].any()
    assert later.all()
    assert not left.any()


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


def test_a_fast_circle_is_followed_to_the_tracker_s_noise_in_a_few_cycles(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    means = by_cycle(loop_on("as_made", model, monkeypatch), 20.0, 4)
    assert means[0] < 0.8
    assert means[-1] < 0.35


def test_a_body_a_second_late_is_followed_as_well_after_some_cycles(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    means = by_cycle(loop_on("slow", model, monkeypatch), 20.0, 4)
    assert means[0] < 4.0
    assert means[-1] < 0.8


CORNERS: dict[str, Rectangle | Star] = {
    "rectangle": Rectangle(
        kind="rectangle",
        center_mm=(0.0, 0.0, 185.0),
        width_mm=25.0,
        height_mm=80.0,
        cycle_s=10.5,
        cycles=3,
    ),
    "star": Star(
        kind="star",
        center_mm=(0.0, 0.0, 185.0),
        radius_mm=30.0,
        inner_radius_mm=14.0,
        cycle_s=10.9,
        cycles=3,
    ),
}
"""At 20 mm/s."""


@pytest.mark.parametrize("path", CORNERS)
def test_a_late_body_is_slowed_where_it_would_be_off_too_far_and_not_once_it_has_learnt(
    path: str, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    options = CORNERS[path]
    loop = loop_on("slow", model, monkeypatch)
    cycles = loop.follow_at_its_pace(options)
    lasted = [len(cycle.errors_mm) * DT_S / options.cycle_s for cycle in cycles]
    assert 1.1 < lasted[0] < 2.5
    assert lasted[-1] < 0.5 * (1.0 + lasted[0])
    assert all(cycle.errors_mm.mean() < 1.1 for cycle in cycles)
    hurried = loop_on("slow", model, monkeypatch)
    first = hurried.follow(options.model_copy(update={"cycles": 1}))
    assert cycles[0].errors_mm.mean() < 0.75 * first.mean_mm


def test_what_a_late_body_is_off_by_is_no_more_than_expected_and_no_less_than_two_fifths(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop, off, expected = loop_on("slow", model, monkeypatch), [], []
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


def test_a_prompt_body_keeps_the_path_s_time(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (first, _) = loop_on("as_made", model, monkeypatch).follow_at_its_pace(circle(20.0, 2))
    assert len(first.errors_mm) == pytest.approx(circle(20.0, 2).cycle_s / DT_S, abs=1)


@pytest.mark.parametrize("lag_s", [0.3, 0.42, 0.46])
def test_learning_makes_no_body_worse_whose_lag_is_about_where_prediction_begins(
    lag_s: float, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    body = {"pneumatic_lag_s": lag_s, "hysteresis": 0.29, "backlash_mm": 0.13, "creep": 0.24}
    on, off = (
        by_cycle(loop_on(body, model, monkeypatch, learning), 20.0, 3) for learning in (True, False)
    )
    assert all(learnt <= 1.1 * fixed + 0.1 for learnt, fixed in zip(on, off, strict=True))


def test_a_load_is_caught_within_a_second_and_is_not_there_in_the_next_cycle(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = loop_on("as_made", model, monkeypatch)
    options = circle(20.0, 5)
    at = round(2.5 * options.cycle_s / DT_S)
    count = [0]
    measure = loop.measure

    def measured() -> None:
        count[0] += 1
        if count[0] == at:
            loop.load_g = 30.0
        measure()

    monkeypatch.setattr(loop, "measure", measured)
    errors = loop.follow(options).errors_mm
    cycle = round(options.cycle_s / DT_S)
    assert errors[at : at + 40].max() > 8.0
    assert errors[at + 40 : at + cycle - 40].mean() < 0.6
    assert errors[at + cycle - 20 : at + cycle + 100].max() < 2.0


ON_S, OFF_S = 8.0, 16.0


def off_under_a_load(lag_s: float, seed: int, softer: float, rest_known: bool = False) -> Vector:
    """(n,) mm off, step by step, of a body that a load makes go so many times as far for `ON_S` to
    `OFF_S`, and for four seconds after it."""
    rest_mm, speed_mm_s = np.array([0.0, 0.0, 210.0]), 80.0
    leading, random = Leading(gain_per_s=7.0, by_cycles=False), np.random.default_rng(seed)
    leading.lag.lag_s = lag_s
    leading.load.rest_mm = rest_mm if rest_known else None
    reference = make_trajectory(circle(10.0, 2), Path())
    told = shown = reference.at(0.0)[0] - rest_mm
    dead_s, first_order_s = parts(lag_s)
    late = deque([told] * round(dead_s / DT_S))
    moved, errors = np.zeros(3), []
    for k in range(round((OFF_S + 4.0) / DT_S)):
        t_s = k * DT_S
        late.append(told)
        shown = shown + DT_S / first_order_s * (late.popleft() - shown)
        tip_mm = rest_mm + (softer if ON_S <= t_s < OFF_S else 1.0) * shown
        seen_mm = tip_mm + 0.15 * random.normal(size=3)
        observation = observed(t_s, seen_mm, told, reference.at)
        leading.take_stock(observation, DT_S, moved)
        moved = leading.step(observation, DT_S)
        moved = moved * min(1.0, speed_mm_s * DT_S / max(float(np.linalg.norm(moved)), 1e-9))
        told = told + moved
        errors.append(float(np.linalg.norm(reference.at(t_s)[0] - tip_mm)))
    return np.array(errors)


def unloaded(lag_s: float, seed: int) -> float:
    """Seconds from when a load is taken off until the tip stays within 1 mm of where it should be.
    It made all of a body's ways half as long again."""
    beyond = np.flatnonzero(off_under_a_load(lag_s, seed, 1.5)[round(OFF_S / DT_S) :] > 1.0)
    return DT_S * float(beyond[-1] + 1)


def test_what_the_way_back_told_of_a_loaded_body_leads_it_until_gains_do() -> None:
    """Gains take seconds, and a tip that goes further than told swings meanwhile."""
    swings = np.array([off_under_a_load(0.1, seed, 1.3) for seed in range(5)])
    after = swings[:, round((ON_S + 0.6) / DT_S) : round((ON_S + 1.8) / DT_S)]
    assert np.sqrt((after**2).mean()) < 0.25


@pytest.mark.parametrize("softer", [1.3, 1.5])
def test_who_knows_where_a_body_rests_is_told_by_the_jump_what_a_load_made_of_it(
    softer: float,
) -> None:
    """Once it is back it swings less."""
    unknown, known = (
        np.array([off_under_a_load(0.1, seed, softer, rest_known) for seed in range(5)])
        for rest_known in (False, True)
    )
    back = slice(round((ON_S + 0.7) / DT_S), round((ON_S + 1.5) / DT_S))
    assert known[:, back].mean() < 0.9 * unknown[:, back].mean()


def test_what_a_load_makes_of_the_body_is_not_learnt_of_it() -> None:
    leading = Leading(gain_per_s=7.0, by_cycles=False)
    leading.gains, leading.load.hung = np.array([1.1, 1.0, 0.9]), Hung(1.5)
    np.testing.assert_allclose(leading.made_up_for, [1.65, 1.5, 1.35])


@pytest.mark.parametrize("lag_s", [0.1, 0.3, 0.7])
def test_a_load_that_is_taken_off_again_leaves_what_was_known_before(
    lag_s: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = [unloaded(lag_s, seed) for seed in range(3)]
    monkeypatch.setattr(Jump, "undoes", lambda jump, last, ratio: False)
    anew = [unloaded(lag_s, seed) for seed in range(3)]
    assert np.median(known) < min(anew)
    assert max(known) < 2.0 * lag_s + 0.4


def told_once_it_is_taken_off(by_mm: tuple[float, float, float]) -> Vector:
    """(3,) what a body that is 0.7 s late is told for a place that it is 1 mm from along x, as soon
    as it is taken off by so much."""
    leading, here = Leading(gain_per_s=6.0, by_cycles=False), (np.zeros(3), np.zeros(3))
    leading.lag.lag_s = 0.7
    for k in range(60):
        tip_mm = np.array([1.0, 0.0, 0.0]) + (np.array(by_mm) if k >= 55 else 0.0)
        observation = observed(k * DT_S, tip_mm, np.zeros(3), lambda t_s: here)
        leading.take_stock(observation, DT_S, np.zeros(3))
        told = leading.step(observation, DT_S)
    assert leading.jumps > 0
    return told


def test_what_a_load_takes_off_is_hurried_back_along_its_own_way_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A tip that is late on its path as well would swing along that."""
    hurried = told_once_it_is_taken_off((0.0, 0.0, -12.0))
    monkeypatch.setattr("daemon.control.leading._HURRY", 0.0)
    calm = told_once_it_is_taken_off((0.0, 0.0, -12.0))
    assert hurried[2] > 1.5 * calm[2] > 0.0
    np.testing.assert_allclose(hurried[:2], calm[:2])


@pytest.mark.parametrize("body", ["as_made", "worn", "mismatched"])
def test_a_tip_that_is_pushed_aside_comes_back_without_going_far_beyond(
    body: str, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = loop_on(body, model, monkeypatch)
    trajectory = make_trajectory(circle(10.0, 2), Path())
    at = round(0.3 * trajectory.duration_s / DT_S)
    off = []
    for k in range(at + 160):
        if k == at:
            loop.load_g = 30.0
        t_s = k * DT_S
        ahead = partial(lambda begin_s, lead_s: trajectory.at(begin_s + lead_s), t_s)
        phase = Phase(t_s % trajectory.cycle_s, trajectory.cycle_s)
        loop.step(*trajectory.at(t_s), ahead, phase)
        off.append(loop.tip_mm - trajectory.at(t_s)[0])
    pushed = max(off[at : at + 20], key=np.linalg.norm)
    assert np.linalg.norm(pushed) > 10.0
    along = np.array(off[at:]) @ pushed / np.linalg.norm(pushed)
    assert along.min() > -1.8
    assert np.linalg.norm(off[at + 80 :], axis=1).mean() < 1.0


def test_a_path_beyond_what_axes_reach_is_not_slowed_and_its_error_is_expected(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = loop_on("as_made", model, monkeypatch)
    too_high = circle(20.0, 3).model_copy(update={"center_mm": (0.0, 0.0, 238.0)})
    *_, last = loop.follow_at_its_pace(too_high)
    assert last.errors_mm.mean() > 3.0  # the axes are at their upper ends
    assert len(last.errors_mm) == pytest.approx(too_high.cycle_s / DT_S, rel=0.05)
    assert loop.proposal.expected_mm == pytest.approx(last.errors_mm.mean(), rel=0.4)
