"""What a run comes to: made-up steps whose figures are known."""

from dataclasses import replace

import numpy as np
import pytest

from config.tasks.experiment import Happening
from daemon.workbench.experiments.measures import (
    LoadChange,
    load_changes,
    measured,
    recovery_lines,
)
from daemon.workbench.experiments.step_statistics import Array, StepSeries

DT_S = 0.025


def series(error_mm: Array, cycle: Array | None = None, u: Array | None = None) -> StepSeries:
    """A tip beside a reference that goes 10 mm/s along x, off along y; truly twice as far."""
    t_s = DT_S * np.arange(len(error_mm), dtype=np.float64)
    reference = np.stack([10.0 * t_s, 0.0 * t_s, 0.0 * t_s], axis=1)
    off = np.stack([0.0 * t_s, error_mm, 0.0 * t_s], axis=1)
    return StepSeries(
        t_s=t_s,
        clock_s=t_s.copy(),
        cycle=np.zeros(len(t_s)) if cycle is None else cycle,
        reference_mm=reference,
        tip_mm=reference + off,
        reading_mm=reference + off,
        true_mm=reference + 2.0 * off,
        u=np.zeros((len(t_s), 2)) if u is None else u,
    )


def test_the_settled_error_is_that_of_the_later_half_of_the_cycles() -> None:
    cycle = np.repeat([0.0, 1.0, 2.0, 3.0, 4.0], 100)
    error = np.repeat([5.0, 3.0, 0.3, 0.6, 0.4], 100)
    found = measured(series(error, cycle), 12.5, [])
    assert found is not None
    assert (found.first_mm, found.settled_mm, found.worst_mm) == pytest.approx((5.0, 0.4, 5.0))
    assert (found.true_first_mm, found.true_settled_mm, found.true_worst_mm) == pytest.approx(
        (10.0, 0.8, 10.0)
    )
    alone = measured(series(np.full(200, 0.7)), 5.0, [])
    assert alone is not None
    assert alone.settled_mm == pytest.approx(0.7)


def test_errors_are_held_against_what_was_expected_but_not_those_after_a_load() -> None:
    error = np.where(np.arange(400) < 200, 0.6, 0.3)
    error[100:180] = 20.0
    expected = np.where(np.arange(400) < 200, 0.4, 0.2)
    expected[:10] = np.nan
    told = replace(series(error), expected_mm=expected)
    found = measured(told, 10.0, [LoadChange(100 * DT_S, 30.0)])
    assert found is not None
    assert found.against_expected == pytest.approx(1.5)
    silent = measured(replace(told, expected_mm=np.full(400, np.nan)), 10.0, [])
    assert silent is not None
    assert silent.against_expected is None


def pushed(back_after_s: float, beyond_mm: float = 0.0, at_s: float = 2.0) -> Array:
    """10 mm off from then on for so long, then so far on the other side for a tenth of a second."""
    t_s = DT_S * np.arange(400)
    off = np.where((t_s >= at_s) & (t_s < at_s + back_after_s), 10.0, 0.2)
    after = (t_s >= at_s + back_after_s) & (t_s < at_s + back_after_s + 0.1)
    return np.where(after, -beyond_mm, off)


def test_a_tip_is_back_when_it_stays() -> None:
    found = measured(series(pushed(0.75)), 10.0, [LoadChange(2.0, 30.0)])
    assert found is not None
    (recovery,) = found.recoveries
    assert recovery.back_s == pytest.approx(0.75, abs=1.5 * DT_S)
    assert (recovery.peak_mm, recovery.overshoot_mm, recovery.load_g) == (10.0, 0.0, 30.0)


def test_where_a_path_is_slowed_a_tip_is_back_by_everybody_s_clock() -> None:
    slowed = series(pushed(0.75))
    slowed.clock_s[:] *= 1.6
    found = measured(slowed, 10.0, [LoadChange(2.0, 30.0)])
    assert found is not None
    assert found.recoveries[0].back_s == pytest.approx(1.6 * 0.75, abs=3.0 * DT_S)
    assert found.times_as_long == pytest.approx(1.6)


def test_where_the_robot_stood_is_no_time_that_a_path_took() -> None:
    held = series(np.full(400, 0.3))
    held.clock_s[200:] += 30.0
    found = measured(held, 10.0, [])
    assert found is not None
    assert found.times_as_long == pytest.approx(1.0)


