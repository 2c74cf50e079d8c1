"""`python -m tests.benchmarks [--plots DIR] [NAME …]`: one JSON of all measurements, or of some."""

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tests.benchmarks import (
    aurora,
    can_cycle,
    daemon,
    emulation,
    experiment,
    local_controllers,
    lwpr,
    plant,
    recording,
    remote,
    risk,
    tendon_arm,
)
from tests.benchmarks.timing import machine

MEASUREMENTS: dict[str, Callable[[], Any]] = {
    "aurora": aurora.measure,
    "can_cycle": can_cycle.measure,
    "daemon": daemon.measure,
    "emulation": emulation.measure,
    "experiment": experiment.measure,
    "local_controllers": local_controllers.measure,
    "lwpr": lwpr.measure,
    "plant": plant.measure,
    "recording": recording.measure,
    "remote": remote.measure,
    "risk": risk.measure,
    "tendon_arm": tendon_arm.measure,
}
PLOTS: dict[str, Callable[[Any, Path], None]] = {
    "local_controllers": local_controllers.plot,
    "risk": risk.plot,
}
"""Of what is better seen than read."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *MEASUREMENTS], metavar="NAME")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="where pictures go")
    arguments = parser.parse_args()
    wanted = arguments.names or list(MEASUREMENTS)
    figures: dict[str, Any] = {"machine": machine()}
    for name in wanted:
        print(f"measuring {name}", file=sys.stderr, flush=True)
        figures[name] = MEASUREMENTS[name]()
    if arguments.plots is not None:
        arguments.plots.mkdir(parents=True, exist_ok=True)
        for name in set(wanted) & set(PLOTS):
            PLOTS[name](figures[name], arguments.plots / f"{name}.png")
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
