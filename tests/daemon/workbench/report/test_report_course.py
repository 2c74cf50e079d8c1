import numpy as np
import pytest

from daemon.workbench.report.report_series import COLUMNS_PER_IN, course

WIDTH_IN = 5.0
COLUMNS = round(WIDTH_IN * COLUMNS_PER_IN)


@pytest.mark.parametrize("count", [0, 1, COLUMNS, 2 * COLUMNS])
def test_what_fits_is_not_touched(count: int) -> None:
    t_s = np.arange(float(count))
    shown_s, shown = course(t_s, 2.0 * t_s, WIDTH_IN)
    assert np.array_equal(shown_s, t_s)
    assert np.array_equal(shown, 2.0 * t_s)


@pytest.mark.parametrize("count", [2 * COLUMNS + 1, 16_000, 100_003])
def test_a_long_course_has_two_points_for_each_column_at_most(count: int) -> None:
    values = np.random.default_rng(1).normal(size=count)
    t_s, shown = course(np.arange(float(count)), values, WIDTH_IN)
    assert len(t_s) == len(shown) <= 3 * COLUMNS
    assert (np.diff(t_s) > 0.0).all()
    assert np.array_equal(shown, values[t_s.astype(int)])


@pytest.mark.parametrize("place", [0, 7_777, 15_999])
def test_no_peak_is_lost(place: int) -> None:
    values = np.zeros(16_000)
    values[place] = 5.0
    t_s, shown = course(np.arange(16_000.0), values, WIDTH_IN)
    assert t_s[shown == 5.0].tolist() == [place]


def test_a_gap_stays_a_gap() -> None:
    values = np.sin(np.arange(16_000.0))
    values[4_000:6_000] = np.nan
    t_s, shown = course(np.arange(16_000.0), values, WIDTH_IN)
    inside = (t_s > 4_050) & (t_s < 5_950)
    assert inside.any()
    assert np.isnan(shown[inside]).all()
    outside = (t_s < 3_900) | (t_s > 6_100)
    assert np.isfinite(shown[outside]).all()


def test_it_begins_and_ends_where_the_course_does() -> None:
    t_s, _ = course(np.arange(16_000.0), np.zeros(16_000), WIDTH_IN)
    assert (t_s[0], t_s[-1]) == (0.0, pytest.approx(15_999.0, abs=35.0))
