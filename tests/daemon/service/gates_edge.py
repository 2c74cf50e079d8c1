"""The soft arm goes to where the gate just lets it, with a weight that nobody has declared.

Every seed is another configuration, and a ball beside the body there: so near that the model, which
knows of no weight, has the risk of the way just under the gate's threshold. In every other seed the
ball is where the weight bends the body farthest aside, which is the worst place; else anywhere
along it. The weight hangs there before arming, or is hung on on the way. Nothing closes a loop
round the tip: the axes go straight to their configuration, as fast as they may or slower.
"""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from numpy.random import Generator
from numpy.typing import NDArray

from config.emulation.plants import SoftArmPlant
from config.loader import load_robot
from config.robot import Robot
from daemon.control.controller import Observation, Proposal
from daemon.messages import Acquire, Arm, Event, Load, Refusal, Start
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import read_model
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.configurations import Candidates
from daemon.workbench.body_model.clouds.emulated_body import EmulatedBody
from daemon.workbench.body_model.evaluation.shapes import ball
from drivers.pose import Vector
from safety.risk.contact_figures import most_touching
from safety.risk.model.risk_model import RiskModel
from safety.risk_source import Clearance, RiskReading, RiskSource
from safety.states import OperatingState
from sim_backends.plants.plant import variation
from tests import SOFT_ARM
from tests.daemon.service.grazing import StoppedClock
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig
from tests.daemon.service.undeclared_load import CAUSE, LOAD_G

FloatArray = NDArray[np.float64]
THRESHOLD: Final = 0.05
_SHAPES: Final = 1000
_STEPS: Final = 16
"""Ways, one after the other, that the way there is asked for in."""
_FARTHER_MM: Final = 0.25
_MOST_FARTHER: Final = 12
_LEAST_TILT_MM: Final = 30.0
"""Upright, a weight bends nothing aside."""
_TRIES: Final = 60
_DROPPED_S: Final = 1.0
"""After the weight was hung on: so long the arm sinks by itself."""
_FINE: Final = 4
"""Pieces of each piece of a centreline, of which distances are taken."""
_WAIT_S: Final = 2.0
_SLOWEST: Final = 0.3


@dataclass(frozen=True)
class Edge:
    """What a seed stands for."""

    seed: int
    u: FloatArray
    ball_mm: FloatArray
    """(4,) centre and radius."""
    risk: float
    """Highest that the model has on the way there."""
    worst_place: bool
    hung_at: float | None
    """Share of the way; None: before arming."""
    speed: float
    """Share of what the axes may."""
    body: int | None
    """Which arm of the same design; None: the very one that the model has learned from."""

    @classmethod
    def of(cls, seed: int, folder: Path, body: int | None = None) -> "Edge":
        """folder: for the ball's file, and the robot's, which `play` takes."""
        random = np.random.default_rng([seed, 23])
        candidates, begun = Candidates(_robot(), 4000 + seed), 0
        for begun in range(_TRIES):
            u = candidates.actuation(candidates.parameters(begun, 1))[0]
            if not candidates.possible(u):
                continue
            free, loaded = (_line(u, load_g) for load_g in (0.0, LOAD_G))
            if np.hypot(*free[-1, :2]) < _LEAST_TILT_MM:
                continue
            worst = seed % 2 == 0
            node, away = _beside(free, loaded - free, worst, random)
            found = _at_the_edge(folder, u, free[node], away, random)
            if found is None:
                continue
            hung_at = None if seed // 2 % 2 else float(random.uniform(0.1, 0.5))
            speed = float(random.uniform(_SLOWEST, 1.0))
            return cls(seed, u, *found, worst, hung_at, speed, body)
        raise AssertionError(f"seed {seed}: no ball at the gate's edge in {_TRIES} tries")


@dataclass(frozen=True)
class AtEdge:
    """What became of one seed."""

    state: OperatingState
    arrived: bool
    alarmed_at_s: float | None
    """After the start, or the weight was hung on; None: never."""
    touched: bool
    by_the_drop: bool
    """It touched while it sank."""
    least_clearance_mm: float
    causes: frozenset[str]


class Straight:
    """A `Controller` that goes to a configuration, wherever that takes the tip."""

    name = "straight"
    ready = False  # no reference of the tip is followed

    def __init__(self, u: FloatArray, velocity: FloatArray) -> None:
        self._u, self._velocity = u, velocity
        self.arrived = False

    def reset(self, observation: Observation) -> None: ...

    def observe(self, observation: Observation) -> None: ...

    def propose(self, observation: Observation) -> Proposal:
        left: Vector = self._u - observation.targets
        self.arrived = bool(np.abs(left).max() < 1e-2)
        most = float((np.abs(left) / self._velocity).max())
        return Proposal(left * min(1.0, observation.dt_s / max(most, 1e-9)))

    def learn(self) -> None: ...

    def save(self, path: Path) -> None: ...

    def load(self, path: Path) -> None: ...


