"""A body goes round a circle, and a ball stands a little in its way.

Every seed is another body and another place: how it is built differs from the body that the model
has learned from, or is one of the many that it has; the tracker's noise is its own, and so is the
direction from which the ball is met.
"""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from config.control import RiskSettings
from config.emulation.lab import Emulation
from config.emulation.plants import TendonArmPlant
from config.loader import load_robot
from config.robot import Robot
from daemon.loop.step_messages import SLIDING
from daemon.messages import Load, Risk, Start
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball
from safety.gate import RISK
from safety.risk_source import NoModel
from safety.states import OperatingState
from sim_backends.lab.bodies import another_body
from tests import SOFT_ARM
from tests.daemon.service.rig import Rig, on_a_rig

TENDON_ARM = SOFT_ARM.with_name("tendon_arm.yaml")
TUBES = SOFT_ARM.with_name("concentric_tubes.yaml")
BROYDEN = {
    "kind": "broyden",
    "explore_together": False,
    "explore_share": 0.03,
    "damping_mm": 200.0,
    "posture_gain_per_s": 1.0,
}
RADIUS_MM = 25.0
CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 197.5],
    "plane": "xy",
    "radius_mm": RADIUS_MM,
    "cycle_s": 20.0,
}
BALL_MM = 15.0
BALL_HEIGHT_MM = 190.0
INTO_THE_WAY_MM = 4.0
"""How far the ball reaches into where the arm would be if it were as long everywhere."""
TUBES_CIRCLE = {
    "kind": "circle",
    "center_mm": [36.0, 0.0, 179.0],
    "plane": "xy",
    "radius_mm": 15.0,
    "cycle_s": 20.0,
}
_TUBES_BALL_MM, _TUBES_INTO_MM = 8.0, 1.5
_BUILT = {
    "bending_stiffness_n_mm2": 0.05,
    "tendon_stiffness_n": 0.1,
    "drive_stiffness_n_mm": 0.2,
    "friction": 0.3,
    "backlash_mm": 0.5,
}
"""How far each is from what it should be, at most, as a share of it."""


@dataclass(frozen=True)
class Subject:
    """A robot, what it does, and how its bodies and the places of the ball differ."""

    file: Path
    model: str
    controller: dict[str, Any]
    circle: dict[str, Any]
    ball_mm: float
    ball_at: Callable[[float], NDArray[np.float64]]
    """Its centre, (3,), by the direction in rad."""
    built: Callable[[Emulation, np.random.Generator], Emulation]


class StoppedClock:
    """In virtual time no answer takes any."""

    def now_ns(self) -> int:
        return 0

    def wall_time_ns(self) -> int:
        return 0


@dataclass(frozen=True)
class Grazed:
    """What became of one seed."""

    state: OperatingState
    causes: set[str]
    least_clearance_mm: float
    """Of the plant's own shape, which nothing in the daemon can see."""
    highest_risk: float | None
    steps: int
    shortened: int
    slid: int
    mean_error_mm: float
    """Not a number where it was never armed."""


class Witness:
    """Looks at the body itself while the scene plays."""

    def __init__(self, ball_mm: NDArray[np.float64], radius_mm: float) -> None:
        self._ball_mm, self._radius_mm = ball_mm, radius_mm
        self.least_clearance_mm = np.inf

    async def watch(self, rig: Rig) -> None:
        while True:
            state = rig.lab.body.record.state
            line = state.centreline_mm
            shares = np.linspace(0.0, 1.0, 5)[:, None, None]
            fine = (line[:-1] + shares * (line[1:] - line[:-1])).reshape(-1, 3)
            away_mm = float(np.linalg.norm(fine - self._ball_mm, axis=1).min())
            clearance_mm = away_mm - self._radius_mm - state.radius_mm
            self.least_clearance_mm = min(self.least_clearance_mm, clearance_mm)
            await asyncio.sleep(0.025)


async def once_round(
    rig: Rig,
    circle: dict[str, Any],
    watch: Coroutine[Any, Any, None],
    controller: dict[str, Any] = BROYDEN,
) -> None:
    """Until the circle is done, or the robot holds; watched from its first motion on."""
    watching = asyncio.create_task(watch)
    try:
        await rig.armed()
        await rig.do(Load, trajectory=circle, controller=controller)
        await rig.do(Start)
        await rig.until_state(OperatingState.RUNNING)
        await rig.until(lambda: rig.state is not OperatingState.RUNNING, within_s=200.0)
    finally:
        watching.cancel()


