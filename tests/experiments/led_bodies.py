"""Random bodies, gains and loads, led through the whole virtual daemon: none of them swings up.

`python -m tests.experiments.led_bodies`. Every case is an arm that the controller's model does not
know, with a lag of 0.05 to 0.8 s, a dead time of up to 0.25 s or none, hysteresis, play, creep and
uneven chambers; a gain; a path at some speed, which every other one keeps and the rest may slow; a
load from the beginning, and another one hung on on the way. The monitor watches as it does always,
and what it holds is resumed. A case is unstable where the tip is far from its path at the end, when
the way back from the load is long over. Every case is one line in `--out` and is not done again;
`--share 1/3` does a third of them. Prints one JSON; ends with exit code 1 where a case was
unstable, or failed.
"""

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, Final

import numpy as np

from daemon.commands.terminal.work_sharing import share
from daemon.host.processes import WHOLE, worker_processes
from daemon.messages import Tip
from daemon.recording.format.channels import TOPICS
from daemon.recording.result import Result
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from daemon.workbench.experiments.trial import TrialError
from daemon.workbench.pretraining.model_cache import with_model
from drivers.pose import Vector
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS

_RUNNING: Final = OperatingState.RUNNING.value
CIRCLE: Final = SHIPPED_ROBOTS.parent / "experiments" / "fast_circle.yaml"
LASTS_S: Final = 14.0
_END_S: Final = 3.0
"""Of the path, in which it is judged. The shortest goes on for 5.6 s after the load: this begins
2.6 s after it, and the slowest body's way back takes dead time + 2 lags + 0.4 s = 2.25 s."""
_SWUNG_MM: Final = 10.0
"""Off in that time. What swings grows to a circle of its own, to be stopped by travel and speed
alone; the same load, as it falls, takes the tip 15 to 25 mm off."""


def case_of(number: int) -> dict[str, Any]:
    """What the experiment's file is changed by. The same number gives the same case."""
    random = np.random.default_rng([number, 1000])
    uniform = random.uniform
    speed_mm_s = float(np.exp(uniform(np.log(5.0), np.log(40.0))))
    radius_mm = float(uniform(10.0, 30.0))
    stiffer, lag_s = uniform(0.8, 1.25), float(np.exp(uniform(np.log(0.05), np.log(0.8))))
    before_g, after_g = random.choice([0.0, 14.2, 30.0], 2).tolist()
    return {
        "plant": random_plant(random, stiffer, lag_s),
        "trajectory": {
            "kind": "circle",
            "center_mm": [0.0, 0.0, 185.0],
            "radius_mm": radius_mm,
            "cycle_s": 2.0 * np.pi * radius_mm / speed_mm_s,
            "cycles": max(2, round(LASTS_S * speed_mm_s / (2.0 * np.pi * radius_mm))),
        },
        "controller": {
            "kind": random.choice(["reward_weighted", "forward_jacobian"]),
            "learning": bool(random.random() < 0.7),
            "lead": True,
            "gain_per_s": float(uniform(1.5, 8.0)),
            "max_tip_speed_mm_s": 80.0,
            "slow_above_mm": (1.0, None)[number % 2],
        },
        "pretraining": {"waypoints": 80, "plant": {}, "seed": 1},
        "risk": False,
        "blend_speed_mm_s": 20.0,
        "tip_load_g": before_g,
        "happenings": [{"at_s": 0.4 * LASTS_S, "tip_load_g": after_g}],
        "longest_s": 600.0,
    }


def random_plant(random: np.random.Generator, stiffer: float, lag_s: float) -> dict[str, Any]:
    """A soft arm that nobody knows, so many times as stiff as the one that was made."""
    uniform = random.uniform
    return {
        "bending_stiffness_n_mm2": 8.0e3 * stiffer,
        "axial_stiffness_n": 130.0 * stiffer,
        "mass_g": uniform(38.0, 55.0),
        "chamber_area_ratios": uniform(0.8, 1.2, 6).tolist(),
        "hysteresis": uniform(0.1, 0.45),
        "creep": uniform(0.02, 0.25),
        "pneumatic_lag_s": lag_s,
        "dead_time_s": max(uniform(-0.125, 0.25), 0.0),  # one of three has none
        "backlash_mm": uniform(0.0, 0.15),
    }


def carried_out(number: int) -> dict[str, Any]:
    """One line for the file."""
    case = case_of(number)
    return {"case": number, **_in_short(case), **came_of(CIRCLE, case, number)}


def came_of(experiment: Path, case: dict[str, Any], seed: int) -> dict[str, Any]:
    """What became of a case, for a line of the file: of an experiment that is changed by it."""
    with tempfile.TemporaryDirectory() as name:
        try:
            file = with_model(load_experiment(experiment, case), seed, _nobody)
            result = carry_out_in_virtual_time(file, seed, Path(name), _nobody)
        except TrialError as error:
            return {"verdict": _refused_or_failed(str(error)), "why": str(error)[:300]}
        tips = RunReader(Path(name) / RUN_FILE).messages([TOPICS[Tip]])
        errors = errors_mm(json.loads(tip.data) for tip in tips)
    return _of(result, errors)


