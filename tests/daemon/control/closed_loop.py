"""The arm's physics, a tracker with noise, the pose filter and a controller, frame by frame."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from config.control import PoseFilterSettings
from config.emulation.plants import SoftArmPlant
from config.loader import load_robot
from config.robot import Robot
from config.tasks.controllers import load_controller_options
from config.tasks.exploration import WaypointExploration
from config.tasks.trajectory import Circle, Lissajous, Rectangle, Star
from daemon.control.controller import Ahead, Controller, Observation, Phase, Proposal
from daemon.controllers.exploration.waypoint_exploration import WaypointExplorationController
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.make_controller import make_controller
from daemon.estimation.pose_filter import PoseFilter
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
from daemon.learning.samples.dataset import Dataset, Frames
from daemon.reference.reference import Blend, TrajectoryReference
from daemon.reference.trajectories import make_trajectory
from daemon.robot.axes import AxisRanges
from drivers.pose import Pose, Vector
from sim_backends.plants.plant import BodyState, TipLoad, variation
from sim_backends.plants.soft_arm.soft_arm import SoftArm

DT_S = 0.025
NOISE_MM = 0.2
BLEND_MM_S = 10.0
EXPLORE_FRAMES = 40_000
PISTON_MM2 = np.pi / 4.0 * 25.0**2
LEARN_CALLS = 2
"""In a frame: once after every bus cycle, or a little less."""

ROBOT: Robot = load_robot(Path(__file__).parents[3] / "config" / "robots" / "soft_arm.yaml").robot


def rectangle(cycle_s: float, z_mm: float = 185.0) -> Rectangle:
    """The one of Ho 2018, Table 1: 25 × 100 mm."""
    return Rectangle(
        kind="rectangle",
        center_mm=(0.0, 0.0, z_mm),
        width_mm=25.0,
        height_mm=100.0,
        cycle_s=cycle_s,
    )


def wide_rectangle(cycle_s: float) -> Rectangle:
    """The one of Ho 2018, Table 2: 40 × 60 mm."""
    return Rectangle(
        kind="rectangle",
        center_mm=(0.0, 0.0, 185.0),
        width_mm=40.0,
        height_mm=60.0,
        cycle_s=cycle_s,
    )


def soft_arm(body: int = 0) -> SoftArm:
    """body: 0 for the arm as it is written down, else the seed of another one."""
    assert ROBOT.emulation is not None
    plant = ROBOT.emulation.plant
    assert isinstance(plant, SoftArmPlant)
    return SoftArm(variation(plant, body) if body else plant, [PISTON_MM2] * 6)


@dataclass(frozen=True)
class Followed:
    """What became of a trajectory, frame by frame, mm."""

    errors_mm: Vector
    """From the filtered tip to the reference."""
    true_errors_mm: Vector
    """From the tip itself."""
    u: Vector
    """(n, 6)"""

    @property
    def mean_mm(self) -> float:
        return float(self.errors_mm.mean())

    @property
    def max_mm(self) -> float:
        return float(self.errors_mm.max())

    @property
    def true_mean_mm(self) -> float:
        return float(self.true_errors_mm.mean())


class ClosedLoop:
    """Targets reach the axes one frame late; the arm starts at rest with all axes at zero."""

    def __init__(
        self, controller: Controller, load_g: float = 0.0, seed: int = 1, body: int = 0
    ) -> None:
        """seed: of the tracker's noise. body: see `soft_arm`."""
        self.controller = controller
        self.arm = soft_arm(body)
        self.load_g = load_g
        self.axes = AxisRanges.of(ROBOT)
        self.filter = PoseFilter(PoseFilterSettings())
        self.noise = np.random.default_rng(seed)
        self.seen: Callable[[Vector], Vector | None] = lambda measured_mm: measured_mm
        """What the tracker makes of a measured tip: to be replaced by who wants it ill."""
        self.permitted: Callable[[Vector], Vector] = lambda step: step
        """What the gate makes of a step."""
        self.believed = True
        self.proposal = Proposal(np.zeros(6))
        """The last one."""
        self._filling: tuple[float, float] | None = None
        self.targets = np.zeros(6)
        self.t_ns = 0
        self.body: BodyState = self.arm.step(self.targets, TipLoad(mass_g=load_g), 60.0)
        while self.filter.estimate(self.t_ns) is None:
            self.measure()

    @property
    def tip_mm(self) -> Vector:
        """As the filter has it."""
        estimate = self.filter.estimate(self.t_ns)
        assert estimate is not None
        return estimate.position_mm

    def observation(
        self,
        reference_mm: Vector,
        velocity_mm_s: Vector,
        ahead: Ahead | None = None,
        phase: Phase | None = None,
    ) -> Observation:
        estimate = self.filter.estimate(self.t_ns)
        assert estimate is not None
        return Observation(
            self.t_ns,
            DT_S,
            self.u,
            self.targets,
            estimate.position_mm,
            estimate.velocity_mm_s,
            reference_mm,
            velocity_mm_s,
            self.believed,
            ahead,
            phase=phase,
            on_path=phase is not None,
        )

    def fill(self, to_g: float, g_s: float) -> None:
        """From now on the load grows, as if water were poured in."""
        self._filling = to_g, g_s

    def start(self) -> None:
        self.controller.reset(self.observation(self.tip_mm, np.zeros(3)))

    def step(
        self,
        reference_mm: Vector,
        velocity_mm_s: Vector,
        ahead: Ahead | None = None,
        phase: Phase | None = None,
        own_speed_mm_s: float | None = None,
    ) -> Vector:
        """One frame. Returns the step that was proposed."""
        self.measure()
        observation = self.observation(reference_mm, velocity_mm_s, ahead, phase)
        observation = observation._replace(own_speed_mm_s=own_speed_mm_s)
        self.controller.observe(observation)
        self.proposal = self.controller.propose(observation)
        step = self.proposal.delta_u
        for _ in range(LEARN_CALLS):
            self.controller.learn()
        assert np.isfinite(step).all()
        assert (np.abs(step) <= self.axes.max_velocity * DT_S * (1 + 1e-9)).all()
        self.targets = self.targets + self.permitted(step)
        assert (self.targets >= self.axes.lowest - 1e-9).all()
        assert (self.targets <= self.axes.highest + 1e-9).all()
        return step

    def explore(self) -> None:
        """Until the controller is ready, the reference where the tip is."""
        for _ in range(EXPLORE_FRAMES):
            if self.controller.ready:
                return
            self.step(self.tip_mm, np.zeros(3))
        raise AssertionError("the controller explores for ever")

    def lead(self, to_mm: Vector, wait_s: float = 1.0) -> None:
        """To a place, and stay there for a moment."""
        blend = Blend(self.tip_mm, to_mm, BLEND_MM_S)
        for k in range(round((blend.duration_s + wait_s) / DT_S)):
            self.step(*blend.at(k * DT_S), _from(blend.at, k * DT_S))

    def follow(self, options: Rectangle | Star | Lissajous | Circle) -> Followed:
        """The whole trajectory, from its start."""
        trajectory = make_trajectory(options, Path())
        errors, true_errors, u = [], [], []
        for k in range(round(trajectory.duration_s / DT_S)):
            reference, velocity = trajectory.at(k * DT_S)
            phase = Phase((k * DT_S) % trajectory.cycle_s, trajectory.cycle_s)
            self.step(reference, velocity, _from(trajectory.at, k * DT_S), phase)
            errors.append(float(np.linalg.norm(self.tip_mm - reference)))
            true_errors.append(float(np.linalg.norm(self.body.tip.position_mm - reference)))
            u.append(self.u)
        return Followed(np.array(errors), np.array(true_errors), np.array(u))

    def follow_at_its_pace(self, options: Rectangle | Star | Circle) -> list[Followed]:
        """Cycle by cycle, slowed where the controller asks for that."""
        reference = TrajectoryReference(make_trajectory(options, Path()), BLEND_MM_S)
        reference.begin(self.tip_mm)
        cycles: dict[int, list[tuple[float, float, Vector]]] = {}
        while not reference.finished:
            aim = reference.advance(self.t_ns, DT_S)
            seconds = aim.in_cycle_s
            phase = None if seconds is None else Phase(seconds, aim.cycle_s, aim.pace)
            own_speed = reference.own_speed_mm_s
            self.step(aim.position_mm, aim.velocity_mm_s, reference.ahead, phase, own_speed)
            reference.go_at(self.proposal.pace)
            off = [self.tip_mm - aim.position_mm, self.body.tip.position_mm - aim.position_mm]
            seen, true = (float(np.linalg.norm(one)) for one in off)
            cycles.setdefault(aim.cycle, []).append((seen, true, self.u))
        del cycles[-1]
        return [Followed(*map(np.array, zip(*cycle, strict=True))) for cycle in cycles.values()]

    def measure(self) -> None:
        """Time passes: the axes get to where they were told to be, the tracker sees the tip."""
        if self._filling is not None:
            to_g, g_s = self._filling
            self.load_g = min(self.load_g + g_s * DT_S, to_g)
        self.u = self.targets.copy()
        self.body = self.arm.step(self.u, TipLoad(mass_g=self.load_g), DT_S)
        self.t_ns += round(DT_S * 1e9)
        tip = self.body.tip
        seen = self.seen(tip.position_mm + NOISE_MM * self.noise.normal(size=3))
        pose = None if seen is None else Pose(seen, tip.quaternion)
        self.believed = self.filter.update(self.t_ns, pose)


