"""Bodies, paths, speeds and loads that no controller was made or tuned on: who is nearest there.

`python -m tests.experiments.held_out`. Every case is a body of `led_bodies` and a path of
`led_paths` at 5 to 40 mm/s, with or without a load, which controllers with the bench's settings
follow for three rounds; each keeps the path's time. A case that an axis is too slow for is refused
alike for all, and left out. Every case is one line in `--out`; prints one JSON: how much farther
off than the best of the others the reward-weighted controller is, settled and in the first round.
"""

import argparse
import json
import sys
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any, Final

import numpy as np

from daemon.commands.terminal.work_sharing import share
from daemon.host.processes import WHOLE, worker_processes
from tests.experiments.led_bodies import came_of, random_plant
from tests.experiments.led_paths import SOFT_ARM, path_of

_LED: Final = {"lead": True, "slow_above_mm": None}
CONTROLLERS: Final[dict[str, dict[str, Any]]] = {
    "led": {"kind": "reward_weighted", **_LED, "gain_per_s": 7.26},
    "led_offline": {"kind": "reward_weighted", **_LED, "learning": False, "gain_per_s": 7.26},
    "forward_jacobian": {"kind": "forward_jacobian", **_LED, "gain_per_s": 5.2},
    "gaussian_process": {"kind": "gaussian_process", **_LED, "gain_per_s": 7.26},
    "broyden": {"kind": "broyden", **_LED, "gain_per_s": 4.7},
    "model_predictive": {"kind": "model_predictive", "smoothness_mm": 4.78},
}
"""With the gains of config/studies/tuned/bench.yaml."""
OURS: Final = "led"
_NEAR: Final = 1.03
"""Times the best: no farther off than two runs of one controller are from each other."""
_LOADS_G: Final = (0.0, 0.0, 14.2, 30.0)


def case_of(number: int) -> dict[str, Any]:
    """What the experiment's file is changed by. The same number gives the same case."""
    random = np.random.default_rng([number, 1616])
    uniform = random.uniform
    speed_mm_s = float(np.exp(uniform(*np.log([5.0, 40.0]))))
    path, length_mm = path_of(random)
    stiffer, lag_s = uniform(0.8, 1.25), float(np.exp(uniform(*np.log([0.05, 0.8]))))
    return {
        "plant": random_plant(random, stiffer, lag_s),
        "trajectory": {**path, "cycle_s": length_mm / speed_mm_s, "cycles": 3},
        "pretraining": {"waypoints": 80, "seed": 1, "plant": {}},
        "risk": False,
        "tip_load_g": float(random.choice(_LOADS_G)),
        "longest_s": 600.0,
    }


def carried_out(number: int, only: list[str]) -> dict[str, Any]:
    """One line for the file."""
    case = case_of(number)
    plant, path = case["plant"], case["trajectory"]
    line: dict[str, Any] = {
        "case": number,
        "path": path["kind"],
        "cycle_s": round(path["cycle_s"], 3),
        "tip_load_g": case["tip_load_g"],
        "lag_s": round(plant["pneumatic_lag_s"], 3),
        "dead_s": round(plant["dead_time_s"], 3),
        "hysteresis": round(plant["hysteresis"], 3),
    }
    for name in only:
        settings = {"max_tip_speed_mm_s": 80.0, **CONTROLLERS[name]}
        came = came_of(SOFT_ARM, {**case, "controller": settings}, number)
        line[name] = came.get("mean_mm", came["verdict"])
        if line[name] == "refused":
            break
    return line


def figures_of(lines: list[dict[str, Any]]) -> dict[str, Any]:
    """For JSON."""
    counted = [line for line in lines if isinstance(line.get(OURS), list)]
    settled = {line["case"]: ratio(line, -1) for line in counted}
    first = {line["case"]: ratio(line, 0) for line in counted}
    return {
        "cases": len(lines),
        "refused": sum(line.get(OURS) == "refused" for line in lines),
        "near_the_best": sum(one <= _NEAR for one in settled.values()),
        "of": len(settled),
        "settled": _spread(list(settled.values())),
        "first": _spread(list(first.values())),
        "behind": {case: one for case, one in sorted(settled.items()) if one > _NEAR},
    }


def ratio(line: dict[str, Any], cycle: int) -> float:
    """Ours to the best of the others, in this cycle."""
    others = [line[name][cycle] for name in CONTROLLERS if name != OURS and _ended(line.get(name))]
    return float(round(line[OURS][cycle] / min(others, default=np.inf), 3))


def _ended(came: Any) -> bool:
    return isinstance(came, list)


def _spread(ratios: list[float]) -> dict[str, float]:
    shares = {"median": 50, "p90": 90, "most": 100}
    return {name: round(float(np.percentile(ratios, at)), 3) for name, at in shares.items()}


def main() -> int:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=60, metavar="N")
    parser.add_argument("--share", type=share, default=WHOLE, metavar="K/N")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    parser.add_argument("--only", default=",".join(CONTROLLERS), metavar="NAME,...")
    parser.add_argument("--out", type=Path, default=Path("runs/held_out.jsonl"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    lines: list[dict[str, Any]] = []
    if arguments.out.exists():
        lines = [json.loads(line) for line in arguments.out.read_text().splitlines()]
    done = {line["case"] for line in lines}
    left = [n for n in range(arguments.cases) if arguments.share.has(n) and n not in done]
    only = arguments.only.split(",")
    with worker_processes(arguments.processes) as workers, arguments.out.open("a") as out:
        for task in as_completed([workers.submit(carried_out, n, only) for n in left]):
            lines.append(task.result())
            out.write(json.dumps(lines[-1]) + "\n")
            out.flush()
    print(json.dumps(figures_of(lines), indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
