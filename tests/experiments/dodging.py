"""Something stands beside a part of the body while the tip goes its way: with what does it pay?

`python -m tests.experiments.dodging` plays each scene twice in virtual time, once with steps that
are turned aside by the clearance of the whole body alone (`whole`) and once by that of its parts
with the tip's task in view (`parts`): a ball, a slab, a slot or two balls, beside the tip, the
middle or the base of an arm, where the body comes by when nothing is there. Contacts are counted by
the plant's own shape, which nothing in the daemon can see. Prints a line for each scene and one
JSON; ends with exit code 1 where anything is touched with the parts, where the tip is further off
than without them, or where more steps are refused. A few scenes by default; `--full`: all kinds of
both arms and what there is room for beside the tubes, 108 scenes of several seeds, an hour and more
on one core; `--share 2/3` of them, `--robot tendon` alone. What `--out` has kept is not played
again.
"""

import argparse
import asyncio
import itertools
import json
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from config.control import RiskSettings
from config.loader import load_robot
from config.robot import Robot
from daemon.host.processes import WHOLE, Share, worker_processes
from daemon.loop.step_messages import SLIDING
from daemon.messages import Risk, Tip
from daemon.risk.body_risk_source import BodyRiskSource, make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.clouds.emulated_body import evenly_spaced
from daemon.workbench.body_model.evaluation.shapes import joined
from safety.gate import RISK
from safety.risk_source import Clearance, KnownBody, RiskReading, RiskSource, TipComparison
from safety.states import OperatingState
from tests.daemon.service.grazing import StoppedClock, once_round
from tests.daemon.service.rig import Rig, on_a_rig
from tests.experiments.dodging_scenes import (
    HOME_MM,
    INTO_MM,
    KINDS,
    PARTS,
    SUBJECTS,
    Floats,
    Scene,
    Solid,
    Stands,
    Subject,
)

_CYCLE_S: Final = 15.0
_WITHIN_MM: Final = 0.1
"""Noise of a mean error: seeds of the tracker alone make it another by so much."""
_WITHIN_SHARE: Final = 0.05
"""... of what it is without parts, where that is more: beside the tip, where four noises of the
tracker make a mean of 3.3 mm anything from 3.2 to 3.4."""


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
            # Of tubes that slide the plant has not always as many.
            nodes = len(self.lines_mm[0]) if self.lines_mm else len(line)
            self.lines_mm.append(evenly_spaced(line, nodes).copy())
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
    stands = Stands(place, np.stack([out, aside, along], axis=1), thick_mm)
    into_mm = INTO_MM[scene.robot] - random.uniform(0.0, 2.0)
    behind_mm = 0.6 * thick_mm + 2.0 * float(np.ptp(lines[:, node]))
    return solids_between(stands, scene.kind, into_mm, behind_mm, (home, HOME_MM[scene.robot]))


def solids_between(
    stands: Stands, kind: str, into_mm: float, behind_mm: float, home: tuple[Floats, float]
) -> list[Solid]:
    """As far into the way as is said, but for the room at home: (n, 3) the body there, and how much
    of it it needs."""
    line, room_mm = home
    while True:
        solids = stands.solids(kind, into_mm, behind_mm)
        if min(solid.distance_mm(line) for solid in solids) - stands.thick_mm >= room_mm:
            return solids
        into_mm -= 0.25


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
    noise_mm = max(_WITHIN_MM, _WITHIN_SHARE * whole.mean_error_mm)
    return parts.mean_error_mm > whole.mean_error_mm + noise_mm


def _in_words(scene: Scene, whole: Passed, parts: Passed) -> str:
    def of(run: Passed) -> str:
        return (
            f"{run.mean_error_mm:6.2f} {run.worst_error_mm:6.2f} mm, {run.least_clearance_mm:5.1f} "
            f"mm clear, {run.refused:3d} refused, {run.shortened:3d} cut, {run.turned_aside:4d} "
            f"aside, {run.state}{' ' + ','.join(run.causes) if run.causes else ''}"
        )

    mark = " WORSE" if is_worse(whole, parts) else ""
    return f"{scene.name}{mark}\n   whole {of(whole)}\n   parts {of(parts)}"


def scenes_of(asked: argparse.Namespace) -> list[Scene]:
    """Which are asked for, in an order in which kinds and parts come early."""
    lists = (asked.robot, asked.kinds, asked.parts, asked.seeds)
    if asked.full:
        lists = (["soft", "tendon"], list(KINDS), list(PARTS), [1, 2, 3, 4])
    scenes = [Scene(*parts) for parts in itertools.product(*lists)]
    if asked.full:
        by_tubes = (["tubes"], ["ball", "slab"], ["tip", "middle"], [1, 2, 3])
        scenes += [Scene(*parts) for parts in itertools.product(*by_tubes)]
        scenes = [scene for scene in scenes if scene.robot in asked.robot]
    scenes.sort(key=lambda scene: scene.seed)
    return [scene for number, scene in enumerate(scenes) if asked.share.has(number)]


def kept(path: Path | None) -> dict[Scene, tuple[Passed, Passed]]:
    """What was played before, by its scene. A line that was cut off was not."""
    if path is None or not path.exists():
        return {}
    found = {}
    for line in path.read_text().splitlines():
        try:
            one = json.loads(line)
            found[Scene(**one["scene"])] = Passed(**one["whole"]), Passed(**one["parts"])
        except (ValueError, KeyError, TypeError):
            continue
    return found


def keep(path: Path | None, scene: Scene, whole: Passed, parts: Passed) -> None:
    """For `kept`."""
    if path is not None:
        one = {"scene": asdict(scene), "whole": asdict(whole), "parts": asdict(parts)}
        with path.open("a") as file:
            file.write(f"{json.dumps(one)}\n")


def options(words: Sequence[str] | None = None) -> argparse.Namespace:
    """words: None: those of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="every kind and part")
    parser.add_argument("--robot", nargs="*", choices=SUBJECTS)
    parser.add_argument("--kinds", nargs="*", default=["ball"], choices=KINDS)
    parser.add_argument("--parts", nargs="*", default=list(PARTS), choices=PARTS)
    parser.add_argument("--seeds", type=int, nargs="*", default=[1])
    parser.add_argument("--share", type=Share.of, default=WHOLE, metavar="K/N")
    parser.add_argument("--out", type=Path, metavar="SCENES.jsonl", help="each as it ends")
    parser.add_argument("--processes", type=int, default=1, metavar="N")
    asked = parser.parse_args(words)
    if asked.robot is None:
        asked.robot = list(SUBJECTS) if asked.full else ["soft", "tendon"]
    return asked


def main() -> int:
    """Prints one JSON."""
    asked = options()
    scenes, before = scenes_of(asked), kept(asked.out)
    found = [(scene, *before[scene]) for scene in scenes if scene in before]
    with worker_processes(asked.processes) as workers:
        for one in workers.map(both_ways, [scene for scene in scenes if scene not in before]):
            found.append(one)
            keep(asked.out, *one)
            print(_in_words(*one), file=sys.stderr, flush=True)
    figures = figures_of(found)
    print(json.dumps(figures, indent=2))
    of_all = figures["all"]
    refused_more = of_all["parts"]["refused"] > of_all["whole"]["refused"]
    return 1 if of_all["parts"]["touched"] or of_all["worse"] or refused_more else 0


if __name__ == "__main__":
    sys.exit(main())
