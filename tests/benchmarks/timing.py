"""What all measurements share: percentiles, and how noisy this machine is."""

import os
import platform
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Figures = dict[str, Any]


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
