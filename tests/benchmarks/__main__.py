"""`python -m tests.benchmarks [NAME …]` prints one JSON of all measurements, or of some."""

import json
import sys
from collections.abc import Callable
from typing import Any

from tests.benchmarks import (
    aurora,
    can_cycle,
    daemon,
    emulation,
    local_controllers,
    lwpr,
    plant,
    recording,
    remote,
    tendon_arm,
)
from tests.benchmarks.timing import machine

MEASUREMENTS: dict[str, Callable[[], Any]] = {
    "aurora": aurora.measure,
    "can_cycle": can_cycle.measure,
    "daemon": daemon.measure,
    "emulation": emulation.measure,
    "local_controllers": local_controllers.measure,
    "lwpr": lwpr.measure,
    "plant": plant.measure,
    "recording": recording.measure,
    "remote": remote.measure,
    "tendon_arm": tendon_arm.measure,
}


def main() -> int:
    wanted = sys.argv[1:] or list(MEASUREMENTS)
    unknown = set(wanted) - set(MEASUREMENTS)
    if unknown:
        print(f"there are {', '.join(MEASUREMENTS)}", file=sys.stderr)
        return 2
    figures: dict[str, Any] = {"machine": machine()}
    for name in wanted:
        print(f"measuring {name}", file=sys.stderr, flush=True)
        figures[name] = MEASUREMENTS[name]()
    print(json.dumps(figures, indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
