"""A load that nobody declared, many times over: it is found, or nothing is touched.

`python -m tests.experiments.undeclared_load`. Two parts. Seeds: the soft arm with 14.2 g goes, in
the whole virtual daemon, to where the gate just lets it, see `tests.daemon.service.gates_edge`;
every third is another body of the same design. Each goes there twice: as it is shipped, and without
the measured tip being compared with the model, which shows what the ball would otherwise come to.
Hours: both arms without a load on random ways, plant, tracker's errors, filter, model and test
without the daemon round them, half of the time each; one more hour of each with the load, to see
when it is noticed. Every seed and hour is one line in `--out`, and is not done again. Prints a
table; ends with exit code 1 where commanded motion touched in more than 0.1 % of the runs, where it
hardly did without the comparison, or where the alarm was false more than once in an hour.
"""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import Future, as_completed
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import beta, chi2

from config.loader import load_robot
from daemon.estimation.pose_filter import PoseFilter
from daemon.host.processes import worker_processes
from daemon.risk.model_file import read_model
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.configurations import Candidates
from drivers.pose import PlainPose
from safety.risk.model.mixture import FloatArray
from safety.risk.tip_consistency import REFERENCE, TipConsistency, TipModel
from sim_backends.devices.aurora.measurement import Sensing
from sim_backends.lab.bodies import plant_of
from sim_backends.plants.plant import TipLoad
from sim_backends.plants.shooting import warm_up
from tests import SOFT_ARM
from tests.daemon.service.gates_edge import Edge, play
from tests.daemon.service.undeclared_load import LOAD_G

FRAME_S: Final = 0.025
_LAGS: Final = (0, 4, 8, 12)
"""Frames: what the control step asks for, 0 to 0.3 s before."""
_OTHER_BODY: Final = 3
ARMS: Final = ("soft_arm", "tendon_arm")
CONFIDENCE: Final = 0.95
_MOST_TOUCHING: Final = 0.001
_LEAST_WITHOUT: Final = 0.1
"""Of the runs touch something where nobody looks: else the balls are no trial."""


def seed_of_runs(seed: int) -> list[dict[str, Any]]:
    """With the comparison and without."""
    body = seed if seed % _OTHER_BODY == 0 else None
    told = []
    with tempfile.TemporaryDirectory() as name:
        os.environ["XDG_CACHE_HOME"] = name
        edge = Edge.of(seed, Path(name), body)
        for seeing in (True, False):
            outcome = asdict(play(edge, Path(name), seeing))
            outcome |= {"state": outcome["state"].value, "causes": sorted(outcome["causes"])}
            about = {"part": "seed", "seed": seed, "seeing": seeing, "other_body": body is not None}
            told.append({**about, "worst_place": edge.worst_place, "risk": edge.risk, **outcome})
    return told


class _Eyes:
    """A body, a tracker, the filter behind it, and the test: what runs of them in a control step.

    Bit for bit what the step's comparison comes to, without what nobody asks for here.
    """

    def __init__(self, arm: str, seed: int, load_g: float) -> None:
        path = SOFT_ARM.with_name(f"{arm}.yaml")
        self.robot = load_robot(path).robot
        emulation = self.robot.emulation
        assert emulation is not None
        self._plant, self._load = plant_of(emulation, self.robot), TipLoad(load_g)
        model = read_model(path.parents[1] / "models" / f"{arm}.npz").model
        self._tip = TipModel(model, self.robot.risk.tip_accuracy_mm)
        self._sensing = Sensing(emulation.tracker, np.random.SeedSequence(seed))
        self._tools = {tool.attached_to: tool for tool in emulation.tracker.tools}
        self._base = PlainPose(
            emulation.tracker.base_position_mm, emulation.tracker.base_quaternion
        )
        self._filter, self.test = PoseFilter(self.robot.pose_filter), TipConsistency()
        self._lately: list[FloatArray] = []

    def look(self, u: FloatArray, t_ns: int) -> None:
        """One frame, with the axes at (m,) u."""
        state = self._plant.step(u, self._load, FRAME_S)
        true = self._base @ PlainPose(
            tuple(state.tip.position_mm.tolist()), tuple(state.tip.quaternion.tolist())
        )
        seen = self._sensing.measure(self._tools["tip"], true, FRAME_S, False)
        below = self._sensing.measure(self._tools["base"], self._base, FRAME_S, False)
        pose = None
        if seen.pose is not None and below.pose is not None and not seen.flags:
            pose = seen.pose.seen_from(below.pose).vectors()
        self._lately = [u, *self._lately[: _LAGS[-1]]]
        believed, estimate = self._filter.update(t_ns, pose), self._filter.estimate(t_ns)
        if not believed or estimate is None:
            return
        probability = self._likeliest(estimate.position_mm)
        if probability is not None:
            self.test.add(probability, t_ns)

    def _likeliest(self, tip_mm: FloatArray) -> float | None:
        likeliest = -1.0
        for lag in _LAGS:
            u = self._lately[min(lag, len(self._lately) - 1)]
            probability = self._tip.probability(u, tip_mm)
            if probability is None:
                return None
            likeliest = max(likeliest, probability)
            if self.test.statistic <= 0.0 and likeliest > np.exp(-REFERENCE):
                break  # the sum stays at zero, however likely the others are
        return likeliest


