"""How long an experiment takes in virtual time: three times round the rectangle in 400 s.

The command is run as anybody runs it, from its start to the report; before each time a loop of
plain Python says how fast the machine is.
"""

import subprocess
import sys
import tempfile
import time
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from tests.benchmarks.timing import Figures, pieces, reference_ms

RUNS = 3
CYCLES, CYCLE_S = 3, 400.0 / 3.0
SHORT_CYCLE_S = 15.0
"""The rectangle of 250 mm then asks for 17 mm/s of the tip, which may go 25."""
_REFERENCE_TURNS = 5_000_000


def measure(tiny: bool = False) -> Figures:
    """Seconds of each run, and as a multiple of five million turns of the loop beside it."""
    with tempfile.TemporaryDirectory() as directory:
        folder = Path(directory)
        if not tiny:
            _carry_out(1, SHORT_CYCLE_S, folder / "warm")  # compiles what nobody has compiled yet
        runs, cycles, cycle_s = (1, 1, SHORT_CYCLE_S) if tiny else (RUNS, CYCLES, CYCLE_S)
        return pieces(
            {
                f"run_{number + 1}": partial(_run, folder / str(number), cycles, cycle_s)
                for number in range(runs)
            }
        )


def _run(folder: Path, cycles: int, cycle_s: float) -> Figures:
    before_ms, _ = reference_ms(_REFERENCE_TURNS)
    began_s = time.perf_counter()
    _carry_out(cycles, cycle_s, folder)
    wall_s = time.perf_counter() - began_s
    return {
        "following_s": cycles * cycle_s,
        "wall_s": round(wall_s, 2),
        "times_five_million_turns": round(wall_s * 1e3 / before_ms, 1),
    }


def _carry_out(cycles: int, cycle_s: float, folder: Path) -> None:
    shipped = files("config") / "experiments" / "rectangle.yaml"
    experiment: dict[str, Any] = yaml.safe_load(shipped.read_text())
    experiment["trajectory"] |= {"cycles": cycles, "cycle_s": cycle_s}
    file = folder.with_suffix(".yaml")
    file.write_text(yaml.safe_dump(experiment))
    command = (
        sys.executable,
        "-m",
        "daemon.commands.terminal.command_line",
        "experiment",
        str(file),
        "--out",
        str(folder),
    )
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    assert (folder / "report.html").is_file()
