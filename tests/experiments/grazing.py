"""A ball in a body's way, many times over: with the model nothing is touched.

`python -m tests.experiments.grazing` takes half an hour on two cores. Every seed is another body,
another noise and another side, see `tests.daemon.service.grazing`; each goes round with the model
and without. Ends with exit code 1 where one touches with it, or does not get round, or does not
touch without it. Prints one JSON. `--tubes`: concentric tubes instead of the tendon arm;
`--aware-only`: with the model alone, and then also one that is held is good.
"""

import argparse
import json
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from daemon.host.processes import worker_processes
from safety.states import OperatingState
from tests.daemon.service.grazing import PAST_TUBES, TENDONS, Grazed, Subject, graze


def each_way(
    seed: int, subject: Subject = TENDONS, ways: Sequence[bool] = (True, False)
) -> list[Grazed]:
    """With the model and without."""
    with tempfile.TemporaryDirectory() as name:
        os.environ["XDG_CACHE_HOME"] = name
        return [graze(seed, Path(name), known, subject=subject) for known in ways]


def tubes_each_way(seed: int) -> list[Grazed]:
    return each_way(seed, PAST_TUBES)


def tubes_aware(seed: int) -> list[Grazed]:
    return each_way(seed, PAST_TUBES, (True,))


def figures_of(found: Sequence[Sequence[Grazed]]) -> dict[str, Any]:
    """For JSON."""
    aware, *others = zip(*found, strict=True)
    figures: dict[str, Any] = {
        "seeds": len(found),
        "with_the_model": {
            "touched": sum(one.least_clearance_mm <= 0.0 for one in aware),
            "got_round": sum(one.state is OperatingState.ARMED for one in aware),
            "not_armed": sum(one.state is OperatingState.READY for one in aware),
            "least_clearance_mm": _spread([one.least_clearance_mm for one in aware]),
            "highest_risk": max(one.highest_risk or 0.0 for one in aware),
            "steps": sum(one.steps for one in aware),
            "turned_aside": sum(one.slid for one in aware),
            "seeds_turned_aside": sum(one.slid > 0 for one in aware),
            "shortened_by_the_gate": sum(one.shortened for one in aware),
            "mean_error_mm": _spread([one.mean_error_mm for one in aware]),
            "ended_with": Counter(cause for one in aware for cause in sorted(one.causes)),
        },
    }
    for unaware in others:
        figures["without"] = {
            "touched": sum(one.least_clearance_mm <= 0.0 for one in unaware),
            "least_clearance_mm": _spread([one.least_clearance_mm for one in unaware]),
            "mean_error_mm": _spread([one.mean_error_mm for one in unaware]),
        }
    return figures


def _spread(values: Sequence[float]) -> dict[str, float]:
    lowest, median, highest = np.nanquantile(values, (0.0, 0.5, 1.0)).round(2).tolist()
    return {"lowest": lowest, "median": median, "highest": highest}


def main() -> int:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100, metavar="N")
    parser.add_argument("--first", type=int, default=1, metavar="N", help="of the seeds")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    parser.add_argument("--tubes", action="store_true")
    parser.add_argument("--aware-only", action="store_true")
    arguments = parser.parse_args()
    which = tubes_each_way if arguments.tubes else each_way
    if arguments.aware_only:
        which = tubes_aware
    with worker_processes(arguments.processes) as workers:
        found = []
        seeds = range(arguments.first, arguments.first + arguments.seeds)
        for seed, one in zip(seeds, workers.map(which, seeds), strict=True):
            found.append(one)
            print(f"seed {seed}: {one}", file=sys.stderr, flush=True)
    figures = figures_of(found)
    print(json.dumps(figures, indent=2))
    good = figures["with_the_model"]
    if arguments.aware_only:
        return 1 if good["touched"] else 0
    without = figures["without"]["touched"]
    bad = good["touched"] or good["got_round"] < len(found) or without < len(found)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