def _from(at: Callable[[float], tuple[Vector, Vector]], t_s: float) -> Ahead:
    """As it is seen from that time."""
    return lambda lead_s: at(t_s + lead_s)


def started(
    controller: Controller,
    start_mm: Vector,
    load_g: float = 0.0,
    seed: int = 1,
    body: int = 0,
) -> ClosedLoop:
    """The controller is ready, and the tip where a trajectory starts."""
    loop = ClosedLoop(controller, load_g, seed, body)
    loop.start()
    loop.explore()
    loop.lead(start_mm)
    return loop


@cache
def explored(waypoints: int, seed: int = 1, body: int = 0) -> Dataset:
    """What going through random waypoints shows, with nothing at the tip."""
    options = WaypointExploration(kind="waypoint_exploration", waypoints=waypoints)
    controller = WaypointExplorationController(options, ROBOT, seed)
    loop = ClosedLoop(controller, seed=seed, body=body)
    loop.start()
    t_ns, tip_mm, u, notes = [], [], [], []
    while not controller.ready:
        loop.step(loop.tip_mm, np.zeros(3))
        t_ns.append(loop.t_ns)
        tip_mm.append(loop.tip_mm)
        u.append(loop.u)
        notes.append(controller.note)
    _, line = np.unique(notes, return_inverse=True)
    frames = Frames(np.array(t_ns), np.array(tip_mm), np.array(u), line)
    return Dataset.of(frames, ROBOT, {"seed": seed})


def made_learner(kind: str, **options: object) -> LearningController:
    asked = load_controller_options({"kind": kind, **options})
    controller = make_controller(asked, ROBOT, seed=1)
    assert isinstance(controller, LearningController)
    return controller


@cache
def pretrained(
    waypoints: int, seed: int = 1, body: int = 0, epochs: int = 15, fields: int | None = None
) -> PretrainedModel:
    """The model of an exploration. Nobody may learn on it: save it, and load it again."""
    dataset = explored(waypoints, seed, body)
    settings = PretrainingSettings(epochs=epochs, fields=fields, seed=seed)
    return PretrainedModel.of(pretrain(dataset, settings), dataset)
