"""Where the axes were when the tracker measured."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.loop.actuation_history import ActuationHistory


def history(*samples: tuple[int, float]) -> ActuationHistory:
    made = ActuationHistory(2)
    for t_ns, value in samples:
        made.add(t_ns, (value, -value))
    return made


def test_between_two_samples_it_is_in_proportion() -> None:
    made = history((0, 0.0), (100, 1.0), (200, 5.0))
    assert made.at(150).tolist() == [3.0, -3.0]


def test_outside_the_samples_it_is_the_nearest_one() -> None:
    made = history((100, 1.0), (200, 5.0))
    assert made.at(0).tolist() == [1.0, -1.0]
    assert made.at(999).tolist() == [5.0, -5.0]


def test_before_anything_is_known_it_says_so() -> None:
    with pytest.raises(LookupError):
        history().at(0)
    assert not history().known
    assert history((0, 1.0)).known


@given(st.integers(1, 300), st.floats(0, 1))
def test_a_straight_motion_is_read_back_exactly(count: int, share: float) -> None:
    made = history(*((1000 * step, float(step)) for step in range(count)))
    oldest = max(0, count - 64)
    t_ns = round(1000 * (oldest + share * (count - 1 - oldest)))
    np.testing.assert_allclose(made.at(t_ns), [t_ns / 1000, -t_ns / 1000], atol=1e-9)
