"""The bus cycle's rhythm: absolute deadlines, whole periods skipped, none caught up."""

import asyncio
from pathlib import Path

from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.periodic_timer import LoopTimer, Tick, TimerFd
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock

MS = 1_000_000


def open_descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_ticks_are_due_on_an_absolute_grid() -> None:
    async def test() -> list[Tick]:
        clock, ticks = MonotonicClock(), list[Tick]()
        first_ns = clock.now_ns() + MS
        timer = TimerFd(first_ns, 2 * MS, ticks.append)
        await asyncio.sleep(0.05)
        timer.stop()
        assert all((tick.due_ns - first_ns) % (2 * MS) == 0 for tick in ticks)
        return ticks

    ticks = run_in_real_time(test())
    assert len(ticks) + sum(tick.skipped for tick in ticks) >= 20


def test_a_late_loop_skips_whole_periods_and_says_how_many() -> None:
    async def test() -> None:
        clock, ticks = MonotonicClock(), list[Tick]()
        timer = TimerFd(clock.now_ns(), MS, ticks.append)
        while not ticks:
            await asyncio.sleep(0.001)
        before = len(ticks)
        until_ns = clock.now_ns() + 20 * MS
        while clock.now_ns() < until_ns:
            pass
        await asyncio.sleep(0)
        await asyncio.sleep(0)
        late = ticks[before]
        assert late.skipped >= 18
        assert late.due_ns <= clock.now_ns()
        assert late.due_ns - ticks[before - 1].due_ns == (late.skipped + 1) * MS
        timer.stop()

    run_in_real_time(test())


def test_a_stopped_timer_is_silent_and_leaves_no_descriptor() -> None:
    async def test() -> None:
        before, ticks = open_descriptors(), list[Tick]()
        for _ in range(100):
            timer = TimerFd(MonotonicClock().now_ns(), MS, ticks.append)
            timer.stop()
            timer.stop()
        await asyncio.sleep(0.005)
        assert ticks == []
        assert open_descriptors() == before

    run_in_real_time(test())


def test_in_virtual_time_no_tick_is_ever_late() -> None:
    async def test() -> None:
        clock, ticks, seen = virtual_clock(), list[Tick](), list[int]()

        def on_tick(tick: Tick) -> None:
            ticks.append(tick)
            seen.append(clock.now_ns())

        timer = LoopTimer(5 * MS, 10 * MS, on_tick)
        await asyncio.sleep(1.0)
        timer.stop()
        assert [tick.due_ns for tick in ticks] == list(range(5 * MS, 1000 * MS, 10 * MS))
        assert seen == [tick.due_ns for tick in ticks]
        assert not any(tick.skipped for tick in ticks)

    run_in_virtual_time(test())
