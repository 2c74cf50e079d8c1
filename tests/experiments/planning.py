"""Planned paths in chests, and what a plant does on them: `python -m tests.experiments.planning`.

Between random places in a cavity like a chest: the path as the paper plans it first (all means
free, the shortest in the roadmap), the paper's own way to lower its risk, and ours. Of each the
risk of the whole path, equation 10, and how many emulated bodies that go along it touch. Prints one
JSON. Ends with exit code 1 where a body touches on an optimised path that says it hardly does.

Pairs are those whose nominal path is likely to touch: all means of the mixture are free on it, and
the body leans on a wall nevertheless. Equation 10 hardly sees that. The chest has an opening behind
the body's base, since equation 10 counts the wall round the port: 20 waypoints at rest in the
middle of the cavity have 0.34 with it (`--closed`).
`--scale 1.15`: all cavities so much larger. In those as they are, 20 waypoints of the soft arm at
rest, each at a place that is safe, have 0.09 by equation 10; in the larger ones 0.04. In cavities
1.25 times as large no path between such places leans on a wall.
The default is small; the whole of it: `--chests 3 --pairs 7 --rollouts 1000`, with `--robot
soft_arm` and `--robot concentric_tubes` again. `--times`: how long planning takes, and nothing else
of each path. Pairs that `--out` has kept are not planned again.
"""

import argparse
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from config.loader import load_robot
from daemon.host.clock import MonotonicClock
from daemon.host.progress import Unheard
from daemon.risk.model_file import read_model
from daemon.workbench.body_model.clouds.emulated_body import Bodies, UnreachableError
from daemon.workbench.body_model.evaluation import shapes
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import BodyInPlace
from daemon.workbench.planning.clearance_slopes import distance_at
from daemon.workbench.planning.gaussian_process import ITERATIONS, lowered
from daemon.workbench.planning.goals import TipGoal
from daemon.workbench.planning.path_risk import interval, resampled
from daemon.workbench.planning.plan import Candidate, Plan, Settings
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import Mesh, environment
from tests import SHIPPED_ROBOTS

ROBOTS: Final = ("tendon_arm", "soft_arm", "concentric_tubes")
_CLOCK: Final = MonotonicClock()
_TRIANGLES = 2000
_OPENING_MM = 60.0
_OPENING_RAD = 0.35
_SAFE = 0.01
"""Of the places between which it is planned: what they risk, no path can lower."""
_TRIED = 400
_FIRST_BODY = 1000
"""Seeds from here: the model was made of others."""
_WORTH = 0.05
"""Contact risk of the whole nominal path: pairs with less have nothing to lower."""


def opened(chest: Mesh) -> Mesh:
    """The wall behind where the body comes in, pushed back."""
    middle = 0.5 * (chest.vertices_mm.max(axis=0) + chest.vertices_mm.min(axis=0))
    away = chest.vertices_mm - middle
    directions = away / np.linalg.norm(away, axis=1, keepdims=True)
    port = np.array(shapes.CHEST_PORT.centre_mm) - middle
    angle = np.arccos(np.clip(directions @ port / np.linalg.norm(port), -1.0, 1.0))
    pushed = _OPENING_MM * np.exp(-0.5 * (angle / _OPENING_RAD) ** 2)
    return Mesh(chest.vertices_mm + pushed[:, None] * directions, chest.triangles)


class Rollouts:
    """Emulated bodies of the robot's design, each come to the start from somewhere else."""

    def __init__(self, body: BodyInPlace, starts: Sequence[FloatArray], bodies: int) -> None:
        """bodies: how many others of the design; 0: the robot file's own alone."""
        self._in_place = body
        self._starts = starts
        self._bodies = Bodies(body.robot, bodies, _FIRST_BODY)
        self._radius_mm = body.model.basis.radius_mm.min()

    def touching(self, path: FloatArray, rollouts: int, seed: int) -> tuple[int, int]:
        """How many touch on the way, of how many that came through."""
        random = np.random.default_rng(seed)
        places = resampled(self._in_place, path, 25)
        touched = through = 0
        for _ in range(rollouts):
            body = self._bodies.rested(random)
            try:
                body.go(self._starts[int(random.integers(len(self._starts)))])
                nearest = min(self._clearance(body.go(u).centreline_mm) for u in places)
            except UnreachableError:
                continue
            through += 1
            touched += nearest <= 0.0
        return touched, through

    def _clearance(self, centreline_mm: FloatArray) -> float:
        """Of what is not in the port, mm."""
        port = self._in_place.environment.port
        if port is not None:
            centreline_mm = centreline_mm[centreline_mm[:, 2] > port.depth_mm]
        return float(distance_at(self._in_place.grid, centreline_mm)[0].min() - self._radius_mm)


