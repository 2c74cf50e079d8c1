"""How long a command takes before it does anything: its help, beside bare Python."""

import subprocess
import sys
import time
from functools import partial
from typing import Final

from tests.benchmarks.timing import Figures, percentiles, pieces

TIMES: Final = 20
PROGRAM: Final = (sys.executable, "-m", "daemon.commands.terminal.command_line")
HELPS: Final = ("", "status", "stop", "export", "check", "run", "experiment", "dashboard")
"""Of these commands; the first is `tentacled --help` itself."""


def measure(tiny: bool = False) -> Figures:
    """Wall clock in ms, of processes that were started once before."""
    count = 2 if tiny else TIMES
    named = {f"help_{name}" if name else "help": (*PROGRAM, *name.split()) for name in HELPS}
    words = {name: (*command, "--help") for name, command in named.items()}
    words["python"] = (sys.executable, "-c", "pass")
    return pieces({name: partial(_started, one, count) for name, one in words.items()})


def _started(command: tuple[str, ...], count: int) -> Figures:
    def took_ns() -> int:
        began_ns = time.perf_counter_ns()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return time.perf_counter_ns() - began_ns

    took_ns()
    return {"ms": percentiles([took_ns() for _ in range(count)], 1e-6)}
