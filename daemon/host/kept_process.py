"""A process that serves ours: made again should it end, and gone when we are."""

import asyncio
import subprocess
import sys
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import Final

_LOOK_EVERY_S: Final = 0.25
_LOOK_AT_ENDING_S: Final = 0.01
_ENDS_WITHIN_S: Final = 1.0


class KeptProcess:
    """`python -m MODULE ARGUMENTS`. Its standard input ends when it shall, and when we have died.

    Sockets stay ours: they are there while the process is made again.
    """

    def __init__(
        self,
        module: str,
        arguments: Sequence[str],
        descriptors: Sequence[int],
        told: Callable[[Exception], None],
    ) -> None:
        """descriptors: of sockets that it gets, by the same numbers. told: why it is made again."""
        self._command = [sys.executable, "-m", module, *arguments]
        self._descriptors = tuple(descriptors)
        self._told = told
        self._process: subprocess.Popen[bytes] | None = None
        self._watching: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Returns when it runs. Raises OSError."""
        self._process = await asyncio.to_thread(self._made)
        self._watching = asyncio.get_running_loop().create_task(self._watch())

    async def close(self) -> None:
        """Takes a second at most. May be repeated."""
        if self._watching is not None:
            self._watching.cancel()
            await asyncio.gather(self._watching, return_exceptions=True)
        process, self._process = self._process, None
        if process is None:
            return
        _let_go(process)
        with suppress(TimeoutError):
            async with asyncio.timeout(_ENDS_WITHIN_S):
                while process.poll() is None:
                    await asyncio.sleep(_LOOK_AT_ENDING_S)
        process.kill()
        process.wait()

    def _made(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=self._descriptors,
            start_new_session=True,
        )

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(_LOOK_EVERY_S)
            process = self._process
            if process is None or process.poll() is None:
                continue
            self._told(RuntimeError(f"it ended with {process.returncode} and is started again"))
            _let_go(process)
            try:
                self._process = await asyncio.to_thread(self._made)
            except OSError as error:
                self._told(error)


def _let_go(process: subprocess.Popen[bytes]) -> None:
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.close()
