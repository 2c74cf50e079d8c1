"""The arm's physics, a tracker with noise, the pose filter and a controller, frame by frame."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from config.control import PoseFilterSettings
from config.loader import load_robot
from config.robot import Robot
from config.trajectory import Rectangle
from daemon.control.axis_ranges import AxisRanges
from daemon.control.blend import Blend
from daemon.control.controller import Controller, Observation
from daemon.control.trajectories import make_trajectory
from daemon.estimation.pose_filter import PoseFilter
from drivers.pose import Pose, Vector
from sim_backends.plants.plant import BodyState, TipLoad
from sim_backends.plants.soft_arm import SoftArm

DT_S = 0.025
NOISE_MM = 0.2
BLEND_MM_S = 10.0
EXPLORE_FRAMES = 2000
BORE_MM = 25.0

ROBOT: Robot = load_robot(Path(__file__).parents[3] / "config" / "robots" / "soft_arm.yaml").robot


def rectangle(cycle_s: float, z_mm: float = 185.0) -> Rectangle:
    """The one of Ho 2018: 25 × 100 mm."""
    return Rectangle(
        kind="rectangle",
        center_mm=(0.0, 0.0, z_mm),
        width_mm=25.0,
        height_mm=100.0,
        cycle_s=cycle_s,
    )


def soft_arm() -> SoftArm:
    assert ROBOT.emulation is not None
    return SoftArm(ROBOT.emulation.plant, [BORE_MM] * 6)


@dataclass(frozen=True)
class Followed:
    """Distance between the filtered tip and the reference in each frame, mm."""

    errors_mm: Vector

    @property
    def mean_mm(self) -> float:
        return float(self.errors_mm.mean())

    @property
    def max_mm(self) -> float:
        return float(self.errors_mm.max())


class ClosedLoop:
    """Targets reach the axes one frame late; the arm starts at rest with all axes at zero."""

    def __init__(self, controller: Controller, load_g: float = 0.0, seed: int = 1) -> None:
        self.controller = controller
        self.arm = soft_arm()
        self.load = TipLoad(mass_g=load_g)
        self.axes = AxisRanges.of(ROBOT)
        self.filter = PoseFilter(PoseFilterSettings())
        self.noise = np.random.default_rng(seed)
        self.targets = np.zeros(6)
        self.t_ns = 0
        self.body: BodyState = self.arm.step(self.targets, self.load, 60.0)
        while self.filter.estimate(self.t_ns) is None:
            self._measure()

    @property
    def tip_mm(self) -> Vector:
        estimate = self.filter.estimate(self.t_ns)
        assert estimate is not None
        return estimate.position_mm

    def observation(self, reference_mm: Vector, velocity_mm_s: Vector) -> Observation:
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
        )

    def start(self) -> None:
        self.controller.reset(self.observation(self.tip_mm, np.zeros(3)))

    def step(self, reference_mm: Vector, velocity_mm_s: Vector) -> Vector:
        """One frame. Returns the step that was proposed."""
        self._measure()
        observation = self.observation(reference_mm, velocity_mm_s)
        self.controller.observe(observation)
        step = self.controller.propose(observation).delta_u
        assert np.isfinite(step).all()
        assert (np.abs(step) <= self.axes.max_velocity * DT_S * (1 + 1e-9)).all()
        self.targets = self.targets + step
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
            self.step(*blend.at(k * DT_S))

    def follow(self, options: Rectangle) -> Followed:
        """The whole trajectory, from its start."""
        trajectory = make_trajectory(options, Path())
        errors = []
        for k in range(round(trajectory.duration_s / DT_S)):
            reference, velocity = trajectory.at(k * DT_S)
            self.step(reference, velocity)
            errors.append(float(np.linalg.norm(self.tip_mm - reference)))
        return Followed(np.array(errors))

    def _measure(self) -> None:
        """Time passes: the axes get to where they were told to be, the tracker sees the tip."""
        self.u = self.targets.copy()
        self.body = self.arm.step(self.u, self.load, DT_S)
        self.t_ns += round(DT_S * 1e9)
        tip = self.body.tip
        seen = tip.position_mm + NOISE_MM * self.noise.normal(size=3)
        self.filter.update(self.t_ns, Pose(seen, tip.quaternion))
