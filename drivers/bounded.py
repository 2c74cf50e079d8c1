"""Waiting that always ends: for calls that may block for ever, and for tasks that are cancelled."""

import asyncio
import threading
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, TypeVarTuple

T = TypeVar("T")
Arguments = TypeVarTuple("Arguments")


async def in_own_thread(
    function: Callable[[*Arguments], T], *arguments: *Arguments, unwanted: Callable[[T], object]
) -> T:
    """The result of a call that may block, made in a thread of its own.

    A caller that is cancelled goes at once; should the call end after all, `unwanted` is given its
    result, in another thread. Neither the event loop's end nor the process' waits for the thread:
    those of asyncio's executor are joined, and a dead adapter would keep the process for ever.
    """
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[T] = loop.create_future()

    def call() -> None:
        try:
            result = function(*arguments)
        except BaseException as error:  # whatever it is, the caller gets it
            _tell(loop, _fail, ended, error)
            return
        if not _tell(loop, _succeed, ended, result, unwanted):
            unwanted(result)

    threading.Thread(target=call, name=f"call {function.__name__}", daemon=True).start()
    try:
        return await ended
    except asyncio.CancelledError:
        # Cancelled after the result had come, and before this was woken by it: it is nobody's yet.
        if ended.done() and not ended.cancelled() and ended.exception() is None:
            _dispose(ended.result(), unwanted)
        raise


async def end_tasks(tasks: Iterable["asyncio.Task[Any]"], within_s: float) -> bool:
    """Cancel tasks and wait for their end, but no longer than `within_s`.

    Unlike `asyncio.gather` it does not wait for a task that swallows its cancellation. Returns
    whether all have ended. What they raise is nobody's business any more.
    """
    waiting = set(tasks)
    for task in waiting:
        task.cancel()
    if waiting:
        ended, waiting = await asyncio.wait(waiting, timeout=within_s)
        for task in ended:
            if not task.cancelled():
                task.exception()  # asked for, so that asyncio does not complain of it
    return not waiting


def _tell(
    loop: asyncio.AbstractEventLoop, callback: Callable[..., object], *arguments: Any
) -> bool:
    """False: the event loop has been closed meanwhile."""
    try:
        loop.call_soon_threadsafe(callback, *arguments)
    except RuntimeError:
        return False
    return True


def _succeed(ended: "asyncio.Future[T]", result: T, unwanted: Callable[[T], object]) -> None:
    if ended.done():  # cancelled
        _dispose(result, unwanted)
    else:
        ended.set_result(result)


def _dispose(result: T, unwanted: Callable[[T], object]) -> None:
    threading.Thread(target=unwanted, args=(result,), daemon=True).start()


def _fail(ended: "asyncio.Future[T]", error: BaseException) -> None:
    if not ended.done():
        ended.set_exception(error)
