"""Loads that are hung on at once and taken off again, twice, while a circle is followed at 5 mm/s.

`python -m tests.experiments.load_steps --loads 15 30 45`. Each named body of the soft arm meets
each load with each seed, otherwise as in `builtin:load_step`: its controller's model was learnt on
the body as made, by another exploration for each seed. Prints one JSON: of each body and load how
long the tip took, since each of the four changes, until it stayed within 1 mm for a second, median
of the seeds, of the body's own tip and as the tracker sees it, in s; how many of all changes were
made up for within the limit; and how far beyond its reference the tip went at most, in mm.
"""

import argparse
import json
import math
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, Final

from config.emulation.bodies import BODY_NAMES
from config.emulation.plants import SoftArmPlant
from daemon.host.processes import worker_processes
from daemon.workbench.experiments.experiment_file import ExperimentFile, load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.measures import Recovery, measures_of
from daemon.workbench.pretraining.model_cache import with_model
from tests import SHIPPED_ROBOTS

LOAD_STEP: Final = SHIPPED_ROBOTS.parent / "experiments" / "load_step.yaml"
_PROMPT_LIMIT_S: Final = 0.7

Case = tuple[str, float, int]


def cases(bodies: Sequence[str], loads_g: Sequence[float], seeds: int) -> Iterator[Case]:
    """Body, load in g, and seed."""
    for body in bodies:
        for load_g in loads_g:
            yield from ((body, load_g, seed) for seed in range(1, seeds + 1))


def file_of(case: Case) -> ExperimentFile:
    """The experiment of this case, without its model."""
    body, load_g, _ = case
    shipped = load_experiment(LOAD_STEP).experiment.happenings
    changed = [
        {"at_s": one.at_s, "tip_load_g": load_g if one.tip_load_g else 0.0} for one in shipped
    ]
    return load_experiment(LOAD_STEP, {"plant": {"body": body}, "happenings": changed})


def limit_s(file: ExperimentFile) -> float:
    """Dead time, two lags and 0.4 s, for nobody sees sooner what comes of the way back; at least
    0.7 s, which the axes need for it."""
    emulation = file.robot.emulation
    assert emulation is not None
    plant = emulation.plant
    assert isinstance(plant, SoftArmPlant)
    return max(_PROMPT_LIMIT_S, plant.dead_time_s + 2.0 * plant.pneumatic_lag_s + 0.4)


def recoveries(case: Case) -> tuple[Recovery, ...]:
    """Of each change."""
    with tempfile.TemporaryDirectory() as name:
        file = with_model(file_of(case), case[2], _nobody)
        carry_out_in_virtual_time(file, case[2], Path(name), _nobody)
        measures = measures_of(file, Path(name))
    assert measures is not None
    return tuple(measures.recoveries)


def figures_of(runs: Sequence[Sequence[Recovery]], limit: float) -> dict[str, Any]:
    """Of all seeds with one body and load. Who is not back before the next change never is."""
    true_s = [[_or_never(one.true_back_s) for one in run] for run in runs]
    seen_s = [[_or_never(one.back_s) for one in run] for run in runs]
    return {
        "true_s": _medians(true_s),
        "as_seen_s": _medians(seen_s),
        "limit_s": round(limit, 2),
        "within": sum(back <= limit for run in true_s for back in run),
        "changes": sum(map(len, true_s)),
        "beyond_mm": round(max(one.overshoot_mm for run in runs for one in run), 2),
    }


def _or_never(back_s: float | None) -> float:
    return math.inf if back_s is None else back_s


def _medians(runs: Sequence[Sequence[float]]) -> list[float | None]:
    """By change; None: never."""
    middle = [statistics.median(change) for change in zip(*runs, strict=True)]
    return [round(back, 2) if math.isfinite(back) else None for back in middle]


def _nobody(line: str) -> None:
    """Hears what happens."""


def main() -> None:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bodies", nargs="+", choices=BODY_NAMES, default=BODY_NAMES)
    parser.add_argument("--loads", nargs="+", type=float, default=[30.0], metavar="G")
    parser.add_argument("--seeds", type=int, default=8, metavar="N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    given = parser.parse_args()
    found: dict[Case, tuple[Recovery, ...]] = {}
    with worker_processes(given.processes) as workers:
        asked = cases(given.bodies, given.loads, given.seeds)
        tasks = {workers.submit(recoveries, case): case for case in asked}
        for task in as_completed(tasks):
            found[tasks[task]] = task.result()
    lines: dict[str, Any] = {}
    for body, load_g, first in cases(given.bodies, given.loads, 1):
        runs = [found[body, load_g, first + k] for k in range(given.seeds)]
        lines[f"{body}, {load_g:g} g"] = figures_of(runs, limit_s(file_of((body, load_g, 1))))
    print(json.dumps(lines, indent=2))


if __name__ == "__main__":
    main()
