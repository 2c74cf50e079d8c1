"""From nothing to following: an arm explores itself for sixteen seconds, and goes round a circle.

`python -m tests.experiments.from_nothing`. On each named body of the soft arm, with nothing at its
tip and with 14.2 g: the exploration is of the same body, empty, and its seed differs; then three to
seven seconds of small motions tell how late it is, and a circle of 30 mm radius is followed at
10 mm/s, twice, learning. Prints one JSON: of each body and load the mean errors of the first and
the second cycle, one for each seed, in mm.
"""

import argparse
import json
import tempfile
from collections.abc import Iterator
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, Final

import numpy as np

from config.emulation.bodies import BODY_NAMES
from daemon.host.processes import worker_processes
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.pretraining.model_cache import with_model
from tests import SHIPPED_ROBOTS

_CIRCLE: Final = SHIPPED_ROBOTS.parent / "experiments" / "fast_circle.yaml"
_LOADS_G: Final = (0.0, 14.2)
_RADIUS_MM, _SPEED_MM_S = 30.0, 10.0

Case = tuple[str, float, int]


def cases(seeds: int) -> Iterator[Case]:
    """Body, load in g, and seed."""
    for body in BODY_NAMES:
        for load_g in _LOADS_G:
            yield from ((body, load_g, seed) for seed in range(1, seeds + 1))


def errors_mm(case: Case) -> list[float]:
    """Of each cycle, the mean."""
    body, load_g, seed = case
    changes: dict[str, Any] = {
        "plant": {"body": body},
        "trajectory": {
            "kind": "circle",
            "center_mm": [0.0, 0.0, 185.0],
            "radius_mm": _RADIUS_MM,
            "cycle_s": 2.0 * np.pi * _RADIUS_MM / _SPEED_MM_S,
            "cycles": 2,
        },
        "tip_load_g": load_g,
        "pretraining": {"waypoints": None, "seed": seed},
        "blend_speed_mm_s": 20.0,
    }
    with tempfile.TemporaryDirectory() as name:
        file = with_model(load_experiment(_CIRCLE, changes), seed, _nobody)
        result = carry_out_in_virtual_time(file, seed, Path(name), _nobody)
    return [round(cycle.mean_mm, 3) for cycle in result.cycles]


def _nobody(line: str) -> None:
    """Hears what happens."""


def main() -> None:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3, metavar="N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    arguments = parser.parse_args()
    found: dict[Case, list[float]] = {}
    with worker_processes(arguments.processes) as workers:
        tasks = {workers.submit(errors_mm, case): case for case in cases(arguments.seeds)}
        for task in as_completed(tasks):
            found[tasks[task]] = task.result()
    grouped: dict[str, list[list[float]]] = {}
    for body, load_g, seed in cases(arguments.seeds):
        grouped.setdefault(f"{body}, {load_g:g} g", []).append(found[body, load_g, seed])
    lines = {name: list(zip(*cycles, strict=True)) for name, cycles in grouped.items()}
    print(json.dumps(lines, indent=2))


if __name__ == "__main__":
    main()
