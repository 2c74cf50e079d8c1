"""A repeated path is learnt, and what was no part of it is not."""

import numpy as np
import pytest

from daemon.control.controller import Phase
from daemon.control.leading import Leading
from daemon.control.repeated_path import CycleCorrection
from drivers.pose import Vector
from tests.daemon.control.closed_loop import DT_S
from tests.daemon.control.leading.late_body import observed

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