@dataclass(frozen=True, eq=False)
class Chest:
    """One cavity with the robot in it, ready to be planned in."""

    number: int
    body: BodyInPlace
    planner: Planner
    roadmap_s: float
    """How long its roadmap took: who plans once makes it first."""

    @classmethod
    def of(cls, robot_name: str, number: int, scale: float, closed: bool) -> "Chest":
        """scale: how much larger than a chest. closed: there is no opening behind the base."""
        robot = load_robot(SHIPPED_ROBOTS / f"{robot_name}.yaml").robot
        model = read_model(SHIPPED_ROBOTS.parent / "models" / f"{robot_name}.npz").model
        chest = shapes.chest(_TRIANGLES, 9 + number)
        mesh = Mesh(scale * chest.vertices_mm, chest.triangles)
        around = environment(
            *(mesh if closed else opened(mesh)), free="inside", port=shapes.CHEST_PORT
        )
        grid = distance_grid(around, 2.0, model.basis.thickest_mm + 10.0)
        body = BodyInPlace(robot, model, around, grid)
        planner = Planner(body, Settings(seed=1 + number))
        began_ns = _CLOCK.now_ns()
        assert len(planner.roadmap.places)
        return cls(number, body, planner, (_CLOCK.now_ns() - began_ns) * 1e-9)

    @property
    def safe(self) -> list[int]:
        """Places of the roadmap between which it is planned."""
        return [k for k, one in enumerate(self.planner.roadmap.standings) if one.risk <= _SAFE]

    def pairs(self, count: int) -> Iterator[tuple[FloatArray, TipGoal, Candidate]]:
        """Starts and goals, and the nominal path between them; always the same ones."""
        random, places = np.random.default_rng(self.number), self.planner.roadmap.places
        tips, safe, found = self.planner.roadmap.tips(), self.safe, 0
        for _ in range(_TRIED):
            if found == count:
                return
            a, b = (int(k) for k in random.choice(safe, 2, replace=False))
            start, goal = places[a], TipGoal(tips[b])
            nominal = self.planner.nominal(start, [goal])
            if isinstance(nominal, Blocked) or nominal.risk.probability < _WORTH:
                continue
            found += 1
            yield start, goal, nominal


class Kept:
    """Figures of each pair, by chest and number, as a file of lines that may be cut off."""

    def __init__(self, path: Path | None) -> None:
        """None: nothing is kept."""
        self._path = path
        self._found: dict[tuple[int, int], dict[str, Any]] = {}
        for line in path.read_text().splitlines() if path is not None and path.exists() else ():
            try:
                one = json.loads(line)
                self._found[one["chest"], one["number"]] = one
            except (ValueError, KeyError, TypeError):
                continue

    def __contains__(self, key: tuple[int, int]) -> bool:
        return key in self._found

    def all(self) -> list[dict[str, Any]]:
        """In their order."""
        return [self._found[key] for key in sorted(self._found)]

    def add(self, one: dict[str, Any]) -> None:
        self._found[one["chest"], one["number"]] = one
        text = json.dumps(one)
        print(text, file=sys.stderr, flush=True)
        if self._path is not None:
            with self._path.open("a") as file:
                file.write(f"{text}\n")


