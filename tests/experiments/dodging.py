"""Something stands beside a part of the body while the tip goes its way: with what does it pay?

`python -m tests.experiments.dodging` plays each scene twice in virtual time, once with steps that
are turned aside by the clearance of the whole body alone (`whole`) and once by that of its parts
with the tip's task in view (`parts`): a ball, a slab, a slot or two balls, beside the tip, the
middle or the base of an arm, where the body comes by when nothing is there. Contacts are counted by
the plant's own shape, which nothing in the daemon can see. Prints a line for each scene and one
JSON; ends with exit code 1 where anything is touched with the parts, or where the tip is further
off than without them. A few scenes by default; `--full`: all kinds of both arms and the tubes,
100 scenes of several seeds, an hour and more on one core.
"""

import argparse
import asyncio
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from config.control import RiskSettings
from config.loader import load_robot
from config.robot import Robot
from daemon.host.processes import worker_processes
from daemon.loop.step_messages import SLIDING
from daemon.messages import Risk, Tip
from daemon.risk.body_risk_source import BodyRiskSource, make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball, box, joined
from safety.gate import RISK
from safety.risk.surroundings.environment import Mesh
from safety.risk_source import Clearance, KnownBody, RiskReading, RiskSource, TipComparison
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.service.grazing import (
    BROYDEN,
    TENDON_ARM,
    TUBES,
    TUBES_CIRCLE,
    StoppedClock,
    once_round,
)
from tests.daemon.service.rig import Rig, on_a_rig

Floats = NDArray[np.float64]

PARTS: Final = {"tip": 1.0, "middle": 0.6, "base": 0.4}
"""Where along the body something stands, as a share of its length."""
INTO_MM: Final = {"soft": 0.0, "tendon": 3.0, "tubes": 1.0}
"""How far it reaches into where the body would be, at most: more than what a body may be off by."""
HOME_MM: Final = {"soft": 8.0, "tendon": 5.0, "tubes": 3.0}
"""At least so far it stays from where the body is armed, which is refused otherwise."""
KINDS: Final = ("ball", "slab", "slot", "two balls")
_CYCLE_S: Final = 15.0
_WITHIN_MM: Final = 0.1
"""Noise of a mean error: seeds of the tracker alone make it another by so much."""


@dataclass(frozen=True)
class Subject:
    """A robot that goes round a circle."""

    file: Path
    model: str
    controller: dict[str, Any]
    circle: dict[str, Any]


SUBJECTS: Final = {
    "soft": Subject(
        SOFT_ARM,
        "builtin:soft_arm.npz",
        {"kind": "broyden"},
        {"kind": "circle", "center_mm": [0.0, 0.0, 187.0], "radius_mm": 30.0},
    ),
    "tendon": Subject(
        TENDON_ARM,
        "builtin:tendon_arm.npz",
        BROYDEN,
        {"kind": "circle", "center_mm": [0.0, 0.0, 197.5], "radius_mm": 25.0},
    ),
    "tubes": Subject(TUBES, "builtin:concentric_tubes.npz", {"kind": "broyden"}, {**TUBES_CIRCLE}),
}


@dataclass(frozen=True)
class Scene:
    """What stands where."""

    robot: str
    kind: str
    part: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.robot}, {self.kind} beside the {self.part}, seed {self.seed}"


@dataclass(frozen=True)
class Passed:
    """What became of one way through a scene."""

    state: str
    causes: list[str]
    least_clearance_mm: float
    """Of the plant's own shape."""
    mean_error_mm: float
    worst_error_mm: float
    refused: int
    """Steps that the gate did not let through, and those that it had to shorten for the risk."""
    shortened: int
    turned_aside: int
    steps: int