def graze(
    seed: int, folder: Path, aware: bool, slide: bool = True, subject: Subject | None = None
) -> Grazed:
    """Once round. aware: the gate knows of the ball. slide: steps are turned aside.

    subject: None: the tendon arm.
    """
    subject = subject or TENDONS
    random = np.random.default_rng(seed)
    angle = random.uniform(0.0, 2.0 * np.pi)
    file = _robot_file(folder, subject, angle, slide)
    robot = load_robot(file)
    assert robot.robot.emulation is not None
    emulation = subject.built(robot.robot.emulation, random)
    risk = make_risk_source(robot, StoppedClock()) if aware else NoModel()
    witness = Witness(subject.ball_at(angle), subject.ball_mm)
    ended: dict[str, Any] = {}

    async def scene(rig: Rig) -> None:
        try:
            await once_round(rig, subject.circle, witness.watch(rig), subject.controller)
        except AssertionError as error:  # where it may touch as it stands, it is not armed
            if "name='contact'" not in str(error):
                raise
        ended.update(state=rig.state, causes=rig.causes)

    def change(robot: Robot) -> Robot:
        update: dict[str, Any] = {"emulation": emulation.model_copy(update={"seed": seed})}
        return robot.model_copy(update=update if aware else {**update, "risk": RiskSettings()})

    rig = on_a_rig(scene, path=file, change=change, risk=risk, seed=seed)
    risks = [message for message in rig.told if isinstance(message, Risk)]
    errors = [tip.error_mm for tip in rig.tips if tip.error_mm is not None]
    return Grazed(
        ended["state"],
        ended["causes"],
        witness.least_clearance_mm,
        max((r.contact_risk for r in risks if r.contact_risk is not None), default=None),
        len(risks),
        sum(RISK in r.reasons for r in risks),
        sum(SLIDING in r.reasons for r in risks),
        float(np.mean(errors)) if errors else float("nan"),
    )


def _ball_at(angle_rad: float) -> NDArray[np.float64]:
    """(3,) its centre."""
    away_mm = RADIUS_MM + TendonArmPlant(kind="tendon_arm").body_radius_mm + BALL_MM
    away_mm -= INTO_THE_WAY_MM
    x, y = away_mm * np.cos(angle_rad), away_mm * np.sin(angle_rad)
    return np.array([x, y, BALL_HEIGHT_MM])


def _robot_file(folder: Path, subject: Subject, angle_rad: float, slide: bool) -> Path:
    there = subject.ball_at(angle_rad).tolist()
    write_mesh(folder / "ball.stl", ball(subject.ball_mm, there, 2000))
    robot: dict[str, Any] = yaml.safe_load(subject.file.read_text())
    robot["risk"] = {
        **robot.get("risk", {}),
        "model": subject.model,
        "surface": {"mesh": "ball.stl", "free": "outside"},
        "slide": slide,
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path


def _as_built(emulation: Emulation, random: np.random.Generator) -> Emulation:
    plant = emulation.plant
    off = {
        name: getattr(plant, name) * (1.0 + share * random.uniform(-1.0, 1.0))
        for name, share in _BUILT.items()
    }
    return emulation.model_copy(update={"plant": plant.model_copy(update=off)})


TENDONS = Subject(
    TENDON_ARM, "builtin:tendon_arm.npz", BROYDEN, CIRCLE, BALL_MM, _ball_at, _as_built
)


def _beside_the_tip(angle_rad: float) -> NDArray[np.float64]:
    """(3,) outside of the tubes' circle, at its height."""
    away_mm = TUBES_CIRCLE["radius_mm"] + 1.4 + _TUBES_BALL_MM - _TUBES_INTO_MM  # type: ignore[operator]
    centre = np.array(TUBES_CIRCLE["center_mm"], np.float64)
    return centre + away_mm * np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])


def _other_tubes(emulation: Emulation, random: np.random.Generator) -> Emulation:
    """As one made set differs from the next, and none that the model has learned from."""
    return another_body(emulation, 2_000_000 + int(random.integers(1_000_000)))


PAST_TUBES = Subject(
    TUBES,
    "builtin:concentric_tubes.npz",
    {"kind": "broyden"},
    TUBES_CIRCLE,
    _TUBES_BALL_MM,
    _beside_the_tip,
    _other_tubes,
)
