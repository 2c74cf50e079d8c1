"""How late a body follows its axes is found in what was seen."""

import numpy as np
import pytest

from daemon.learning.body_lag import body_lag_s
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


@pytest.mark.parametrize("count", [0, 1, 2, 100])
def test_few_frames_tell_nothing(count: int) -> None:
    frames = without(arm_frames(2, lag_s=0.1), count, 10_000)
    assert len(frames) == count
    assert body_lag_s(frames, RANGES.travel) == 0.0


def test_it_is_never_less_than_nothing() -> None:
    frames = arm_frames(12, noise_mm=3.0)
    assert np.isfinite(body_lag_s(frames, RANGES.travel))
    assert body_lag_s(frames, RANGES.travel) >= 0.0
