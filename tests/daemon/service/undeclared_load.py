"""The soft arm among balls, and a weight at its tip that nobody has declared.

Every seed is another arm, another circle, other balls near the body's way, another noise, and
another moment at which the weight is hung on: before arming, or on the way.
"""

import asyncio
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from config.emulation.plants import SoftArmPlant
from config.loader import load_robot
from config.robot import Robot
from daemon.messages import Acquire, Arm, Event, Load, Refusal, Risk, Start
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball
from safety.risk.surroundings.environment import Mesh
from safety.states import OperatingState
from sim_backends.plants.plant import variation
from tests import SOFT_ARM
from tests.daemon.service.grazing import StoppedClock
from tests.daemon.service.rig import Rig, on_a_rig

LOAD_G: Final = 14.2
CAUSE: Final = "body_not_as_modelled"
_HEIGHT_MM: Final = 185.0
_FAR_MM: Final = 150.0
_CONTROLLER: Final = {"kind": "constant_curvature"}
_DROPPED_S: Final = 1.0
"""After the weight was hung on: so long the arm sinks by itself."""
_GAPS_MM: Final = (0.0, 12.0)
"""From the skin of an arm that follows its circle exactly to a ball."""


@dataclass(frozen=True)
class Course:
    """What a seed stands for."""

    seed: int
    load_g: float
    hung_at_s: float | None
    """After the start; None: before arming."""
    radius_mm: float
    cycle_s: float
    balls_mm: NDArray[np.float64]
    """(n, 4) centres and radii."""
    body: int | None
    """Which arm of the same design; None: the very one that the model has learned from."""

    @classmethod
    def of(cls, seed: int, load_g: float = LOAD_G, body: int | None = None) -> "Course":
        random = np.random.default_rng([seed, 14])
        radius_mm = float(random.uniform(15.0, 40.0))
        cycle_s = radius_mm * 2.0 * np.pi / float(random.uniform(6.0, 18.0))
        hung_at_s = None if seed % 2 else float(random.uniform(1.0, 0.8 * cycle_s))
        balls = []
        for _ in range(int(random.integers(1, 4))):
            angle, size_mm = random.uniform(0.3, 2.0 * np.pi), random.uniform(8.0, 25.0)
            height_mm = random.uniform(130.0, 205.0)
            share = min(1.0, (height_mm / _HEIGHT_MM) ** 2)
            side = 1.0 if random.random() < 0.75 else -1.0
            away_mm = 13.5 + size_mm + random.uniform(*_GAPS_MM)
            out_mm = radius_mm * share + side * away_mm
            balls.append([out_mm * np.cos(angle), out_mm * np.sin(angle), height_mm, size_mm])
        upright = [b for b in balls if np.hypot(b[0], b[1]) - b[3] - 13.5 > 2.0]
        clear: list[list[float]] = []
        for one in upright:  # a mesh of bodies that overlap is refused
            if all(np.linalg.norm(np.subtract(one, b)[:3]) > one[3] + b[3] + 1.0 for b in clear):
                clear.append(one)
        return cls(seed, load_g, hung_at_s, radius_mm, cycle_s, np.array(clear or [_OUT]), body)


_OUT: Final = [_FAR_MM, 0.0, 100.0, 10.0]


@dataclass(frozen=True)
class Outcome:
    """What became of one seed."""

    state: OperatingState
    alarmed_at_s: float | None
    """After the load was there and the arm moving; None: never."""
    touched_at_s: float | None
    """After the start."""
    by_the_drop: bool
    """It touched while it sank, or did so where it then lay."""
    least_clearance_mm: float
    causes: frozenset[str]
    ran_s: float
    highest_statistic: float


class _Witness:
    """Looks at the body itself."""

    def __init__(self, balls_mm: NDArray[np.float64]) -> None:
        self._balls = balls_mm
        self.least_mm = np.inf
        self.touched_ns: int | None = None
        self.standing: list[tuple[int, float]] = []

    async def watch(self, rig: Rig) -> None:
        while True:
            state = rig.lab.body.record.state
            line = state.centreline_mm
            shares = np.linspace(0.0, 1.0, 5)[:, None, None]
            fine = (line[:-1] + shares * (line[1:] - line[:-1])).reshape(-1, 3)
            away = np.linalg.norm(fine[:, None] - self._balls[:, :3], axis=2) - self._balls[:, 3]
            clearance_mm = float(away.min()) - state.radius_mm
            self.least_mm = min(self.least_mm, clearance_mm)
            if clearance_mm <= 0.0 and self.touched_ns is None:
                self.touched_ns = rig.service.clock.now_ns()
            await asyncio.sleep(0.025)