def one_chest(arguments: argparse.Namespace, number: int, kept: Kept) -> None:
    """All pairs in one chest."""
    wanted = range(arguments.pairs)
    if all((number, one) in kept or _left_out(arguments, number, one) for one in wanted):
        return
    chest = Chest.of(arguments.robot, number, arguments.scale, arguments.closed)
    starts = [chest.planner.roadmap.places[k] for k in chest.safe]
    rollouts = Rollouts(chest.body, starts, arguments.bodies)
    for one, (start, goal, nominal) in enumerate(chest.pairs(arguments.pairs)):
        if (number, one) in kept or _left_out(arguments, number, one):
            continue
        began_ns = _CLOCK.now_ns()
        plan = chest.planner.plan(start, [goal])
        took_s = (_CLOCK.now_ns() - began_ns) * 1e-9
        pair: dict[str, Any] = {
            "chest": number,
            "number": one,
            "took_s": took_s,
            "with_roadmap_s": took_s + chest.roadmap_s,
            "nominal_risk": nominal.risk.probability,
        }
        if isinstance(plan, Blocked):
            pair |= {"none": plan.why, "text": plan.text}
        elif not arguments.times:
            pair |= _compared(chest, nominal, plan)
            if arguments.rollouts:
                for name, way in (("touched_nominal", nominal.waypoints), ("touched", plan.u)):
                    pair[name] = rollouts.touching(way, arguments.rollouts, 1)
        kept.add(pair)


def _left_out(arguments: argparse.Namespace, chest: int, pair: int) -> bool:
    return bool(chest * arguments.pairs + pair < arguments.skip)


def _compared(chest: Chest, nominal: Candidate, plan: Plan) -> dict[str, Any]:
    """Risks of the nominal path, the paper's and ours."""
    body, planner = chest.body, chest.planner
    waypoints = resampled(body, nominal.waypoints, planner.settings.waypoints)
    paper = lowered(body, waypoints, ITERATIONS, 1, Unheard())
    twice = planner.risks.of(resampled(body, plan.u, 2 * len(plan.u)))
    return {
        "eq_10": [nominal.printed, paper.course[-1], plan.printed],
        "contact_risk": [
            nominal.risk.probability,
            planner.risks.of(paper.waypoints).probability,
            plan.risk.probability,
        ],
        "upper_limit": plan.risk.upper_limit,
        "twice_the_waypoints_within": bool(
            plan.risk.lowest <= twice.probability <= plan.risk.highest
        ),
    }


def figures_of(pairs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Of all pairs together, for JSON."""
    if not pairs:
        return {"pairs": 0}
    figures: dict[str, Any] = {
        "pairs": len(pairs),
        "planned": sum("none" not in pair for pair in pairs),
        "none": [pair["none"] for pair in pairs if "none" in pair],
    }
    for name in ("took_s", "with_roadmap_s"):
        times = [pair[name] for pair in pairs]
        figures[name] = {
            f"p{share}": float(np.quantile(times, 0.01 * share)) for share in (50, 95, 100)
        }
    compared = [pair for pair in pairs if "eq_10" in pair]
    if not compared:
        return figures
    for name in ("eq_10", "contact_risk"):
        means = np.mean([pair[name] for pair in compared], axis=0).tolist()
        figures[f"mean_{name}"] = dict(zip(("nominal", "paper", "optimised"), means, strict=True))
    figures["twice_the_waypoints_within"] = sum(
        pair["twice_the_waypoints_within"] for pair in compared
    )
    for name in ("touched_nominal", "touched"):
        if counts := [pair[name] for pair in compared if name in pair]:
            count, of = np.sum(counts, axis=0).tolist()
            figures[name] = {"bodies": count, "of": of, "between": interval(count, max(of, 1))}
    return figures


def main() -> int:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.planning")
    parser.add_argument("--robot", choices=ROBOTS, default=ROBOTS[0])
    parser.add_argument("--chests", type=int, default=1)
    parser.add_argument("--pairs", type=int, default=3, help="in each chest")
    parser.add_argument("--skip", type=int, default=0, metavar="N", help="the first N of them all")
    parser.add_argument("--rollouts", type=int, default=4, help="bodies along each path")
    parser.add_argument("--bodies", type=int, default=40, help="that differ; 0: the robot's own")
    parser.add_argument("--scale", type=float, default=1.0, help="of the chests, about the port")
    parser.add_argument("--closed", action="store_true", help="without an opening behind the base")
    parser.add_argument("--times", action="store_true", help="only how long planning takes")
    parser.add_argument("--out", type=Path, metavar="PAIRS.jsonl", help="each as it ends")
    arguments = parser.parse_args()
    kept = Kept(arguments.out)
    for number in range(arguments.chests):
        one_chest(arguments, number, kept)
    figures = figures_of(kept.all())
    print(json.dumps(figures, indent=2))
    touched = figures.get("touched", {"between": (0.0, 0.0)})["between"][0]
    return int(touched > 0.05)


if __name__ == "__main__":
    sys.exit(main())
