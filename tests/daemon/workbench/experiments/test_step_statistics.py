"""The figures of an experiment say what the plain formulas say."""

from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.workbench.experiments.step_statistics import (
    Array,
    StepSeries,
    converged_s,
    drifts,
    errors_by_cycle,
    tracker_limits,
)

RATE_HZ = 40.0


def series(
    error_mm: Array, cycle_s: float = 10.0, u: Array | None = None, **more: Array
) -> StepSeries:
    """Steps whose error is along x; everything is known unless `more` says otherwise."""
    t_s = np.arange(len(error_mm)) / RATE_HZ
    reference = np.zeros((len(error_mm), 3))
    tip = reference + np.outer(error_mm, [1.0, 0.0, 0.0])
    return StepSeries(
        t_s=t_s,
        clock_s=t_s,
        cycle=np.floor(t_s / cycle_s),
        reference_mm=reference,
        tip_mm=more.get("tip_mm", tip),
        reading_mm=more.get("reading_mm", tip),
        true_mm=more.get("true_mm", reference),
        u=np.zeros((len(error_mm), 2)) if u is None else u,
    )


@given(st.lists(st.floats(0, 50), min_size=1, max_size=60), st.floats(0.1, 3.0))
def test_mean_spread_and_worst_of_each_cycle(errors: list[float], cycle_s: float) -> None:
    made = series(np.array(errors), cycle_s)
    rows = errors_by_cycle(made, made.tip_mm)
    assert [row.cycle for row in rows] == made.cycles
    for row in rows:
        mine = np.array(errors)[made.cycle == row.cycle]
        assert row.samples == len(mine)
        assert row.mean_mm == pytest.approx(mine.mean())
        assert row.std_mm == pytest.approx(mine.std(), abs=1e-9)
        assert row.max_mm == pytest.approx(mine.max())


def test_steps_without_a_reading_are_left_out_of_its_errors() -> None:
    readings = np.zeros((80, 3))
    readings[:40] = np.nan
    readings[40:, 2] = 0.5
    made = series(np.zeros(80), cycle_s=1.0, reading_mm=readings)
    (row,) = errors_by_cycle(made, made.reading_mm)
    assert (row.cycle, row.samples, row.mean_mm) == (1, 40, 0.5)


def test_drift_is_from_the_beginning_of_a_cycle_to_its_end() -> None:
    u = np.zeros((80, 2))
    u[:40, 0] = np.linspace(0.0, 0.3, 40)
    u[:40, 1] = np.linspace(0.2, 0.6, 40)
    u[40:, 0] = 0.5 * np.sin(np.linspace(0.0, 2 * pi, 40))
    there_and_back = series(np.zeros(80), cycle_s=1.0, u=u)
    assert drifts(there_and_back) == pytest.approx([0.5, 0.0])


def test_convergence_is_when_the_mean_was_below_a_millimetre_for_good() -> None:
    error_mm = np.full(1600, 0.5)
    error_mm[:400] = 5.0
    error_mm[800:840] = 30.0  # a later disturbance: the mean over 2.5 s leaves it at 23.3 s
    assert converged_s(series(error_mm), 10.0) == pytest.approx(23.3, abs=0.3)
    error_mm[800:840] = 0.5
    settled = converged_s(series(error_mm), 10.0)
    assert settled == pytest.approx(10.0 + 2.5 * (1 - 0.5 / 4.5), abs=0.1)


def test_what_is_good_from_the_start_has_converged_at_once() -> None:
    assert converged_s(series(np.full(1600, 0.4)), 10.0) == 0.0


def test_no_convergence_where_the_error_stays_or_the_run_is_too_short() -> None:
    assert converged_s(series(np.full(1600, 1.5)), 10.0) is None
    assert converged_s(series(np.full(90, 0.1)), 10.0) is None
    assert converged_s(series(np.zeros(0)), 10.0) is None


def test_the_trackers_noise_and_distortion_are_told_apart() -> None:
    random = np.random.default_rng(1)
    steps = 8000
    way = np.linspace(0.0, 12 * pi, steps)
    true = 30.0 * np.stack([np.cos(way), np.sin(way), np.zeros(steps)], axis=1)
    distortion = 0.6 * np.stack([np.sin(way), np.cos(way), np.zeros(steps)], axis=1)
    readings = true + distortion + 0.2 * random.normal(size=(steps, 3))
    readings[::500] += 40.0
    readings[7::300] = np.nan
    limits = tracker_limits(
        series(np.zeros(steps), tip_mm=true + 0.3, reading_mm=readings, true_mm=true)
    )
    assert limits is not None
    assert limits.noise_mm == pytest.approx(0.0, abs=1e-9)
    assert limits.reading_noise_mm == pytest.approx(0.2 * sqrt(8 / pi), rel=0.03)
    assert limits.distortion_mm == pytest.approx(0.6, rel=0.03)


def test_where_nobody_knows_the_truth_there_is_still_the_noise() -> None:
    random = np.random.default_rng(2)
    readings = 0.1 * random.normal(size=(4000, 3))
    unknown = np.full((4000, 3), np.nan)
    limits = tracker_limits(series(np.zeros(4000), reading_mm=readings, true_mm=unknown))
    assert limits is not None
    assert limits.distortion_mm is None
    assert limits.reading_noise_mm == pytest.approx(0.1 * sqrt(8 / pi), rel=0.05)
    assert tracker_limits(series(np.zeros(50))) is None