def hour_of_motion(
    arm: str, seed: int, hours: float = 1.0, load_g: float = 0.0
) -> list[dict[str, Any]]:
    """Random ways at random speeds, with pauses. Counts alarms, each from rest to rest."""
    warm_up()
    eyes, random = _Eyes(arm, seed, load_g), np.random.default_rng([seed, 20])
    test, robot = eyes.test, eyes.robot
    alarms, highest, first = 0, 0.0, None
    ways = _ways(AxisRanges.of(robot), Candidates(robot, seed + 777), random)
    for frame, u in enumerate(islice(ways, round(hours * 3600.0 / FRAME_S)), 1):
        t_ns, before = frame * round(FRAME_S * 1e9), test.consistent
        eyes.look(u, t_ns)
        if before and not test.consistent:
            alarms += 1
            first = t_ns * 1e-9 if first is None else first
        highest = max(highest, test.statistic)
    told = {"alarms": alarms, "highest": highest, "first_s": first}
    return [{"part": "hour", "arm": arm, "seed": seed, "hours": hours, "load_g": load_g, **told}]


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
    for seeing in (True, False):
        for place in ("all", "worst place", "elsewhere"):
            chosen = [
                run
                for run in runs
                if run["seeing"] is seeing
                and (place == "all" or run["worst_place"] is (place == "worst place"))
            ]
            if chosen:
                told.append(f"{'with' if seeing else 'without'}, {place}: {_of_runs(chosen)}")
    for arm in ARMS:
        for loaded in (False, True):
            mine = [
                x for x in lines if x.get("arm") == arm and (x.get("load_g", 0.0) > 0) is loaded
            ]
            if mine:
                told.append(f"{arm}, {LOAD_G if loaded else 0.0:g} g: {_of_hours(mine)}")
    free = [x for x in lines if x["part"] == "hour" and not x["load_g"]]
    if free:
        told.append(f"both arms without a load: {_of_hours(free)}")
    return "\n".join(told)


def _of_runs(runs: list[dict[str, Any]]) -> str:
    commanded = _touched(runs)
    delays = [run["alarmed_at_s"] for run in runs if run["alarmed_at_s"] is not None]
    middle = f", median after {np.median(delays):.1f} s" if delays else ""
    return (
        f"{len(runs)} runs with {LOAD_G:g} g, {commanded} touched by commanded motion "
        f"({commanded / len(runs):.1%}, at most {_most(commanded, len(runs)):.1%} with "
        f"{CONFIDENCE:.0%}), {sum(run['by_the_drop'] for run in runs)} by the drop itself; "
        f"{len(delays)} alarms{middle}; {sum(run['arrived'] for run in runs)} arrived; least "
        f"clearance {min(run['least_clearance_mm'] for run in runs):.2f} mm"
    )


def _touched(runs: list[dict[str, Any]]) -> int:
    return sum(run["touched"] and not run["by_the_drop"] for run in runs)


def _most(count: int, of: int) -> float:
    """Clopper and Pearson's upper limit of a share."""
    return 1.0 if count == of else float(beta.ppf(CONFIDENCE, count + 1, of - count))


def _of_hours(lines: list[dict[str, Any]]) -> str:
    hours, alarms = sum(x["hours"] for x in lines), sum(x["alarms"] for x in lines)
    firsts = [x["first_s"] for x in lines if x["first_s"] is not None]
    beside = f", first after {np.median(firsts):.0f} s" if firsts else ""
    most = chi2.ppf(CONFIDENCE, 2 * alarms + 2) / 2.0 / hours
    return (
        f"{hours:g} h on random ways, {alarms} alarms{beside}, at most {most:.2f} in an hour with "
        f"{CONFIDENCE:.0%}; highest statistic {max(x['highest'] for x in lines):.2f} of 1"
    )


def good(lines: list[dict[str, Any]]) -> bool:
    """Whether it is as promised."""
    runs = [line for line in lines if line["part"] == "seed"]
    seeing, without = ([run for run in runs if run["seeing"] is kind] for kind in (True, False))
    hours = [line for line in lines if line["part"] == "hour" and not line["load_g"]]
    alarms = sum(line["alarms"] for line in hours)
    return (
        _touched(seeing) <= _MOST_TOUCHING * len(seeing)
        and _touched(without) >= _LEAST_WITHOUT * len(without)
        and alarms <= sum(line["hours"] for line in hours)
    )


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
    with worker_processes(arguments.processes) as workers, arguments.out.open("a") as out:
        tasks: list[Future[list[dict[str, Any]]]] = [
            workers.submit(seed_of_runs, seed)
            for seed in range(1, arguments.seeds + 1)
            if seed not in seeds
        ]
        tasks += [
            workers.submit(hour_of_motion, arm, number, 1.0, load_g)
            for arm, number, load_g in wanted
            if (arm, number, load_g) not in hours
        ]
        for task in as_completed(tasks):
            for line in task.result():
                lines.append(line)
                out.write(json.dumps(line) + "\n")
                out.flush()
    print(table(lines))
    return 0 if good(lines) else 1


if __name__ == "__main__":
    sys.exit(main())
