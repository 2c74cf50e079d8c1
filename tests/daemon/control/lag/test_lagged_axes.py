"""Axes that are passed through a body's dead time and lag, at whatever times they are measured."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from daemon.control.lag.body_lag import DEAD_SHARES, parts
from daemon.control.lag.lagged_axes import LaggedAxes
from drivers.pose import Vector

RANGE = np.array([50.0, 50.0, 20.0])
FINE_S = 1e-3
SHARE = DEAD_SHARES[0]


def at(t_s: ArrayLike) -> Vector:
    """(n, 3) mm where the axes are at (n,) times: at up to 10 mm/s, to and fro."""
    times_s = np.asarray(t_s)[:, None]
    slow = 0.2 * np.sin(0.7 * times_s + np.arange(3))
    return RANGE * (0.5 + slow + 0.05 * np.sin(2.0 * times_s))


def late(t_s: ArrayLike, dead_s: float, first_order_s: float) -> Vector:
    """(n, 3) what comes of them after a dead time and a first-order lag, by fine steps."""
    times_s = np.asarray(t_s)
    fine_s = np.arange(-10.0, times_s[-1] + FINE_S, FINE_S)
    out = at(fine_s - dead_s)
    share = 1.0 - np.exp(-FINE_S / first_order_s)
    for k in range(1, len(out)):
        out[k] = out[k - 1] + share * (out[k] - out[k - 1])
    return np.stack([np.interp(times_s, fine_s, axis) for axis in out.T], axis=1)


@pytest.mark.parametrize("apart_s", [0.025, 0.113])
@pytest.mark.parametrize("lag_s", [0.2, 0.35, 0.8])
def test_axes_show_as_late_as_the_body_is_however_far_frames_are_apart(
    apart_s: float, lag_s: float
) -> None:
    """Frames do not come evenly. At 10 mm/s one that is late by half of the dead time is 1 mm."""
    random = np.random.default_rng(4)
    times_s = np.cumsum(random.uniform(0.8 * apart_s, 1.2 * apart_s, 300))
    axes = LaggedAxes(RANGE)
    shown = np.array(
        [axes.after(t, u, lag_s, SHARE) for t, u in zip(times_s, at(times_s), strict=True)]
    )
    known = times_s > times_s[0] + 5.0 * lag_s  # where they were before is forgotten
    np.testing.assert_allclose(shown[known], late(times_s, *parts(lag_s, SHARE))[known], atol=0.05)


def test_without_a_lag_they_show_at_once() -> None:
    axes = LaggedAxes(RANGE)
    for t_s, u in zip(0.025 * np.arange(50), at(0.025 * np.arange(50)), strict=True):
        assert (axes.after(t_s, u, 0.0, SHARE) == u).all()


@pytest.mark.parametrize("late_s", [0.0, 0.03, 0.12])
def test_how_much_later_they_are_measured_than_told_is_known_and_left_out(late_s: float) -> None:
    times_s = 0.05 * np.arange(200)
    axes, measured = LaggedAxes(RANGE), at(times_s - late_s)
    noise = 0.02 * np.random.default_rng(2).normal(size=measured.shape)
    shown = []
    for t_s, u, targets in zip(times_s, measured + noise, at(times_s), strict=True):
        axes.see(t_s, u, targets)
        shown.append(axes.after(t_s, u, 0.4, SHARE))
    assert axes.late_s == pytest.approx(late_s, abs=0.015)
    settled = times_s > 4.0
    expected = late(times_s, *parts(0.4 - late_s, SHARE))
    expected = np.stack([np.interp(times_s - late_s, times_s, axis) for axis in expected.T], 1)
    np.testing.assert_allclose(np.array(shown)[settled], expected[settled], atol=0.2)


def test_a_body_is_never_taken_to_move_before_its_axes_do() -> None:
    axes, times_s = LaggedAxes(RANGE), 0.05 * np.arange(200)
    for t_s, targets in zip(times_s, at(times_s), strict=True):
        axes.see(t_s, at(np.array([t_s - 0.3]))[0], targets)
        assert (axes.after(t_s, targets, 0.1, SHARE) == targets).all() or axes.late_s < 0.1
    assert axes.late_s > 0.1


def test_a_target_that_is_no_number_tells_nothing() -> None:
    axes = LaggedAxes(RANGE)
    for k in range(50):
        targets = at(np.array([0.05 * k]))[0]
        axes.see(0.05 * k, targets, targets if k % 3 else np.full(3, np.nan))
    assert axes.late_s == 0.0


def test_what_comes_after_a_break_does_not_go_on_from_before_it() -> None:
    axes = LaggedAxes(RANGE)
    for k in range(20):
        axes.after(0.05 * k, RANGE * 0.1, 0.3, SHARE)
    axes.break_off()
    assert (axes.after(9.0, RANGE * 0.8, 0.3, SHARE) == RANGE * 0.8).all()
