"""What the loop knows of its own lateness."""

import gc

import pytest

from daemon.host.periodic_timer import Tick
from daemon.loop.timekeeping import Timekeeping, TimeSpent

MS = 1_000_000


class SetClock:
    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns


def timekeeping(clock: SetClock) -> Timekeeping:
    return Timekeeping(10 * MS, TimeSpent(clock))


def test_lateness_is_measured_against_when_a_cycle_was_due() -> None:
    made = timekeeping(SetClock())
    for cycle in range(100):
        made.cycle_begins(Tick(cycle * 10 * MS, 0), cycle * 10 * MS + MS // 10)
    median, high, highest = made.lateness_s()
    assert median == high == highest == 0.0001
    assert made.missed == 0
    assert made.cycle_rate_hz(990 * MS) == 50.0  # a hundred cycles within two seconds


def test_skipped_cycles_are_counted_and_the_gap_is_seen() -> None:
    made = timekeeping(SetClock())
    made.cycle_begins(Tick(0, 0), 0)
    made.cycle_begins(Tick(50 * MS, 4), 52 * MS)
    assert made.missed == 4
    assert made.last_gap_ns == 52 * MS


def test_a_late_cycle_is_blamed_on_the_part_that_took_the_time() -> None:
    made = timekeeping(SetClock())
    made.cycle_begins(Tick(0, 0), 0)
    made.step_ended(2 * MS, 33 * MS, 34 * MS)
    made.cycle_begins(Tick(30 * MS, 2), 35 * MS)
    assert "control step took 32.0 ms" in made.last_overrun


def test_a_step_counts_until_its_targets_are_on_the_bus() -> None:
    made = timekeeping(SetClock())
    made.step_ended(2 * MS, 4 * MS, 34 * MS)
    assert made.step_s() == pytest.approx((2e-3, 2e-3, 2e-3))


def test_a_late_cycle_is_blamed_on_the_collector() -> None:
    clock = SetClock()
    spent = TimeSpent(clock)
    made = Timekeeping(10 * MS, spent)
    spent.watch_collector()
    try:
        made.cycle_begins(Tick(0, 0), 0)
        gc.callbacks[-1]("start", {})
        clock.t_ns = 20 * MS
        gc.callbacks[-1]("stop", {})
        made.cycle_begins(Tick(20 * MS, 1), 22 * MS)
    finally:
        spent.close()
    assert "garbage collection took" in made.last_overrun
    assert spent._collecting not in gc.callbacks


def test_when_none_of_our_parts_took_the_time_somebody_else_did() -> None:
    made = timekeeping(SetClock())
    made.cycle_begins(Tick(0, 0), 0)
    made.cycle_begins(Tick(10 * MS, 0), 18 * MS)
    assert made.last_overrun.startswith("8.0 ms late: ")
    assert "control step" not in made.last_overrun


def test_a_gap_on_purpose_is_no_gap() -> None:
    made = timekeeping(SetClock())
    made.cycle_begins(Tick(0, 0), 0)
    made.forgive()
    made.cycle_begins(Tick(500 * MS, 49), 500 * MS)
    assert made.last_gap_ns == 0
