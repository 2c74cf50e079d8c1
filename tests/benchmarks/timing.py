"""What all measurements share: percentiles, pieces that fail alone, how slow the machine is."""

import os
import platform
import subprocess
import sys
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

Figures = dict[str, Any]

STATED_REFERENCE_MS: Final = 54.0
"""What a million turns of the reference loop took on the machine of docs/figures.md."""
_TURNS: Final = 1_000_000
REFERENCE_TURNS_IN_1_MS: Final = round(_TURNS / STATED_REFERENCE_MS)
_LINES_OF_A_TRACEBACK: Final = 12


def pieces(named: Mapping[str, Callable[[], Figures]]) -> Figures:
    """Each piece's figures with the reference loop beside them, or how it failed."""
    return {name: _piece(name, measure) for name, measure in named.items()}


def _piece(name: str, measure: Callable[[], Figures]) -> Figures:
    print(f"  {name}", file=sys.stderr, flush=True)
    before = reference_ms()
    try:
        figures = measure()
    except Exception as error:
        figures = failure(error)
        print(f"  {name} failed: {figures['failed']}", file=sys.stderr, flush=True)
    return figures | {"reference_loop": reference_figures([before, reference_ms()])}


def failure(error: Exception) -> Figures:
    """What stands in place of figures."""
    lines = "".join(traceback.format_exception(error)).splitlines()
    return {
        "failed": f"{type(error).__name__}: {error}",
        "traceback": lines[-_LINES_OF_A_TRACEBACK:],
    }


def reference_ms(turns: int = _TURNS) -> tuple[float, float]:
    """What a small loop of plain Python takes: wall clock, and CPU time.

    Where the second is more than stated, the processor is slower; where the first is more than the
    second, other programs had the core.
    """
    began_ns, cpu_ns, total = time.perf_counter_ns(), time.thread_time_ns(), 0
    for turn in range(turns):
        total += turn * turn % 7
    return (time.perf_counter_ns() - began_ns) * 1e-6, (time.thread_time_ns() - cpu_ns) * 1e-6


def reference_figures(measured_ms: Sequence[tuple[float, float]]) -> Figures:
    """By how much this machine was slower than the stated one, meanwhile."""
    walls, cpus = zip(*measured_ms, strict=True)
    return {
        "ms": [round(wall, 1) for wall in walls],
        "times_slower": round(float(np.mean(walls)) / STATED_REFERENCE_MS, 2),
        "times_slower_without_other_programs": round(float(np.mean(cpus)) / STATED_REFERENCE_MS, 2),
    }


def end_process(process: "subprocess.Popen[Any]", within_s: float = 60.0) -> None:
    """Close its standard input, and see it end, by force where it does not by itself."""
    try:
        process.communicate(timeout=within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


def percentiles(values: Sequence[float], scale: float = 1.0) -> Figures:
    """Median, p99 and worst of `values`, times `scale`."""
    array = np.asarray(values, dtype=np.float64) * scale
    return {
        "median": round(float(np.median(array)), 3),
        "p99": round(float(np.percentile(array, 99)), 3),
        "max": round(float(array.max()), 3),
        "count": len(array),
    }


def machine() -> Figures:
    """What ran this."""
    return {
        "python": platform.python_version(),
        "kernel": platform.release(),
        "cores": os.cpu_count(),
        "processor": _processor(),
        "load_average": os.getloadavg()[0],
        "gaps_of_a_spinning_loop_us": spinning_gaps(),
        "reference_loop": reference_figures([reference_ms() for _ in range(5)]),
    }


def spinning_gaps(duration_s: float = 2.0) -> Figures:
    """The machine's own noise: how long a loop that does nothing else is kept from running."""
    gaps, before = [], time.perf_counter_ns()
    end = before + round(duration_s * 1e9)
    while before < end:
        now = time.perf_counter_ns()
        if now - before > 50_000:
            gaps.append((now - before) / 1e3)
        before = now
    return percentiles(gaps) if gaps else {"count": 0}


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        return next(line for line in lines if line.startswith("model name")).split(": ")[1]
    except (OSError, StopIteration):
        return platform.processor()
