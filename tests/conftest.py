"""What holds for all tests."""

import gc
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

from tests.compile_once import compile_once
from tests.distribution import FileScheduling

pytest_plugins = ["daemon.testing.pytest_plugin"]
"""As whoever installs us has it: `-p no:tentacled` keeps the installed one away, which comes before
coverage does."""

RERUNS = 2
_REMOTE = {Path(__file__).parent / "daemon" / name for name in ("remote", "bridges")}
"""Real sessions over real sockets, with the threads of a library that is not ours."""
_REAL_TIME = ("hil", "page")
_LOOKED_THROUGH_AFTER = 5000
"""So many new objects: each worker has all tests in memory, and to look through them for garbage,
again and again, takes it a thirtieth of its time otherwise."""
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Of linear algebra in each worker, and in each process that its tests start: more would wait for
each other most of the time, and take the cores for it."""

# The same examples every time: what is found by chance must not decide whether a change is good.
# HYPOTHESIS_PROFILE=explore looks further. No deadlines: a busy machine is no defect.
settings.register_profile("suite", derandomize=True, deadline=None)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "suite"))

# Under `nohup` hang-ups are ignored, and Ctrl-C in a shell's background jobs; the processes that
# tests start would inherit that.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give tests in real time another try.

    They start processes that share the machine with everything else on it, and a machine that
    stands still for seconds is no defect of ours. What is broken fails every time.
    """
    for item in items:
        real_time = any(item.get_closest_marker(name) for name in _REAL_TIME)
        if real_time or _REMOTE & set(item.path.parents):
            item.add_marker(pytest.mark.flaky(reruns=RERUNS))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Of `--dist loadgroup` ours; None: xdist's own."""
    return FileScheduling(config, log) if config.getoption("dist") == "loadgroup" else None


def pytest_collection_finish(session: pytest.Session) -> None:
    """All that was collected stays: nobody need look through it for garbage."""
    if hasattr(session.config, "workerinput"):
        gc.freeze()


def pytest_configure(config: pytest.Config) -> None:
    """Workers share what they compile, and the cores."""
    if hasattr(config, "workerinput"):
        compile_once()
        gc.set_threshold(_LOOKED_THROUGH_AFTER, *gc.get_threshold()[1:])
    elif config.getoption("numprocesses", None):
        for name in _ONE_THREAD:
            os.environ.setdefault(name, "1")
