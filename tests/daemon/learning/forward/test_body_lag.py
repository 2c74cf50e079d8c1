"""How late a body follows its axes is found in what was seen."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.learning.forward.pretraining import PretrainingError, body_lag_s
from tests.daemon.learning.frames_of_arm import RANGES, arm_frames, without


@pytest.mark.parametrize("lag_s", [0.0, 0.06, 0.1, 0.23])
def test_the_lag_is_found(lag_s: float) -> None:
    frames = arm_frames(12, noise_mm=0.1, lag_s=lag_s)
    assert body_lag_s(frames, RANGES.travel) == pytest.approx(lag_s, abs=0.01)


def test_gaps_do_no_harm() -> None:
    frames = arm_frames(12, noise_mm=0.1, lag_s=0.1)
    for first in (200, 500, 501, 900):
        frames = without(frames, first, first + 60)
    assert body_lag_s(frames, RANGES.travel) == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9, -1e300])
@pytest.mark.parametrize("where", ["tip_mm", "u"])
def test_a_frame_that_is_nonsense_does_no_harm(value: float, where: str) -> None:
    frames = arm_frames(12, noise_mm=0.1, lag_s=0.1)
    column = getattr(frames, where).copy()
    for place in (0, 400, 401, len(frames) - 1):
        column[place] = value
    lag_s = body_lag_s(replace(frames, **{where: column}), RANGES.travel)
    if where == "tip_mm" or not np.isfinite(value):
        assert lag_s == pytest.approx(0.1, abs=0.01)
    assert lag_s > 0.05


def test_frames_that_come_twice_or_too_late_do_no_harm() -> None:
    frames = arm_frames(12, noise_mm=0.1, lag_s=0.1)
    t_ns = frames.t_ns.copy()
    t_ns[300], t_ns[500] = t_ns[299], t_ns[400]
    lag_s = body_lag_s(replace(frames, t_ns=t_ns), RANGES.travel)
    assert lag_s == pytest.approx(0.1, abs=0.01)


@pytest.mark.parametrize("count", [0, 1, 2, 100])
def test_few_frames_tell_nothing_and_are_refused(count: int) -> None:
    frames = without(arm_frames(2, lag_s=0.1), count, 10_000)
    assert len(frames) == count
    with pytest.raises(PretrainingError, match=r"cannot be told from \d+ sound frames .*--lag"):
        body_lag_s(frames, RANGES.travel)


def test_many_frames_that_are_never_long_without_a_gap_are_refused_too() -> None:
    frames = arm_frames(12, lag_s=0.1)
    torn = replace(frames, t_ns=frames.t_ns + np.arange(len(frames)) // 10 * 1_000_000_000)
    with pytest.raises(PretrainingError, match="from 0 sound frames"):
        body_lag_s(torn, RANGES.travel)


def test_it_is_never_less_than_nothing() -> None:
    frames = arm_frames(12, noise_mm=3.0)
    assert np.isfinite(body_lag_s(frames, RANGES.travel))
    assert body_lag_s(frames, RANGES.travel) >= 0.0