class Unseeing:
    """A `RiskSource` that is never told of the measured tip."""

    def __init__(self, source: RiskSource) -> None:
        self._source = source
        self.name = source.name

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        return self._source.assess(u_from, u_to, t_ns)

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        return self._source.clearance(u, risk)


def play(edge: Edge, folder: Path, seeing: bool, load_g: float = LOAD_G) -> AtEdge:
    """There, or until the robot holds. seeing: the measured tip is compared with the model's."""
    robot = load_robot(folder / "robot.yaml")
    source = make_risk_source(robot, StoppedClock())
    found: dict[str, Any] = {"least_mm": np.inf, "touched_ns": None, "arrived": False}

    async def scene(rig: Rig) -> None:
        if edge.hung_at is None:
            rig.lab.set_tip_load(load_g)
            await asyncio.sleep(_WAIT_S)
        found["hung_ns"] = rig.service.clock.now_ns()
        watching = asyncio.create_task(_watch(rig, edge.ball_mm, found))
        try:
            await _go(rig, edge, load_g, found)
        finally:
            watching.cancel()
        found.update(state=rig.state, causes=frozenset(rig.causes))

    def change(robot: Robot) -> Robot:
        emulation = robot.emulation
        assert emulation is not None
        assert isinstance(emulation.plant, SoftArmPlant)
        plant = emulation.plant if edge.body is None else variation(emulation.plant, edge.body)
        update = {"plant": plant, "seed": edge.seed}
        return robot.model_copy(update={"emulation": emulation.model_copy(update=update)})

    risk = source if seeing else Unseeing(source)
    rig = on_a_rig(scene, path=robot.path, change=change, risk=risk, seed=edge.seed)
    causes = [m for m in rig.told if isinstance(m, Event) and m.kind == "cause" and m.present]
    alarms = [(m.t_ns - found["hung_ns"]) * 1e-9 for m in causes if m.name == CAUSE]
    touched_ns, hung_ns = found["touched_ns"], found["hung_ns"]
    drop = edge.hung_at is not None and touched_ns is not None
    return AtEdge(
        found["state"],
        found["arrived"],
        alarms[0] if alarms else None,
        touched_ns is not None,
        drop and 0 <= touched_ns - hung_ns <= _DROPPED_S * 1e9,
        found["least_mm"],
        found["causes"],
    )


async def _go(rig: Rig, edge: Edge, load_g: float, found: dict[str, Any]) -> None:
    await rig.do(Acquire)
    if isinstance(await rig.ask(Arm(token=rig.token)), Refusal):
        return
    await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
    velocity = edge.speed * AxisRanges.of(_robot()).max_velocity
    straight = Straight(edge.u, velocity)
    if isinstance(await rig.ask(Start(token=rig.token)), Refusal):
        return
    rig.service.loop.controller = straight
    await rig.until_state(OperatingState.RUNNING)
    lasts_s = float((np.abs(edge.u) / velocity).max())
    if edge.hung_at is not None:
        await _moving(rig, straight, edge.hung_at * lasts_s)
        rig.lab.set_tip_load(load_g)
        found["hung_ns"] = rig.service.clock.now_ns()
    await _moving(rig, straight, 2.0 * lasts_s + 5.0)
    await asyncio.sleep(_WAIT_S)
    found["arrived"] = straight.arrived


async def _moving(rig: Rig, straight: Straight, for_s: float) -> None:
    ends_ns = rig.service.clock.now_ns() + round(for_s * 1e9)
    while rig.state is OperatingState.RUNNING and rig.service.clock.now_ns() < ends_ns:
        if straight.arrived:
            return
        await asyncio.sleep(0.05)


async def _watch(rig: Rig, ball_mm: FloatArray, found: dict[str, Any]) -> None:
    while True:
        state = rig.lab.body.record.state
        line = state.centreline_mm
        shares = np.linspace(0.0, 1.0, _FINE + 1)[:, None, None]
        fine = (line[:-1] + shares * np.diff(line, axis=0)).reshape(-1, 3)
        away = np.linalg.norm(fine - ball_mm[:3], axis=1).min()
        clearance_mm = float(away) - float(ball_mm[3]) - state.radius_mm
        found["least_mm"] = min(found["least_mm"], clearance_mm)
        if clearance_mm <= 0.0 and found["touched_ns"] is None:
            found["touched_ns"] = rig.service.clock.now_ns()
        await asyncio.sleep(0.025)