@dataclass(frozen=True)
class Solid:
    """A ball, or a box along the columns of `turn`."""

    centre_mm: Floats
    half_mm: Floats
    """(1,) the ball's radius, (3,) of the box."""
    turn: Floats

    def mesh(self) -> Mesh:
        if self.half_mm.size == 1:
            return ball(float(self.half_mm[0]), self.centre_mm.tolist(), 2000)
        made = box((2.0 * self.half_mm).tolist(), (0.0, 0.0, 0.0), 6)
        return Mesh(made.vertices_mm @ self.turn.T + self.centre_mm, made.triangles)

    def distance_mm(self, places: Floats) -> float:
        """Least of (n, 3) places from its surface, negative inside."""
        away = places - self.centre_mm
        if self.half_mm.size == 1:
            return float(np.linalg.norm(away, axis=1).min() - self.half_mm[0])
        beyond = np.abs(away @ self.turn) - self.half_mm
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return float((outside + np.minimum(beyond.max(axis=1), 0.0)).min())


class WholeBody:
    """A risk source that says nothing of the body's parts: steps are turned aside without them."""

    def __init__(self, source: BodyRiskSource) -> None:
        self._source = source

    @property
    def name(self) -> str:
        return self._source.name

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        return self._source.assess(u_from, u_to, t_ns)

    def compare(
        self,
        lately: Sequence[Sequence[float]],
        tip_mm: Sequence[float],
        t_ns: int,
        direction: Sequence[float] | None = None,
    ) -> TipComparison | None:
        return self._source.compare(lately, tip_mm, t_ns, direction)

    def body(self, u: Sequence[float]) -> KnownBody | None:
        return self._source.body(u)

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        found = self._source.clearance(u, risk)
        return None if found is None else replace(found, parts=(), tip_slope=())