def test_the_bodys_own_tip_is_back_when_it_is_and_never_where_nobody_knows_it() -> None:
    t_s = DT_S * np.arange(400)
    off = np.where((t_s >= 2.0) & (t_s < 2.5), 10.0, 0.2)
    off[t_s >= 2.5] = np.where(t_s[t_s >= 2.5] < 3.5, 0.6, 0.2)
    found = measured(series(off), 10.0, [LoadChange(2.0, 30.0)])
    assert found is not None
    (recovery,) = found.recoveries
    assert recovery.back_s == pytest.approx(0.5, abs=1.5 * DT_S)
    assert recovery.true_back_s == pytest.approx(1.5, abs=1.5 * DT_S)
    blind = series(off)
    blind.true_mm[:] = np.nan
    unknown = measured(blind, 10.0, [LoadChange(2.0, 30.0)])
    assert unknown is not None
    assert unknown.recoveries[0].true_back_s is None


def test_what_became_of_a_load_is_said_in_a_line() -> None:
    changes = [LoadChange(2.0, 30.0), LoadChange(3.5, 0.0)]
    found = measured(series(pushed(1.0)), 10.0, changes)
    assert found is not None
    assert recovery_lines(found.recoveries) == [
        "30 g from 2.0 s on: 10.0 mm off, back below 1 mm not at all (the true tip not at all), "
        "0.0 mm beyond",
        "0 g from 3.5 s on: 0.2 mm off, back below 1 mm after 0.00 s (the true tip after 0.00 s), "
        "0.0 mm beyond",
    ]


def test_an_overshoot_is_on_the_other_side_and_delays_the_return() -> None:
    found = measured(series(pushed(0.5, beyond_mm=3.0)), 10.0, [LoadChange(2.0, 30.0)])
    assert found is not None
    (recovery,) = found.recoveries
    assert recovery.overshoot_mm == pytest.approx(3.0)
    assert recovery.back_s == pytest.approx(0.6, abs=1.5 * DT_S)


def test_what_comes_too_late_is_no_return() -> None:
    changes = [LoadChange(2.0, 30.0), LoadChange(3.5, 0.0)]
    found = measured(series(pushed(1.0)), 10.0, changes)
    assert found is not None
    assert [one.back_s for one in found.recoveries] == [None, 0.0]


def test_loads_that_change_nothing_and_those_poured_in_are_no_steps() -> None:
    happenings = [
        Happening(at_cycle=1, tip_load_g=30.0),
        Happening(at_s=2.0, tip_load_g=10.0),
        Happening(at_s=4.0, tip_load_g=40.0, fill_g_s=1.0),
        Happening(at_s=5.0, inject="anything"),
    ]
    assert load_changes(10.0, happenings, 8.0) == [LoadChange(8.0, 30.0)]


def test_effort_is_the_axes_way_by_the_paths_and_acceleration_that_of_all_of_them() -> None:
    t_s = DT_S * np.arange(401)
    u = np.stack([0.5 * 0.02 * t_s**2, 0.01 * t_s], axis=1)
    found = measured(series(np.zeros(401), u=u), 10.0, [])
    assert found is not None
    assert found.effort_per_m == pytest.approx((1.0 + 0.1) / 0.1)
    assert found.acceleration_per_s2 == pytest.approx(0.02)
    still = measured(series(np.zeros(401)), 10.0, [])
    assert still is not None
    assert still.acceleration_per_s2 == 0.0


def test_nothing_is_measured_of_nothing() -> None:
    assert measured(series(np.zeros(0)), 10.0, []) is None


def test_what_was_poured_in_and_is_taken_off_at_once_is_a_step() -> None:
    happenings = [
        Happening(at_s=2.0, tip_load_g=40.0, fill_g_s=10.0),
        Happening(at_s=8.0, tip_load_g=0.0),
    ]
    assert load_changes(0.0, happenings, 8.0) == [LoadChange(8.0, 0.0)]


def test_a_tip_is_not_back_while_the_robot_stands() -> None:
    """Held for ten seconds in the middle of a push: far off before, and far off after it."""
    held = series(pushed(0.75))
    held.clock_s[held.t_s > 2.3] += 10.0
    found = measured(held, 10.0, [LoadChange(2.0, 30.0)])
    assert found is not None
    assert found.recoveries[0].back_s == pytest.approx(10.75, abs=1.5 * DT_S)
    assert found.recoveries[0].true_back_s == pytest.approx(10.75, abs=1.5 * DT_S)