# Where the gate's edge is.


@cache
def _robot() -> Robot:
    return load_robot(SOFT_ARM).robot


@cache
def _model() -> RiskModel:
    return read_model(SOFT_ARM.parents[1] / "models" / "soft_arm.npz").model


def _line(u: FloatArray, load_g: float) -> FloatArray:
    """(n, 3) of the body there, come to from rest."""
    robot = _robot()
    assert robot.emulation is not None
    loaded = robot.emulation.model_copy(update={"tip_load_g": load_g})
    body = EmulatedBody(robot.model_copy(update={"emulation": loaded}))
    return body.go(u).centreline_mm.astype(np.float64)


def _beside(
    free: FloatArray, moved: FloatArray, worst: bool, random: Generator
) -> tuple[int, FloatArray]:
    """A node, and a direction from the body there."""
    along = np.gradient(free, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    across = moved - (moved * along).sum(axis=1, keepdims=True) * along
    if worst:
        node = int(np.linalg.norm(across, axis=1)[:-1].argmax())
        away = across[node]
    else:
        node = int(random.integers(int(0.4 * len(free)), len(free) - 1))
        away = np.cross(along[node], random.normal(size=3))
    return node, away / np.linalg.norm(away)


def _at_the_edge(
    folder: Path, u: FloatArray, place_mm: FloatArray, away: FloatArray, random: Generator
) -> tuple[FloatArray, float] | None:
    """A ball, and the highest risk on the way from rest to there; None: it is not to be had."""
    size_mm = float(random.uniform(8.0, 25.0))
    nearest_mm = _nearest_mm(u, place_mm, away, size_mm)
    for step in range(_MOST_FARTHER):
        centre = place_mm + (nearest_mm + step * _FARTHER_MM) * away
        one = np.array([*centre, size_mm])
        source = make_risk_source(load_robot(_robot_file(folder, one)), StoppedClock())
        risk = _highest(source, u)
        if risk <= THRESHOLD:
            return one, risk
        if risk > 0.5:  # it is in the way there
            return None
    return None


def _nearest_mm(u: FloatArray, place_mm: FloatArray, away: FloatArray, size_mm: float) -> float:
    """From the place to the ball's centre, where as many of the model's shapes touch as may."""
    basis, mixture = _model().basis, _model().shapes.mixture(u)
    assert mixture is not None
    drawn = mixture.sample(_SHAPES, np.random.default_rng(0))
    lines = basis.base_mm + np.tensordot(drawn, basis.modes.astype(np.float64), axes=1)
    shares = np.linspace(0.0, 1.0, _FINE, endpoint=False)[:, None]
    places = (lines[:, :-1, None] + shares * np.diff(lines, axis=1)[:, :, None]).reshape(
        _SHAPES, -1, 3
    )
    thick = np.repeat((basis.radius_mm + basis.left_out_mm)[:-1], _FINE)
    allowed = most_touching(THRESHOLD, _SHAPES)
    near, far = 0.0, 200.0
    while far - near > 0.02:
        middle = 0.5 * (near + far)
        gaps = np.linalg.norm(places - (place_mm + middle * away), axis=2) - thick - size_mm
        touching = int((gaps.min(axis=1) <= 0.0).sum())
        near, far = (middle, far) if touching > allowed else (near, middle)
    return far


def _highest(source: RiskSource, u: FloatArray) -> float:
    """Of the steps from rest to there."""
    highest = 0.0
    for step in range(_STEPS):
        ends = [(share / _STEPS * u).tolist() for share in (step, step + 1)]
        reading = source.assess(ends[0], ends[1], 0)
        assert reading is not None
        if reading.doubt:
            return 1.0
        highest = max(highest, reading.contact_risk)
    return highest


def _robot_file(folder: Path, ball_mm: FloatArray) -> Path:
    write_mesh(folder / "ball.stl", ball(float(ball_mm[3]), ball_mm[:3].tolist(), 600))
    robot: dict[str, Any] = yaml.safe_load(SOFT_ARM.read_text())
    robot["risk"] = {
        "threshold": THRESHOLD,
        "slide": False,
        "model": "builtin:soft_arm.npz",
        "surface": {"mesh": "ball.stl", "free": "outside"},
    }
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path
