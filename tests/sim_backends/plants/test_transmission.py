"""Dead time and play between an axis and what it moves, against what they are by definition."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sim_backends.plants.plant import FloatArray
from sim_backends.plants.transmission import Transmission

PERIOD_S = 0.025


def through(
    shafts: FloatArray, dead_time_s: float, backlash_mm: float, dt_s: float = PERIOD_S
) -> FloatArray:
    """(n, m) what arrives while the shafts go through (n, m) places."""
    between = Transmission.rested(dead_time_s, backlash_mm, np.zeros(shafts.shape[1]))
    arrived = []
    for place in shafts:
        between = between.after(place, dt_s)
        arrived.append(between.arrived)
    return np.array(arrived)


def wave(count: int, dt_s: float = PERIOD_S, amplitude_mm: float = 3.0) -> FloatArray:
    t_s = dt_s * np.arange(1, count + 1)
    return np.stack([amplitude_mm * np.sin(t_s), amplitude_mm * (1.0 - np.cos(0.7 * t_s))], axis=1)


def test_without_either_everything_arrives_at_once_to_the_bit() -> None:
    shafts = wave(200)
    assert (through(shafts, 0.0, 0.0) == shafts).all()


@pytest.mark.parametrize("dead_time_s", [0.01, 0.1, 0.25])
def test_a_ramp_arrives_a_dead_time_later(dead_time_s: float) -> None:
    t_s = PERIOD_S * np.arange(1, 101)
    arrived = through(np.asarray(4.0 * t_s[:, None]), dead_time_s, 0.0)
    expected = 4.0 * np.maximum(t_s - dead_time_s, 0.0)
    np.testing.assert_allclose(arrived[:, 0], expected, atol=1e-12)


def test_of_a_step_nothing_arrives_before_its_dead_time_and_then_all_of_it() -> None:
    arrived = through(np.full((20, 1), 5.0), 0.25, 0.0)[:, 0]
    assert (arrived[:9] == 0.0).all()  # up to 0.225 s; it was made within the first 25 ms
    np.testing.assert_allclose(arrived[10:], 5.0, atol=1e-9)


@given(st.lists(st.floats(0.002, 0.2), min_size=1, max_size=40))
def test_uneven_steps_in_time_change_nothing_of_what_arrives(steps_s: list[float]) -> None:
    between = Transmission.rested(0.15, 0.0, np.zeros(1))
    t_s = 0.0
    for dt_s in steps_s:
        t_s += dt_s
        between = between.after(np.array([2.0 * t_s]), dt_s)
        np.testing.assert_allclose(between.arrived, [2.0 * max(t_s - 0.15, 0.0)], atol=1e-9)


def test_a_shaft_that_turns_back_takes_up_twice_the_backlash_first() -> None:
    there = np.linspace(0.0, 2.0, 201)
    shafts = np.concatenate([there, there[::-1]])[:, None]
    arrived = through(shafts, 0.0, 0.1)[:, 0]
    assert arrived[200] == pytest.approx(1.9)
    waits = np.abs(arrived[201:] - 1.9) < 1e-9
    assert 2.0 - shafts[201 + np.flatnonzero(~waits)[0], 0] == pytest.approx(0.2, abs=0.011)
    assert arrived[-1] == pytest.approx(0.1)


def test_play_takes_a_wave_s_peaks_and_lags_it_by_its_known_phase() -> None:
    """Of a wave of amplitude A, half-width b: peaks A - b; its fundamental is behind by the
    describing function's angle, whose sine part is -(4 b / π A)(1 - b / A)."""
    amplitude, half = 1.0, 0.2
    angle = 2.0 * np.pi * np.arange(1, 40_001) / 10_000
    arrived = through(amplitude * np.sin(angle)[:, None], 0.0, half)[:, 0]
    last = slice(30_000, 40_000)
    assert arrived[last].max() == pytest.approx(amplitude - half, abs=1e-6)
    behind = 2.0 * float((arrived * np.cos(angle))[last].mean())
    expected = -4.0 * half / np.pi * (1.0 - half / amplitude)
    assert behind == pytest.approx(expected, rel=1e-3)


def test_play_and_dead_time_together_are_one_after_the_other() -> None:
    shafts = wave(400)
    played = through(shafts, 0.0, 0.15)
    both = through(shafts, 10 * PERIOD_S, 0.15)
    np.testing.assert_allclose(both[10:], played[:-10], atol=1e-9)


def test_what_is_remembered_does_not_grow() -> None:
    between = Transmission.rested(0.25, 0.1, np.zeros(6))
    for place in np.random.default_rng(1).normal(size=(2000, 6)):
        between = between.after(place, PERIOD_S)
    assert len(between.places) <= 0.25 / PERIOD_S + 2
