"""Planned paths in chests, and what a plant does on them: `python -m tests.experiments.planning`.

Between random places in a cavity like a chest: the path as the paper plans it first (all means
free, the shortest in the roadmap), the paper's own way to lower its risk, and ours. Of each the
risk of the whole path, equation 10, and how many emulated bodies that go along it touch. Prints one
JSON. Ends with exit code 1 where a body touches on an optimised path that says it hardly does.

Pairs are those whose nominal path is likely to touch: all means of the mixture are free on it, and
the body leans on a wall nevertheless. Equation 10 hardly sees that. The chest has an opening behind
the body's base, since equation 10 counts the wall round the port: 20 waypoints at rest in the
middle of the cavity have 0.34 with it (`--closed`).
The default is small; the whole of it: `--chests 3 --pairs 7 --rollouts 1000`, with `--robot
soft_arm` again.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

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
from daemon.workbench.planning.plan import Settings
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import Mesh, environment
from tests import SHIPPED_ROBOTS

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


def one_chest(arguments: argparse.Namespace, number: int) -> list[dict[str, Any]]:
    """All pairs in one chest."""
    robot = load_robot(SHIPPED_ROBOTS / f"{arguments.robot}.yaml").robot
    model = read_model(SHIPPED_ROBOTS.parent / "models" / f"{arguments.robot}.npz").model
    mesh = shapes.chest(_TRIANGLES, 9 + number)
    around = environment(
        *(mesh if arguments.closed else opened(mesh)), free="inside", port=shapes.CHEST_PORT
    )
    grid = distance_grid(around, 2.0, model.basis.thickest_mm + 10.0)
    body = BodyInPlace(robot, model, around, grid)
    planner = Planner(body, Settings(seed=1 + number))
    roadmap = planner.roadmap
    safe = [k for k, one in enumerate(roadmap.standings) if one.risk <= _SAFE]
    rollouts = Rollouts(body, [roadmap.places[k] for k in safe], arguments.bodies)
    random, clock = np.random.default_rng(number), MonotonicClock()
    found: list[dict[str, Any]] = []
    tips = roadmap.tips()
    for _ in range(_TRIED):
        if len(found) == arguments.pairs:
            break
        a, b = (int(k) for k in random.choice(safe, 2, replace=False))
        start, goal = roadmap.places[a], TipGoal(tips[b])
        nominal = planner.nominal(start, [goal])
        if isinstance(nominal, Blocked) or nominal.risk.probability < _WORTH:
            continue
        began_ns = clock.now_ns()
        plan = planner.plan(start, [goal])
        took_s = (clock.now_ns() - began_ns) * 1e-9
        if isinstance(plan, Blocked):
            found.append(
                {"none": plan.why, "took_s": took_s, "nominal_risk": nominal.risk.probability}
            )
            continue
        waypoints = resampled(body, nominal.waypoints, planner.settings.waypoints)
        paper = lowered(body, waypoints, ITERATIONS, 1, Unheard())
        twice = planner.risks.of(resampled(body, plan.u, 2 * len(plan.u)))
        pair: dict[str, Any] = {
            "took_s": took_s,
            "eq_10": [nominal.printed, paper.course[-1], plan.printed],
            "contact_risk": [
                nominal.risk.probability,
                planner.risks.of(paper.waypoints).probability,
                plan.risk.probability,
            ],
            "upper_limit": plan.risk.upper_limit,
            "twice_the_waypoints_within": plan.risk.lowest
            <= twice.probability
            <= plan.risk.highest,
        }
        if arguments.rollouts:
            pair["touched_nominal"] = rollouts.touching(nominal.waypoints, arguments.rollouts, 1)
            pair["touched"] = rollouts.touching(plan.u, arguments.rollouts, 1)
        found.append(pair)
        print(json.dumps(pair), file=sys.stderr)
    return found


def figures_of(pairs: Sequence[dict[str, Any]], rollouts: int) -> dict[str, Any]:
    """Of all pairs together, for JSON."""
    planned = [pair for pair in pairs if "none" not in pair]
    if not pairs:
        return {"pairs": 0}
    figures: dict[str, Any] = {
        "pairs": len(pairs),
        "planned": len(planned),
        "none": [pair["none"] for pair in pairs if "none" in pair],
        "planning_p95_s": float(np.quantile([pair["took_s"] for pair in pairs], 0.95)),
    }
    if not planned:
        return figures
    for name in ("eq_10", "contact_risk"):
        means = np.mean([pair[name] for pair in planned], axis=0).tolist()
        figures[f"mean_{name}"] = dict(zip(("nominal", "paper", "optimised"), means, strict=True))
    figures["twice_the_waypoints_within"] = sum(
        pair["twice_the_waypoints_within"] for pair in planned
    )
    if rollouts:
        for name in ("touched_nominal", "touched"):
            count, of = np.sum([pair[name] for pair in planned], axis=0).tolist()
            figures[name] = {"bodies": count, "of": of, "between": interval(count, max(of, 1))}
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.experiments.planning")
    parser.add_argument("--robot", choices=("tendon_arm", "soft_arm"), default="tendon_arm")
    parser.add_argument("--chests", type=int, default=1)
    parser.add_argument("--pairs", type=int, default=3, help="in each chest")
    parser.add_argument("--rollouts", type=int, default=4, help="bodies along each path")
    parser.add_argument("--bodies", type=int, default=40, help="that differ; 0: the robot's own")
    parser.add_argument("--closed", action="store_true", help="without an opening behind the base")
    parser.add_argument("--out", type=Path, help="each pair, as JSON")
    arguments = parser.parse_args()
    pairs = [pair for number in range(arguments.chests) for pair in one_chest(arguments, number)]
    if arguments.out is not None:
        arguments.out.write_text(json.dumps(pairs))
    figures = figures_of(pairs, arguments.rollouts)
    print(json.dumps(figures, indent=2))
    touched = figures.get("touched", {"between": (0.0, 0.0)})["between"][0]
    return int(touched > 0.05)


if __name__ == "__main__":
    sys.exit(main())
