"""Processes of our own: commands in order, one that is made again, and workers."""

import asyncio
import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final

_STARTS_WITHIN_S: Final = 60.0
_ENDS_WITHIN_S: Final = 10.0
_KILLED_WITHIN_S: Final = 5.0
_KEPT_ENDS_WITHIN_S: Final = 1.0
_LOOK_EVERY_S: Final = 0.25
_LOOK_AT_ENDING_S: Final = 0.01
_PR_SET_PDEATHSIG: Final = 1
_PRCTL: Final = ctypes.CDLL(None).prctl


@dataclass(frozen=True)
class Share:
    """Of work that several machines do without hearing of each other: number `index` of `count`."""

    index: int
    """From 1."""
    count: int

    @classmethod
    def of(cls, text: str) -> "Share":
        """From `2/5`. Raises ValueError."""
        index, separator, count = text.partition("/")
        if not (separator and index.isdecimal() and count.isdecimal()):
            raise ValueError(f"a share is such as 2/5, not {text!r}")
        share = cls(int(index), int(count))
        if not 1 <= share.index <= share.count:
            raise ValueError(f"there is no share {share.index} of {share.count}")
        return share

    def has(self, number: int) -> bool:
        """Whether work of this number, from 0, is in it."""
        return number % self.count == self.index - 1

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"


WHOLE: Final = Share(1, 1)


class ProcessError(RuntimeError):
    """A process did not start; the text says which, and what it said."""


class OwnProcesses:
    """Each in a session of its own: Ctrl-C is for us, and we end them in order."""

    def __init__(self, *commands: Sequence[str]) -> None:
        """commands: the words after `tentacled`, of each process, in the order of starting."""
        self._commands = commands
        self._running: list[Process] = []

    async def start(self) -> None:
        """Returns when all are ready. Raises ProcessError; `end` is to be called then too."""
        for command in self._commands:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                "daemon.commands.terminal.command_line",
                *command,
                stdin=DEVNULL,
                stdout=PIPE,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
            self._running.append(process)
            await self._begun(process, command[0])

    async def end(self) -> None:
        """The last one first: a daemon brings its drives to rest while its lab still is."""
        for process in reversed(self._running):
            with suppress(ProcessLookupError):
                process.terminate()
            try:
                async with asyncio.timeout(_ENDS_WITHIN_S):
                    await process.wait()
            except TimeoutError:
                process.kill()
                with suppress(TimeoutError):  # while the kernel waits for a dead device
                    async with asyncio.timeout(_KILLED_WITHIN_S):
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


class KeptProcess:
    """Serves ours: made again should it end, and gone when we are.

    `python -m MODULE ARGUMENTS`: its standard input ends when it shall, and when we have died.
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
            async with asyncio.timeout(_KEPT_ENDS_WITHIN_S):
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


def end_with_parent() -> None:
    """In a child: should its parent be killed without a chance to end it, the kernel does."""
    _PRCTL(_PR_SET_PDEATHSIG, signal.SIGTERM)


# A process for one piece of work that would hold the loop, even in a thread.


class ApartError(RuntimeError):
    """There is no answer: the text says why."""


_LESS_URGENT: Final = 10


def answer_apart(module: str, request: bytes, within_s: float) -> bytes:
    """What `python -m MODULE` writes when it is given `request`. Blocks: call it in a thread.

    Raises ApartError where the process fails, or takes longer; it is ended then.
    """
    try:
        process = subprocess.Popen(
            [sys.executable, "-m", module],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
    except OSError as error:
        raise ApartError(f"cannot start {module}: {error.strerror or error}") from None
    try:
        answer, said = process.communicate(request, within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise ApartError(f"it took more than {within_s:g} s") from None
    if process.returncode != 0:
        last = said.decode("utf-8", "replace").strip().splitlines()[-1:]
        raise ApartError(f"{module} has ended with {process.returncode}: {''.join(last)}")
    return answer


def serve_apart(answer: Callable[[bytes], bytes]) -> None:
    """In that process: one request in, one answer out. Ends with whoever started it."""
    end_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with suppress(OSError):  # a real-time daemon's children inherit its priority
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(_LESS_URGENT)
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    # What others print is not part of the answer.
    with os.fdopen(os.dup(1), "wb") as out:
        os.dup2(2, 1)
        out.write(answer(sys.stdin.buffer.read()))


# Processes side by side, for long work that can be divided. Not to be used in an event loop.


_ONE_THREAD: Final = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""In processes that are as many as there are cores, threads are only in each other's way."""


@contextmanager
def worker_processes(count: int) -> Iterator[Executor]:
    """Processes that inherit nothing but the environment, and end with us.

    At once where we are interrupted.
    """
    for name in _ONE_THREAD:
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(count, mp_context=context, initializer=_begin)
    try:
        yield pool
    except BaseException:
        for child in multiprocessing.active_children():
            child.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def _begin() -> None:
    """In each process: Ctrl-C is for the one that started us."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    # numba, which who asks for help alone does not wait for.
    from daemon.host.compilation import forgive_caches

    forgive_caches()
