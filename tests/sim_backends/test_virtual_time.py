"""Virtual time: the same asyncio code, with a clock that jumps."""

import asyncio

import pytest

from sim_backends.virtual_time import (
    VirtualTimeDeadlockError,
    run_in_virtual_time,
    virtual_clock,
)


def test_an_hour_of_sleep_takes_no_time_and_ends_to_the_nanosecond() -> None:
    async def sleep() -> int:
        await asyncio.sleep(3600)
        return virtual_clock().now_ns()

    assert run_in_virtual_time(sleep()) == 3_600_000_000_000


def test_timers_fire_in_the_order_of_their_deadlines() -> None:
    async def order() -> list[str]:
        fired: list[str] = []

        async def wait(name: str, delay_s: float) -> None:
            await asyncio.sleep(delay_s)
            fired.append(name)

        await asyncio.gather(wait("c", 0.3), wait("a", 0.1), wait("b", 0.2), wait("a2", 0.1))
        return fired

    assert run_in_virtual_time(order()) == ["a", "a2", "b", "c"]


def test_timeouts_are_virtual_too() -> None:
    async def wait() -> int:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(12.0):
                await asyncio.Event().wait()
        return virtual_clock().now_ns()

    assert run_in_virtual_time(wait()) == 12_000_000_000


def test_waiting_for_what_never_comes_is_an_error_and_not_a_hang() -> None:
    async def wait() -> None:
        await asyncio.Event().wait()

    with pytest.raises(VirtualTimeDeadlockError):
        run_in_virtual_time(wait())


def test_the_date_is_always_the_same() -> None:
    async def date() -> int:
        return virtual_clock().wall_time_ns()

    assert run_in_virtual_time(date()) == run_in_virtual_time(date())