def errors_mm(tips: Iterable[dict[str, Any]]) -> Vector:
    """(n, 2) s and mm off, of the steps of a recording in which the path was followed."""
    of_path = [tip for tip in tips if tip["state"] == _RUNNING and tip.get("cycle", -1) >= 0]
    off = [(1e-9 * tip["t_ns"], tip["error_mm"]) for tip in of_path if tip.get("error_mm")]
    return np.array(off).reshape(-1, 2)


def worst_at_the_end_mm(errors: Vector) -> float:
    """Of `errors_mm`; infinite where no path was followed."""
    if not len(errors):
        return float("inf")
    return float(errors[errors[:, 0] >= errors[-1, 0] - _END_S, 1].max())


def _refused_or_failed(why: str) -> str:
    refused = ("can be followed: let a cycle take", "mm beyond the workspace")
    return "refused" if any(words in why for words in refused) else "failed"


def _of(result: Result, errors: Vector) -> dict[str, Any]:
    end_mm = worst_at_the_end_mm(errors)
    unstable = not end_mm < _SWUNG_MM
    return {
        "verdict": "unstable" if unstable else "held" if result.holds else "followed",
        "end_mm": round(end_mm, 2),
        "holds": result.holds,
        "faults": result.faults,
        "mean_mm": [round(cycle.mean_mm, 3) for cycle in result.cycles],
        "max_mm": [round(cycle.max_mm, 2) for cycle in result.cycles],
        "plant_failures": result.plant_failures,
    }


def _in_short(case: dict[str, Any]) -> dict[str, Any]:
    plant, controller = case["plant"], case["controller"]
    return {
        "lag_s": round(plant["pneumatic_lag_s"], 3),
        "dead_s": round(plant["dead_time_s"], 3),
        "hysteresis": round(plant["hysteresis"], 3),
        "gain_per_s": round(controller["gain_per_s"], 2),
        "kind": controller["kind"],
        "learning": controller["learning"],
        "slow_above_mm": controller["slow_above_mm"],
        "speed_mm_s": round(
            2.0 * np.pi * case["trajectory"]["radius_mm"] / case["trajectory"]["cycle_s"], 1
        ),
        "loads_g": [case["tip_load_g"], case["happenings"][0]["tip_load_g"]],
    }


def _nobody(line: str) -> None:
    """Hears what happens."""


def figures_of(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """For JSON."""
    followed = [line for line in lines if "mean_mm" in line]
    return {
        "cases": len(lines),
        "verdicts": dict(Counter(line["verdict"] for line in lines)),
        "holds": sum(line["holds"] for line in followed),
        "held_by": dict(Counter(fault for line in followed for fault in line["faults"])),
        "end_mm": _spread([line["end_mm"] for line in followed]),
        "last_cycle_mean_mm": _spread([line["mean_mm"][-1] for line in followed]),
        "unstable": [line["case"] for line in lines if line["verdict"] == "unstable"],
        "failed": [line["case"] for line in lines if line["verdict"] == "failed"],
    }


def _spread(values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    shares = {"median": 50, "p90": 90, "p99": 99, "most": 100}
    return {name: round(float(np.percentile(values, at)), 3) for name, at in shares.items()}


def carry_out_all(carry_out: Callable[[int], dict[str, Any]], words: str, cases: int) -> int:
    """Cases that the command line asks for, as many by default; prints one JSON."""
    parser = argparse.ArgumentParser(description=words)
    out_by_default = Path("runs") / f"{Path(sys.argv[0]).stem}.jsonl"
    parser.add_argument("--cases", type=int, default=cases, metavar="N")
    parser.add_argument("--share", type=share, default=WHOLE, metavar="K/N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    parser.add_argument("--out", type=Path, default=out_by_default)
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    lines: list[dict[str, Any]] = []
    if arguments.out.exists():
        lines = [json.loads(line) for line in arguments.out.read_text().splitlines()]
    done = {line["case"] for line in lines}
    left = [n for n in range(arguments.cases) if arguments.share.has(n) and n not in done]
    with worker_processes(arguments.processes) as workers, arguments.out.open("a") as out:
        for task in as_completed([workers.submit(carry_out, number) for number in left]):
            lines.append(task.result())
            out.write(json.dumps(lines[-1]) + "\n")
            out.flush()
    figures = figures_of(lines)
    print(json.dumps(figures, indent=2))
    return 1 if figures["unstable"] or figures["failed"] else 0


def main() -> int:
    """Prints one JSON."""
    with_model(load_experiment(CIRCLE, case_of(0)), 0, _nobody)  # made once, and then found
    return carry_out_all(carried_out, __doc__ or "", 1000)


if __name__ == "__main__":
    sys.exit(main())
