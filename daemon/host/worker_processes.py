"""Processes side by side, for long work that can be divided. Not to be used in an event loop."""

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Final

from daemon.host.own_processes import end_with_parent

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
