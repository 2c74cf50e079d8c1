"""Sessions come to an end: without holding up the way down, and before the interpreter does."""

import asyncio
import atexit
import threading
from collections.abc import Callable
from contextlib import suppress

import zenoh


def open_until_exit(config: zenoh.Config) -> zenoh.Session:
    """A session that is closed at the latest when the interpreter ends. Blocks. Raises ZError.

    Otherwise zenoh's threads might call into an interpreter that is no longer there.
    """
    session = zenoh.open(config)
    atexit.register(session.close)
    return session


def close_session(session: zenoh.Session) -> None:
    """Close it now. Blocks."""
    atexit.unregister(session.close)
    session.close()  # type: ignore[no-untyped-call]


async def call_bounded(work: Callable[[], object], within_s: float) -> None:
    """Call what blocks; leave it behind after `within_s`: it must not hold the way down.

    asyncio's own threads would keep the process alive.
    """
    loop, done = asyncio.get_running_loop(), asyncio.Event()

    def run() -> None:
        with suppress(zenoh.ZError):
            work()
        with suppress(RuntimeError):  # the loop has not waited
            loop.call_soon_threadsafe(done.set)

    threading.Thread(target=run, name="remote close", daemon=True).start()
    with suppress(TimeoutError):
        async with asyncio.timeout(within_s):
            await done.wait()
