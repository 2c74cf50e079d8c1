"""Requests find the moment at which a frame is ready, and stay just behind it."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

from drivers.aurora.polling import PollTiming

MS = 1_000_000
S = 1_000_000_000
PERIOD_NS = 25 * MS


@dataclass
class Run:
    """What came of a stretch of polling."""

    ages_ns: list[int] = field(default_factory=list)
    """From a frame's being ready to the sending of the request that fetched it."""
    frames: int = 0
    missed: int = 0
    repeats: int = 0


def poll(
    seconds: float,
    round_trip_ns: int,
    drift: float = 0.0,
    hold: bool = False,
    jitter_ns: Callable[[], int] = lambda: 0,
    settle_s: float = 5.0,
) -> Run:
    """Ask a device with frames at 7 ms + k periods, by its own clock."""
    timing, run = PollTiming(PERIOD_NS), Run()
    period_ns = PERIOD_NS * (1.0 + drift)
    now_ns, last = 0, -1
    while now_ns < seconds * S:
        now_ns = timing.next_request_ns(now_ns) + jitter_ns()
        frame = int((now_ns - 7 * MS) // period_ns)
        sent_ns = now_ns
        if hold and frame == last:
            frame += 1
            now_ns = round(7 * MS + frame * period_ns)
        now_ns += round_trip_ns
        settled = now_ns > settle_s * S
        if frame == last:
            timing.repeated(sent_ns)
            run.repeats += settled
            continue
        timing.fresh(sent_ns, frame - last)
        run.frames += settled
        run.missed += (frame - last - 1) * settled
        if settled:
            run.ages_ns.append(sent_ns - round(7 * MS + frame * period_ns))
        last = frame
    return run


@pytest.mark.parametrize("round_trip_ms", [0.3, 2, 10, 20])
@pytest.mark.parametrize("drift", [0.0, 100e-6, -100e-6])
def test_frames_are_asked_for_half_a_millisecond_after_they_are_ready(
    round_trip_ms: float, drift: float
) -> None:
    run = poll(60.0, round(round_trip_ms * MS), drift)
    assert run.missed == 0
    assert run.repeats <= 0.02 * run.frames
    assert np.median(run.ages_ns) < 0.7 * MS


def test_the_moment_is_found_within_two_seconds() -> None:
    run = poll(10.0, 10 * MS, settle_s=2.0)
    assert np.percentile(run.ages_ns, 95) < 1.0 * MS


def test_jitter_of_the_host_costs_few_repeats() -> None:
    random = np.random.default_rng(0)
    run = poll(60.0, 2 * MS, jitter_ns=lambda: round(random.exponential(0.6 * MS)))
    assert run.missed == 0
    assert run.repeats <= 0.02 * run.frames


def test_a_slow_line_is_used_back_to_back() -> None:
    run = poll(20.0, 111 * MS)
    assert run.repeats == 0
    assert run.frames == pytest.approx(15 / 0.111, abs=2)


def test_a_device_that_holds_its_reply_is_always_asked_beforehand() -> None:
    run = poll(20.0, 2 * MS, hold=True)
    assert run.missed == run.repeats == 0
    assert max(run.ages_ns) < 0


def test_a_stall_of_the_host_does_not_lose_the_rhythm() -> None:
    stalls = iter([0] * 300 + [400 * MS] + [0] * 10_000)
    run = poll(20.0, 2 * MS, jitter_ns=lambda: next(stalls), settle_s=9.0)
    assert run.missed == 0
    assert np.median(run.ages_ns) < 0.7 * MS


def test_frames_that_stop_and_go_on_elsewhere_are_found_again() -> None:
    timing = PollTiming(PERIOD_NS)
    timing.repeated(0)
    timing.fresh(10 * MS, 1)
    assert timing.next_request_ns(11 * MS) == 35 * MS
    for sent_ms in range(35, 500, 10):
        timing.repeated(sent_ms * MS)
    timing.fresh(505 * MS, 20)
    assert timing.next_request_ns(506 * MS) == 530 * MS
