"""What may block for ever never holds its caller, the event loop's end or the process' end."""

import asyncio
import subprocess
import sys
import threading
import time
from collections.abc import Coroutine
from pathlib import Path
from typing import Any

import pytest

from drivers.bounded import end_tasks, in_own_thread


def run(main: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(20.0):
            await main

    asyncio.run(limited())


async def until(event: threading.Event) -> None:
    while not event.is_set():
        await asyncio.sleep(0.005)


def test_a_call_gives_its_result_or_its_error() -> None:
    async def test() -> None:
        def fails(text: str) -> int:
            raise ValueError(text)

        def adds(a: int, b: int) -> int:
            return a + b

        unwanted: list[int] = []
        assert await in_own_thread(adds, 7, 2, unwanted=unwanted.append) == 9
        with pytest.raises(ValueError, match="so it is"):
            await in_own_thread(fails, "so it is", unwanted=unwanted.append)
        assert unwanted == []

    run(test())


def test_a_cancelled_caller_goes_at_once_and_the_late_result_is_disposed_of() -> None:
    async def test() -> None:
        may_end, disposed = threading.Event(), threading.Event()
        results: list[str] = []

        def slow() -> str:
            may_end.wait(20.0)
            return "late"

        def dispose(result: str) -> None:
            results.append(result)
            disposed.set()

        task = asyncio.create_task(in_own_thread(slow, unwanted=dispose))
        await asyncio.sleep(0.05)
        began_s = time.monotonic()
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert time.monotonic() - began_s < 1.0
        assert results == []
        may_end.set()
        await until(disposed)
        assert results == ["late"]

    run(test())


def test_a_result_that_comes_together_with_the_cancellation_is_disposed_of_too() -> None:
    async def test() -> None:
        may_end, disposed = threading.Event(), threading.Event()
        results: list[str] = []

        def slow() -> str:
            may_end.wait(20.0)
            return "just in time"

        def dispose(result: str) -> None:
            results.append(result)
            disposed.set()

        task = asyncio.create_task(in_own_thread(slow, unwanted=dispose))
        await asyncio.sleep(0.05)
        thread = next(one for one in threading.enumerate() if one.name == "call slow")
        may_end.set()
        # The loop stands still until the result waits for it; the cancellation stands behind it.
        thread.join(20.0)
        asyncio.get_running_loop().call_soon(task.cancel)
        with pytest.raises(asyncio.CancelledError):
            await task
        await until(disposed)
        assert results == ["just in time"]

    run(test())


def test_a_result_that_comes_after_the_loop_is_disposed_of_too() -> None:
    may_end, disposed = threading.Event(), threading.Event()

    def slow() -> str:
        may_end.wait(20.0)
        return "late"

    async def test() -> None:
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.05):
                await in_own_thread(slow, unwanted=lambda _: disposed.set())

    run(test())
    may_end.set()
    assert disposed.wait(20.0)


def test_neither_loop_nor_process_waits_for_a_call_that_never_ends() -> None:
    program = """
import asyncio, threading
from drivers.bounded import in_own_thread

async def main():
    try:
        async with asyncio.timeout(0.1):
            await in_own_thread(threading.Event().wait, unwanted=print)
    except TimeoutError:
        print("went on", flush=True)

asyncio.run(main())
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=30.0,
        check=True,
    )
    assert done.stdout == "went on\n"


def test_tasks_are_ended_in_time_even_where_one_swallows_its_cancellation() -> None:
    async def test() -> None:
        released = asyncio.Event()

        async def stubborn() -> None:
            while not released.is_set():
                try:
                    await released.wait()
                except asyncio.CancelledError:
                    continue

        async def breaks() -> None:
            raise ValueError("nobody asks")

        async def decent() -> None:
            await asyncio.sleep(100.0)

        tasks = [asyncio.create_task(work()) for work in (stubborn, breaks, decent)]
        await asyncio.sleep(0.01)
        began_s = time.monotonic()
        assert not await end_tasks(tasks, 0.2)
        assert time.monotonic() - began_s < 5.0
        assert [task.done() for task in tasks] == [False, True, True]
        released.set()
        assert await end_tasks(tasks, 5.0)
        assert await end_tasks([], 0.0)

    run(test())
