"""Upper limits of a contact's probability, and of the last minute's: each draw is one body."""

import numpy as np
import pytest
from scipy.stats import beta

from safety.risk.contact_figures import MINUTE_NS, MinuteBehind, most_touching, upper_limit

SAMPLES, STEP_NS = 1000, 25_000_000


def touching(*draws: int) -> np.ndarray:
    who = np.zeros(SAMPLES, bool)
    who[list(draws)] = True
    return who


@pytest.mark.parametrize("count", [0, 1, 37, 999])
def test_the_upper_limit_is_clopper_and_pearson_s(count: int) -> None:
    assert upper_limit(count, SAMPLES) == pytest.approx(beta.ppf(0.95, count + 1, SAMPLES - count))
    assert upper_limit(SAMPLES, SAMPLES) == 1.0


@pytest.mark.parametrize("count", [0, 1, 37, 999])
def test_as_many_may_touch_as_leave_the_upper_limit_at_the_risk(count: int) -> None:
    limit = upper_limit(count, SAMPLES)
    assert most_touching(limit, SAMPLES) == count
    assert most_touching(np.nextafter(limit, 0.0), SAMPLES) == count - 1


def test_steps_that_are_risky_for_the_same_bodies_do_not_add_up() -> None:
    minute, same = MinuteBehind(SAMPLES), touching(*range(20))
    for step in range(2000):
        minute.add(same, step * STEP_NS)
    assert minute.risk(2000 * STEP_NS) == upper_limit(20, SAMPLES) < 0.03


def test_steps_that_are_risky_for_others_add_up() -> None:
    minute = MinuteBehind(SAMPLES)
    for step in range(5):
        minute.add(touching(*range(20 * step, 20 * step + 20)), step * STEP_NS)
    assert minute.risk(5 * STEP_NS) == upper_limit(100, SAMPLES) > 0.1


def test_before_anything_nothing_is_known_to_touch() -> None:
    for t_ns in (-(10**18), 0, 10**18):
        assert MinuteBehind(SAMPLES).risk(t_ns) == pytest.approx(0.003, abs=1e-4)


def test_after_a_minute_it_is_forgotten_and_not_before() -> None:
    minute = MinuteBehind(SAMPLES)
    minute.add(touching(1, 2, 3), 1000)
    minute.add(touching(3, 4), 2000)
    assert minute.risk(1000 + MINUTE_NS - 1) == upper_limit(4, SAMPLES)
    assert minute.risk(1000 + MINUTE_NS) == upper_limit(2, SAMPLES)
    assert minute.risk(2000 + MINUTE_NS) == upper_limit(0, SAMPLES)


def test_a_clear_step_takes_nothing_back() -> None:
    minute = MinuteBehind(SAMPLES)
    minute.add(touching(*range(100)), 0)
    minute.add(touching(), STEP_NS)
    assert minute.risk(STEP_NS) == upper_limit(100, SAMPLES)


def test_when_all_touch_it_is_certain() -> None:
    minute = MinuteBehind(SAMPLES)
    minute.add(np.ones(SAMPLES, bool), 0)
    assert minute.risk(1) == 1.0
