"""Commands as they are typed, against a daemon that runs beside them."""

import asyncio
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from config.remote import Remote
from daemon.commands.terminal.command_line import main
from daemon.remote.client.token_file import StoredLease, store_lease, token_file
from daemon.remote.server.server import RemoteServer
from tests.daemon.remote.rig import ROBOT, WITHIN_S, FakeRobot


def tentacled(name: str, *words: str | Path) -> int:
    """`tentacled name words`, in this process. Returns the exit code."""
    return main([name, *map(str, words)])


@contextmanager
def started(name: str, *words: str | Path) -> Iterator[subprocess.Popen[str]]:
    """The same in a process of its own, for what goes on until it is told to end."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-u",
            "-m",
            "daemon.commands.terminal.command_line",
            name,
            *map(str, words),
        ],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            assert stream is not None
            with suppress(BrokenPipeError):  # what was written last, and nobody reads
                stream.close()


class Daemon:
    """A server on an event loop in a thread of its own."""

    def __init__(self, folder: Path, robot: FakeRobot | None = None) -> None:
        self.robot = robot or FakeRobot()
        self.server = RemoteServer(
            ROBOT, Remote(), folder, self.robot, simulated=True, version="1.2.3"
        )
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)

    def __enter__(self) -> FakeRobot:
        self._thread.start()
        asyncio.run_coroutine_threadsafe(self.server.open(), self._loop).result(WITHIN_S)
        return self.robot

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self.server.close(), self._loop).result(WITHIN_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()


def hold_lease(folder: Path, robot: FakeRobot, user: str = "local") -> None:
    token = robot.lease.acquire(user, "", robot.clock.now_ns())
    assert token is not None
    store_lease(token_file(folder, user), StoredLease(user, token))
