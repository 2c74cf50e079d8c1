"""The lab and the daemon, started and ended together: the daemon first, while its lab still is."""

import asyncio
import ctypes
import signal
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from contextlib import suppress
from pathlib import Path
from typing import Final

_STARTS_WITHIN_S: Final = 60.0
_ENDS_WITHIN_S: Final = 10.0
_PR_SET_PDEATHSIG: Final = 1
_PRCTL: Final = ctypes.CDLL(None).prctl


class ProcessError(RuntimeError):
    """A process did not start; the text says which, and what it said."""


class Processes:
    """Both in sessions of their own: Ctrl-C is for us, and we end them in order."""

    def __init__(self, robot: Path, directory: Path, runs: Path) -> None:
        where = [str(robot), "--runtime-dir", str(directory)]
        self._commands = (["emulate", *where], ["run", *where, "--runs", str(runs)])
        self._running: list[Process] = []

    async def start(self) -> None:
        """Raises ProcessError."""
        for command in self._commands:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "daemon.cli",
                *command,
                stdin=DEVNULL,
                stdout=PIPE,
                start_new_session=True,
                preexec_fn=_end_with_parent,
            )
            self._running.append(process)
            await self._begun(process, command[0])

    async def end(self) -> None:
        """The daemon first: it brings the drives to rest."""
        for process in reversed(self._running):
            with suppress(ProcessLookupError):
                process.terminate()
            try:
                async with asyncio.timeout(_ENDS_WITHIN_S):
                    await process.wait()
            except TimeoutError:
                process.kill()
                await process.wait()
        self._running.clear()

    async def _begun(self, process: Process, name: str) -> None:
        """It speaks when it is ready."""
        assert process.stdout is not None
        try:
            async with asyncio.timeout(_STARTS_WITHIN_S):
                line = await process.stdout.readline()
        except TimeoutError:
            raise ProcessError(f"`tentacled {name}` did not get ready in time") from None
        if not line:
            raise ProcessError(f"`tentacled {name}` ended at once; see above for why")


def _end_with_parent() -> None:
    """In the child: should we be killed without a chance to end it, the kernel does."""
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)