def play(course: Course, folder: Path, given_tip: bool = True) -> Outcome:
    """Once round, or until the robot holds. given_tip: as the robot file has it."""
    file = _robot_file(folder, course, given_tip)
    robot = load_robot(file)
    witness = _Witness(course.balls_mm)
    found: dict[str, Any] = {}

    async def scene(rig: Rig) -> None:
        if course.hung_at_s is None:
            rig.lab.set_tip_load(course.load_g)
            await asyncio.sleep(2.0)
        now_ns = rig.service.clock.now_ns
        found.update(began_ns=now_ns(), hung_ns=now_ns())
        watching = asyncio.create_task(witness.watch(rig))
        try:
            await _go_round(rig, course, found)
        finally:
            watching.cancel()
        found.update(ended_ns=now_ns(), state=rig.state, causes=frozenset(rig.causes))

    def change(robot: Robot) -> Robot:
        emulation = robot.emulation
        assert emulation is not None
        assert isinstance(emulation.plant, SoftArmPlant)
        plant = emulation.plant if course.body is None else variation(emulation.plant, course.body)
        update = {"plant": plant, "seed": course.seed}
        return robot.model_copy(update={"emulation": emulation.model_copy(update=update)})

    risk = make_risk_source(robot, StoppedClock())
    rig = on_a_rig(scene, path=file, change=change, risk=risk, seed=course.seed)
    return _outcome(rig, course, witness, found)


async def _go_round(rig: Rig, course: Course, found: dict[str, Any]) -> None:
    await rig.do(Acquire)
    answer = await rig.ask(Arm(token=rig.token))
    if isinstance(answer, Refusal):
        return
    circle = {
        "kind": "circle",
        "center_mm": [0.0, 0.0, _HEIGHT_MM],
        "plane": "xy",
        "radius_mm": course.radius_mm,
        "cycle_s": course.cycle_s,
    }
    await rig.do(Load, trajectory=circle, controller=_CONTROLLER)
    answer = await rig.ask(Start(token=rig.token))
    if isinstance(answer, Refusal):
        return
    await rig.until_state(OperatingState.RUNNING)
    if course.hung_at_s is not None:
        await _moving(rig, course.hung_at_s)
        rig.lab.set_tip_load(course.load_g)
        found["hung_ns"] = rig.service.clock.now_ns()
    await _moving(rig, 300.0)
    await asyncio.sleep(2.0)


async def _moving(rig: Rig, for_s: float) -> None:
    ends_ns = rig.service.clock.now_ns() + round(for_s * 1e9)
    while rig.state is OperatingState.RUNNING and rig.service.clock.now_ns() < ends_ns:
        await asyncio.sleep(0.05)


def _outcome(rig: Rig, course: Course, witness: _Witness, found: dict[str, Any]) -> Outcome:
    causes = [m for m in rig.told if isinstance(m, Event) and m.kind == "cause" and m.present]
    alarms = [m.t_ns for m in causes if m.name == CAUSE]
    touched_ns, hung_ns = witness.touched_ns, found["hung_ns"]
    sank = course.hung_at_s is not None and touched_ns is not None
    drop = sank and 0 <= touched_ns - hung_ns <= _DROPPED_S * 1e9
    statistics = [m.tip_statistic or 0.0 for m in rig.told if isinstance(m, Risk)]
    return Outcome(
        found["state"],
        (alarms[0] - hung_ns) * 1e-9 if alarms else None,
        None if touched_ns is None else (touched_ns - found["began_ns"]) * 1e-9,
        bool(drop),
        witness.least_mm,
        found["causes"],
        (found["ended_ns"] - found["began_ns"]) * 1e-9,
        max(statistics, default=0.0),
    )


def _robot_file(folder: Path, course: Course, given_tip: bool) -> Path:
    meshes = [ball(b[3], b[:3].tolist(), 600) for b in course.balls_mm]
    vertices = np.concatenate([mesh.vertices_mm for mesh in meshes])
    starts = np.cumsum([0, *(len(mesh.vertices_mm) for mesh in meshes[:-1])])
    triangles = np.concatenate(
        [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]
    )
    write_mesh(folder / "balls.stl", Mesh(vertices, triangles))
    robot: dict[str, Any] = yaml.safe_load(SOFT_ARM.read_text())
    robot["risk"] = {
        "model": "builtin:soft_arm.npz",
        "surface": {"mesh": "balls.stl", "free": "outside"},
        "given_tip": given_tip,
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path
