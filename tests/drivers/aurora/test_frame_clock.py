"""Frame numbers become host times, whatever the transport does to the replies."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from drivers.aurora.frame_clock import FrameClock

PERIOD_NS = 25_000_000
MS = 1_000_000
S = 1_000_000_000


@dataclass
class Seen:
    """One frame as the host sees it."""

    number: int
    measured_ns: int
    arrived_ns: int


def frames(
    seconds: float,
    delay_ns: Callable[[int], float],
    drift: float = 0.0,
    first_number: int = 8,
    every: int = 1,
) -> Iterator[Seen]:
    """A device whose clock runs slow by `drift`, and the delay of its k-th reply."""
    for k in range(0, round(seconds * S / PERIOD_NS), every):
        measured_ns = 5 * S + round(k * PERIOD_NS * (1.0 + drift))
        number = (first_number + 8 * k) % 2**32
        yield Seen(number, measured_ns, measured_ns + round(delay_ns(k)))


def errors_ms(clock: FrameClock, seen: Iterator[Seen], after_s: float) -> np.ndarray:
    """Estimated minus true measurement time, from `after_s` on."""
    found = [(f, clock.observe(f.number, f.arrived_ns)) for f in seen]
    times = [t for _, t in found]
    assert all(later > earlier for earlier, later in pairwise(times))
    assert all(t <= f.arrived_ns for f, t in found)
    late = [(t - f.measured_ns) / MS for f, t in found if f.measured_ns - 5 * S >= after_s * S]
    return np.array(late)


def exponential(mean_ms: float, seed: int = 0) -> Callable[[int], float]:
    random = np.random.default_rng(seed)
    return lambda k: random.exponential(mean_ms * MS)


def test_a_constant_delay_is_all_that_stays_unknown() -> None:
    errors = errors_ms(FrameClock(320.0), frames(10, lambda k: 3 * MS), 0.0)
    assert errors == pytest.approx(3.0, abs=1e-5)


@pytest.mark.parametrize("drift", [0.0, 25e-6, -25e-6, 100e-6, -100e-6])
def test_jitter_and_drift_leave_a_tenth_of_a_millisecond(drift: float) -> None:
    clock = FrameClock(320.0)
    errors = errors_ms(clock, frames(120, exponential(1.0), drift), 20.0)
    assert np.abs(errors).max() < 0.15
    assert clock.drift == pytest.approx(drift, abs=10e-6)


@pytest.mark.parametrize("drift", [100e-6, -100e-6])
def test_before_the_drift_is_known_the_error_stays_below_a_millisecond(drift: float) -> None:
    errors = errors_ms(FrameClock(320.0), frames(20, exponential(0.3), drift), 1.0)
    assert np.abs(errors).max() < 1.0


def test_late_frames_are_dated_as_if_they_had_been_in_time() -> None:
    jitter = exponential(0.2)
    seen = frames(60, lambda k: jitter(k) + (80 * MS if k % 10 == 3 else 0))
    assert np.abs(errors_ms(FrameClock(320.0), seen, 1.0)).max() < 0.2


def test_ten_seconds_of_nothing_but_late_frames_move_the_clock_little() -> None:
    jitter = exponential(0.2)
    late = range(1600, 2000)
    seen = frames(100, lambda k: jitter(k) + (20 * MS if k in late else 0), 50e-6)
    assert np.abs(errors_ms(FrameClock(320.0), seen, 20.0)).max() < 1.0


def test_a_late_first_frame_is_forgotten() -> None:
    seen = frames(10, lambda k: 20 * MS if k == 0 else 0.0)
    assert np.abs(errors_ms(FrameClock(320.0), seen, 0.2)).max() < 0.01


def test_the_counter_may_wrap_around() -> None:
    clock = FrameClock(320.0)
    seen = frames(20, exponential(0.2), first_number=2**32 - 8 * 400)
    assert np.abs(errors_ms(clock, seen, 1.0)).max() < 0.25
    assert clock.jumps == 0


def test_missed_frames_and_odd_steps_do_not_matter() -> None:
    clock = FrameClock(320.0)
    assert np.abs(errors_ms(clock, frames(60, exponential(0.2), every=3), 5.0)).max() < 0.3
    assert clock.jumps == 0


@pytest.mark.parametrize("jump", [100_000, -1000, 2**31, 200])
def test_a_jump_of_the_counter_is_noticed_and_survived(jump: int) -> None:
    clock = FrameClock(320.0)
    before: list[int] = []
    after: list[int] = []
    for f in frames(60, exponential(0.2)):
        jumped = f.measured_ns >= 30 * S
        number = (f.number + (jump if jumped else 0)) % 2**32
        (after if jumped else before).append(clock.observe(number, f.arrived_ns) - f.measured_ns)
    assert clock.jumps == 1
    assert np.abs(after[5:]).max() < 0.5 * MS
    assert np.abs(before[5:]).max() < 0.5 * MS


def test_a_counter_that_fell_back_a_little_is_noticed_within_two_seconds() -> None:
    """The frames look 0.2 s late from then on; that could be a slow line, but not for ever."""
    clock = FrameClock(320.0)
    wrong_since = None
    stretched = 0
    for f in frames(30, lambda k: 0.0):
        number = f.number - (64 if f.measured_ns >= 15 * S else 0)
        if f.measured_ns == 15 * S:
            continue  # the very first would go backwards, which shows at once
        error_ns = clock.observe(number + 16 * 8, f.arrived_ns) - f.measured_ns
        if abs(error_ns) > MS:
            wrong_since = wrong_since or f.measured_ns
            stretched = f.measured_ns - wrong_since
    assert clock.jumps == 1
    assert stretched < 2 * S


def test_a_host_that_slept_through_ten_minutes_goes_on_where_it_was() -> None:
    clock = FrameClock(320.0)
    for f in frames(10, lambda k: 0.0):
        clock.observe(f.number, f.arrived_ns)
    for f in frames(620, lambda k: 0.0):
        if f.measured_ns > 610 * S:
            assert clock.observe(f.number, f.arrived_ns) == pytest.approx(f.measured_ns, abs=MS)
    assert clock.jumps == 0