class Witness:
    """Looks at the body itself while a scene plays."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        self._solids = solids
        self.least_clearance_mm = np.inf
        self.lines_mm: list[Floats] = []
        self.radius_mm = 0.0

    async def watch(self, rig: Rig) -> None:
        while True:
            state = rig.lab.body.record.state
            line = np.asarray(state.centreline_mm)
            self.radius_mm = state.radius_mm
            self.lines_mm.append(line.copy())
            shares = np.linspace(0.0, 1.0, 5)[:, None, None]
            fine = (line[:-1] + shares * (line[1:] - line[:-1])).reshape(-1, 3)
            for solid in self._solids:
                away_mm = solid.distance_mm(fine) - state.radius_mm
                self.least_clearance_mm = min(self.least_clearance_mm, away_mm)
            await asyncio.sleep(0.025)


def played(
    subject: Subject, file: Path, seed: int, risk: RiskSource | None, solids: Sequence[Solid]
) -> tuple[Passed, Witness]:
    """Once round. risk: None: nothing stands anywhere."""
    witness, ended = Witness(solids), {"state": "not armed", "causes": ["not armed"]}

    async def scene(rig: Rig) -> None:
        circle = {**subject.circle, "plane": "xy", "cycle_s": _CYCLE_S}
        try:
            await once_round(rig, circle, witness.watch(rig), subject.controller)
        finally:
            ended.update(state=rig.state.value, causes=sorted(rig.causes))

    def change(robot: Robot) -> Robot:
        assert robot.emulation is not None
        update: dict[str, Any] = {"emulation": robot.emulation.model_copy(update={"seed": seed})}
        if risk is None:
            update["risk"] = RiskSettings()
        return robot.model_copy(update=update)

    rig = on_a_rig(scene, path=file, change=change, risk=risk, seed=seed)
    risks = [message for message in rig.told if isinstance(message, Risk)]
    errors = [
        message.error_mm
        for message in rig.told
        if isinstance(message, Tip) and message.cycle >= 0 and message.error_mm is not None
    ]
    blocked = [one for one in risks if RISK in one.reasons]
    passed = Passed(
        str(ended["state"]),
        list(ended["causes"]),
        float(witness.least_clearance_mm),
        float(np.mean(errors)) if errors else np.inf,
        float(np.max(errors)) if errors else np.inf,
        sum(one.scale <= 0.0 for one in blocked),
        sum(one.scale > 0.0 for one in blocked),
        sum(SLIDING in one.reasons for one in risks),
        len(risks),
    )
    return passed, witness


@lru_cache
def free_way(robot: str) -> tuple[Floats, Floats, float, Passed]:
    """(t, n, 3) where the body goes when nothing is there, (n, 3) where it begins, its radius, and
    how far its tip is off."""
    subject = SUBJECTS[robot]
    passed, witness = played(subject, subject.file, 1, None, ())
    frames = int(_CYCLE_S / 0.025)
    lines = np.array(witness.lines_mm)
    return lines[-frames:], lines[0], witness.radius_mm, passed


def solids_of(scene: Scene) -> list[Solid]:
    """Where the body comes by at a moment that the seed says, a little in its way."""
    lines, home, thick_mm, _ = free_way(scene.robot)
    random = np.random.default_rng([scene.seed, KINDS.index(scene.kind)])
    at = int(random.uniform(0.25, 0.9) * len(lines))
    node = round(PARTS[scene.part] * (lines.shape[1] - 1))
    place, line = lines[at, node], lines[at]
    along = line[min(node + 1, len(line) - 1)] - line[max(node - 1, 0)]
    along /= np.linalg.norm(along)
    out = place - lines[:, node].mean(axis=0)
    out -= (out @ along) * along
    out /= np.linalg.norm(out)
    aside = np.cross(along, out)
    stands = _Stands(place, np.stack([out, aside, along], axis=1), thick_mm)
    into_mm = INTO_MM[scene.robot] - random.uniform(0.0, 2.0)
    while True:
        solids = stands.solids(scene.kind, into_mm, 0.6 * thick_mm + 2.0 * np.ptp(lines[:, node]))
        clear_mm = min(solid.distance_mm(home) for solid in solids) - thick_mm
        if clear_mm >= HOME_MM[scene.robot]:
            return solids
        into_mm -= 0.25


class _Stands(NamedTuple):
    """Beside a place of the body. turn: its columns lead out, aside and along the body."""

    place: Floats
    turn: Floats
    thick_mm: float

    def solids(self, kind: str, into_mm: float, behind_mm: float) -> list[Solid]:
        out, aside, _ = self.turn.T
        if kind == "ball":
            return [self._ball(out, into_mm)]
        if kind == "slab":
            return [self._slab(out, into_mm)]
        if kind == "slot":  # the other wall stands as far behind as the body needs to start
            return [self._slab(out, into_mm), self._slab(-out, -behind_mm)]
        return [
            self._ball(np.cos(lean) * out + np.sin(lean) * aside, into_mm) for lean in (0.9, -0.9)
        ]

    def _ball(self, way: Floats, into_mm: float) -> Solid:
        size_mm = 8.0 if self.thick_mm < 5.0 else 12.0
        centre = self.place + (self.thick_mm + size_mm - into_mm) * way
        return Solid(centre, np.array([size_mm]), self.turn)

    def _slab(self, way: Floats, into_mm: float) -> Solid:
        centre = self.place + (self.thick_mm + 3.0 - into_mm) * way
        return Solid(centre, np.array([3.0, 20.0, 8.0]), self.turn)


def both_ways(scene: Scene) -> tuple[Scene, Passed, Passed]:
    """Without the parts, and with them."""
    subject, solids = SUBJECTS[scene.robot], solids_of(scene)
    with tempfile.TemporaryDirectory() as name:
        os.environ["XDG_CACHE_HOME"] = name
        file = _robot_file(Path(name), subject, solids)
        found = []
        for whole in (True, False):
            risk = make_risk_source(load_robot(file), StoppedClock())
            assert isinstance(risk, BodyRiskSource)
            source = WholeBody(risk) if whole else risk
            found.append(played(subject, file, scene.seed, source, solids)[0])
    return scene, found[0], found[1]


def _robot_file(folder: Path, subject: Subject, solids: Sequence[Solid]) -> Path:
    write_mesh(folder / "solids.stl", joined([solid.mesh() for solid in solids]))
    robot: dict[str, Any] = yaml.safe_load(subject.file.read_text())
    surface = {"mesh": "solids.stl", "free": "outside"}
    robot["risk"] = {**robot.get("risk", {}), "model": subject.model, "surface": surface}
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path


def figures_of(found: Sequence[tuple[Scene, Passed, Passed]]) -> dict[str, Any]:
    """For JSON: of all, and by robot and by part."""
    groups: dict[str, list[tuple[Scene, Passed, Passed]]] = {"all": list(found)}
    for one in found:
        groups.setdefault(f"{one[0].robot}, {one[0].part}", []).append(one)
    return {name: _figures(group) for name, group in groups.items()}


def _figures(found: Sequence[tuple[Scene, Passed, Passed]]) -> dict[str, Any]:
    figures: dict[str, Any] = {"scenes": len(found)}
    for name, runs in (("whole", [w for _, w, _ in found]), ("parts", [p for _, _, p in found])):
        figures[name] = {
            "touched": sum(run.least_clearance_mm <= 0.0 for run in runs),
            "got_round": sum(run.state == OperatingState.ARMED.value for run in runs),
            "least_clearance_mm": round(min(run.least_clearance_mm for run in runs), 2),
            "mean_error_mm": round(float(np.mean([run.mean_error_mm for run in runs])), 3),
            "worst_error_mm": round(max(run.worst_error_mm for run in runs), 2),
            "refused": sum(run.refused for run in runs),
            "shortened": sum(run.shortened for run in runs),
            "turned_aside": sum(run.turned_aside for run in runs),
            "steps": sum(run.steps for run in runs),
        }
    figures["worse"] = [scene.name for scene, whole, parts in found if is_worse(whole, parts)]
    return figures


def is_worse(whole: Passed, parts: Passed) -> bool:
    """Whether the parts have cost anything that it had without them."""
    if parts.state != whole.state:
        return whole.state == OperatingState.ARMED.value
    return parts.mean_error_mm > whole.mean_error_mm + _WITHIN_MM


def _in_words(scene: Scene, whole: Passed, parts: Passed) -> str:
    def of(run: Passed) -> str:
        return (
            f"{run.mean_error_mm:6.2f} {run.worst_error_mm:6.2f} mm, {run.least_clearance_mm:5.1f} "
            f"mm clear, {run.refused:3d} refused, {run.shortened:3d} cut, {run.turned_aside:4d} "
            f"aside, {run.state}{' ' + ','.join(run.causes) if run.causes else ''}"
        )

    mark = " WORSE" if is_worse(whole, parts) else ""
    return f"{scene.name}{mark}\n   whole {of(whole)}\n   parts {of(parts)}"


def main() -> int:
    """Prints one JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="every robot, kind and part")
    parser.add_argument("--robots", nargs="*", default=["soft", "tendon"], choices=SUBJECTS)
    parser.add_argument("--kinds", nargs="*", default=["ball"], choices=KINDS)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=PARTS)
    parser.add_argument("--seeds", type=int, nargs="*", default=[1])
    parser.add_argument("--processes", type=int, default=1, metavar="N")
    asked = parser.parse_args()
    lists = (asked.robots, asked.kinds, asked.parts, asked.seeds)
    if asked.full:
        lists = (["soft", "tendon"], list(KINDS), list(PARTS), [1, 2, 3, 4])
    scenes = [Scene(*parts) for parts in itertools.product(*lists)]
    if asked.full:
        scenes += [Scene("tubes", "ball", "tip", seed) for seed in (1, 2, 3, 4)]
    with worker_processes(asked.processes) as workers:
        found = []
        for one in workers.map(both_ways, scenes):
            found.append(one)
            print(_in_words(*one), file=sys.stderr, flush=True)
    figures = figures_of(found)
    print(json.dumps(figures, indent=2))
    return 1 if figures["all"]["parts"]["touched"] or figures["all"]["worse"] else 0


if __name__ == "__main__":
    sys.exit(main())
