"""What a load and a push make of a late body is made up for, and is no part of its path."""

from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from daemon.control.controller import Phase
from daemon.control.lag.body_lag import parts
from daemon.control.lag.disturbance import Jump
from daemon.control.lag.load import Hung
from daemon.control.leading import Leading
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from tests.daemon.control.closed_loop import DT_S
from tests.daemon.control.leading.late_body import circle, loop_on, observed

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests


def test_a_load_is_caught_within_a_second_and_is_not_there_in_the_next_cycle(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    loop = loop_on("as_made", model)
    options = circle(20.0, 3)
    at = round(1.5 * options.cycle_s / DT_S)
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


def test_along_the_way_from_rest_a_load_makes_less_of_the_body_than_across_it() -> None:
    """A motion that came is learnt as what was told for it, wherever it points."""
    leading = Leading(gain_per_s=7.0, by_cycles=False)
    leading.gains, leading.load.hung = np.array([1.1, 1.0, 0.9]), Hung(2.0, 0.5)
    leading.load.rest_mm = np.array([0.0, 0.0, 230.0])
    tip_mm, told_mm = np.array([60.0, 20.0, 210.0]), np.array([1.5, 0.5, -0.5])
    came_mm = leading.gains * (leading.load.matrix_at(tip_mm) @ told_mm)
    assert np.linalg.norm(came_mm / leading.made_up_for - told_mm) > 0.2
    np.testing.assert_allclose(leading.as_told_mm(came_mm, tip_mm), told_mm)


@pytest.mark.parametrize("lag_s", [0.3, 0.7, pytest.param(0.1, marks=pytest.mark.long)])
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


@pytest.mark.parametrize(
    "body", ["as_made", "mismatched", pytest.param("worn", marks=pytest.mark.long)]
)
def test_a_tip_that_is_pushed_aside_comes_back_without_going_far_beyond(
    body: str, model: str
) -> None:
    loop = loop_on(body, model)
    trajectory = make_trajectory(circle(10.0, 2), Path())
    at = round(0.15 * trajectory.duration_s / DT_S)
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
