"""A load that nobody declared, many times over: it is found, or nothing is touched.

`python -m tests.experiments.undeclared_load`. Two parts. Seeds: the soft arm with 14.2 g in the
whole virtual daemon, among balls, see `tests.daemon.service.undeclared_load`; every third with
another body of the same design. Hours: both arms without a load on random ways, plant, tracker's
errors, filter, model and test without the daemon round them, half of the time each. Every seed and
hour is one line in `--out`, and is not done again. Prints a table; ends with exit code 1 where
commanded motion touched in more than 0.1 % of the runs, or the alarm was false more than once in an
hour.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import as_completed
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np

from config.loader import load_robot
from daemon.estimation.pose_filter import PoseFilter
from daemon.host.processes import worker_processes
from daemon.risk.model_file import read_model
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.configurations import Candidates
from drivers.pose import PlainPose
from safety.risk.mixture import FloatArray
from safety.risk.tip_consistency import TipConsistency, TipModel
from sim_backends.devices.aurora.measurement import Sensing
from sim_backends.lab.lab import plant_of
from sim_backends.plants.plant import TipLoad
from sim_backends.plants.shooting import warm_up
from tests import SOFT_ARM
from tests.daemon.service.undeclared_load import LOAD_G, Course, play

FRAME_S: Final = 0.025
_LAGS: Final = (0, 4, 8, 12)
"""Frames: what the control step asks for, 0 to 0.3 s before."""
_OTHER_BODY: Final = 3
ARMS: Final = ("soft_arm", "tendon_arm")


def seed_of_runs(seed: int) -> dict[str, Any]:
    """One run with the load."""
    body = seed if seed % _OTHER_BODY == 0 else None
    with tempfile.TemporaryDirectory() as name:
        os.environ["XDG_CACHE_HOME"] = name
        outcome = play(Course.of(seed, LOAD_G, body), Path(name))
    told = asdict(outcome) | {"state": outcome.state.value, "causes": sorted(outcome.causes)}
    return {"part": "seed", "seed": seed, "other_body": body is not None, **told}


def hour_of_motion(arm: str, seed: int, hours: float = 1.0, load_g: float = 0.0) -> dict[str, Any]:
    """Random ways at random speeds, with pauses. Counts alarms, each from rest to rest."""
    path = SOFT_ARM.with_name(f"{arm}.yaml")
    robot = load_robot(path).robot
    emulation = robot.emulation
    assert emulation is not None
    warm_up()
    plant, random = plant_of(emulation, robot), np.random.default_rng([seed, 20])
    tip = TipModel(read_model(path.parents[1] / "models" / f"{arm}.npz").model, 1.0)
    sensing = Sensing(emulation.tracker, np.random.SeedSequence(seed))
    tools = {tool.attached_to: tool for tool in emulation.tracker.tools}
    base = PlainPose(emulation.tracker.base_position_mm, emulation.tracker.base_quaternion)
    filtered, test = PoseFilter(robot.pose_filter), TipConsistency()
    alarms, highest, first = 0, 0.0, None
    lately: list[Any] = []
    ways = _ways(AxisRanges.of(robot), Candidates(robot, seed + 777), random)
    for frame, u in enumerate(islice(ways, round(hours * 3600.0 / FRAME_S)), 1):
        state = plant.step(u, TipLoad(load_g), FRAME_S)
        t_ns = frame * round(FRAME_S * 1e9)
        true = base @ PlainPose(
            tuple(state.tip.position_mm.tolist()), tuple(state.tip.quaternion.tolist())
        )
        seen = sensing.measure(tools["tip"], true, FRAME_S, False)
        below = sensing.measure(tools["base"], base, FRAME_S, False)
        pose = None
        if seen.pose is not None and below.pose is not None and not seen.flags:
            pose = seen.pose.seen_from(below.pose).vectors()
        lately = [u, *lately[: _LAGS[-1]]]
        believed, estimate = filtered.update(t_ns, pose), filtered.estimate(t_ns)
        if believed and estimate is not None:
            axes = [lately[min(lag, len(lately) - 1)] for lag in _LAGS]
            place, before = tip.place(axes, estimate.position_mm), test.consistent
            if place is not None:
                fits = test.add(place.probability, t_ns)
                alarm = before and not fits
                alarms += alarm
                first = t_ns * 1e-9 if alarm and first is None else first
                highest = max(highest, test.statistic)
    told = {"alarms": alarms, "highest": highest, "first_s": first}
    return {"part": "hour", "arm": arm, "seed": seed, "hours": hours, "load_g": load_g, **told}


def _ways(
    ranges: AxisRanges, candidates: Candidates, random: np.random.Generator
) -> Iterator[FloatArray]:
    """(m,) u after (m,) u, a frame apart, for ever."""
    u, number = np.zeros(ranges.count), 0
    while True:
        target = candidates.actuation(candidates.parameters(number, 1))[0]
        number += 1
        if not candidates.possible(target):
            continue
        step_s = float(np.exp(random.uniform(np.log(0.1), 0.0))) * FRAME_S
        while np.abs(target - u).max() > 0.0:
            most_s = float((np.abs(target - u) / ranges.max_velocity).max())
            u = target if most_s <= step_s else u + (step_s / most_s) * (target - u)
            yield u
        for _ in range(int(random.choice([0, 0, 40, 200]))):
            yield u


def table(lines: list[dict[str, Any]]) -> str:
    """What came of it, for people."""
    runs = [line for line in lines if line["part"] == "seed"]
    told = []
    for name, chosen in (
        ("the model's own body", [run for run in runs if not run["other_body"]]),
        ("other bodies", [run for run in runs if run["other_body"]]),
    ):
        if not chosen:
            continue
        touched = [run for run in chosen if run["touched_at_s"] is not None]
        delays = [run["alarmed_at_s"] for run in chosen if run["alarmed_at_s"] is not None]
        middle = f"{np.median(delays):.1f} s" if delays else "-"
        told.append(
            f"{name}: {len(chosen)} runs with {LOAD_G:g} g, "
            f"{sum(not run['by_the_drop'] for run in touched)} touched by commanded motion, "
            f"{sum(run['by_the_drop'] for run in touched)} by the drop itself; "
            f"{len(delays)} alarms, median after {middle}; "
            f"{sum(run['state'] == 'hold' for run in chosen)} held; least clearance "
            f"{min(run['least_clearance_mm'] for run in chosen):.2f} mm"
        )
    for arm in ARMS:
        for loaded in (False, True):
            mine = [
                x for x in lines if x.get("arm") == arm and (x.get("load_g", 0.0) > 0) is loaded
            ]
            if mine:
                hours, alarms = sum(x["hours"] for x in mine), sum(x["alarms"] for x in mine)
                firsts = [x["first_s"] for x in mine if x["first_s"] is not None]
                beside = f", first after {np.median(firsts):.0f} s" if firsts else ""
                told.append(
                    f"{arm}, {LOAD_G if loaded else 0.0:g} g: {hours:g} h on random ways, "
                    f"{alarms} alarms{beside}; highest statistic "
                    f"{max(x['highest'] for x in mine):.2f} of 1"
                )
    return "\n".join(told)


def good(lines: list[dict[str, Any]]) -> bool:
    """Whether it is as promised."""
    runs = [line for line in lines if line["part"] == "seed"]
    hours = [line for line in lines if line["part"] == "hour" and not line["load_g"]]
    touched = sum(run["touched_at_s"] is not None and not run["by_the_drop"] for run in runs)
    alarms = sum(line["alarms"] for line in hours)
    return touched <= 0.001 * len(runs) and alarms <= sum(line["hours"] for line in hours)


def main() -> int:
    """Prints a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=200, metavar="N")
    parser.add_argument("--hours", type=int, default=20, metavar="H", help="of both arms together")
    parser.add_argument("--processes", type=int, default=2, metavar="N")
    parser.add_argument("--out", type=Path, default=Path("runs/undeclared_load.jsonl"))
    arguments = parser.parse_args()
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    lines = []
    if arguments.out.exists():
        lines = [json.loads(line) for line in arguments.out.read_text().splitlines()]
    seeds = {line["seed"] for line in lines if line["part"] == "seed"}
    hours = {(line["arm"], line["seed"], line["load_g"]) for line in lines if "arm" in line}
    wanted = [
        (arm, number, load_g)
        for number in range(1, 1 + arguments.hours // len(ARMS))
        for arm in ARMS
        for load_g in (0.0, *((LOAD_G,) if number == 1 else ()))
    ]
    with worker_processes(arguments.processes) as workers:
        tasks = [
            workers.submit(hour_of_motion, arm, number, 1.0, load_g)
            for arm, number, load_g in wanted
            if (arm, number, load_g) not in hours
        ]
        tasks += [
            workers.submit(seed_of_runs, seed)
            for seed in range(1, 1 + arguments.seeds)
            if seed not in seeds
        ]
        for task in as_completed(tasks):
            lines.append(task.result())
            with arguments.out.open("a") as file:
                print(json.dumps(lines[-1]), file=file, flush=True)
    print(table(lines))
    return 0 if good(lines) else 1


if __name__ == "__main__":
    sys.exit(main())
