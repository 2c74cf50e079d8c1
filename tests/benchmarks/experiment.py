"""How long an experiment takes in virtual time: three times round the rectangle in 400 s.

`python -m tests.benchmarks.experiment` prints one JSON. The command is run as anybody runs it, from
its start to the report; before each time a loop of plain Python says how fast the machine is.
"""

import json
import subprocess
import sys
import tempfile
import time
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from tests.benchmarks.timing import Figures

RUNS = 3
CYCLES, CYCLE_S = 3, 400.0 / 3.0
_REFERENCE_TURNS = 5_000_000


def measure(runs: int = RUNS) -> Figures:
    """Seconds of each run, and of the loop before it."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        _carry_out(1, 5.0, folder / "warm")  # compiles what nobody has compiled yet
        references_s, walls_s = [], []
        for number in range(runs):
            references_s.append(round(reference_s(), 3))
            began_s = time.perf_counter()
            _carry_out(CYCLES, CYCLE_S, folder / str(number))
            walls_s.append(round(time.perf_counter() - began_s, 2))
    return {"following_s": CYCLES * CYCLE_S, "wall_s": walls_s, "reference_s": references_s}


def reference_s() -> float:
    """What five million turns of a small loop take."""
    began_s, total = time.perf_counter(), 0
    for turn in range(_REFERENCE_TURNS):
        total += turn * turn % 7
    return time.perf_counter() - began_s


def _carry_out(cycles: int, cycle_s: float, folder: Path) -> None:
    shipped = files("config") / "experiments" / "rectangle.yaml"
    experiment: dict[str, Any] = yaml.safe_load(shipped.read_text())
    experiment["trajectory"] |= {"cycles": cycles, "cycle_s": cycle_s}
    file = folder.with_suffix(".yaml")
    file.write_text(yaml.safe_dump(experiment))
    command = (sys.executable, "-m", "daemon.cli", "experiment", str(file), "--out", str(folder))
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    assert (folder / "report.html").is_file()


if __name__ == "__main__":
    print(json.dumps(measure(), indent=1))
