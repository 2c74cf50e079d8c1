"""A controller with a fixed model: segments in series, each an arc of a circle.

The robot is not one. Gravity and loads bend it otherwise, and feedback has to make up for that.
"""

from math import cos, sin
from pathlib import Path
from typing import Protocol

import numpy as np

from config.robot import Robot
from config.tasks.controllers import (
    ArcBody,
    ConstantCurvature,
    GasChambers,
    TipFollowing,
    VolumetricChambers,
)
from daemon.control.axis_speeds import Foresight
from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.control.redundancy import bounded_step
from daemon.control.tip_following import TipFollower
from daemon.controllers.model_files import load_model, model_metadata, save_model
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

# What pistons do to the lengths of a segment's three chambers.


ATMOSPHERE_MPA = 0.101325
_NEWTON_STEPS = 12
_CONVERGED_MM = 1e-9


class ChamberModel(Protocol):
    """One segment's chambers."""

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        """(3,) chamber lengths in mm and (3, 3) their derivative by the pistons' positions."""
        ...


class Volumetric:
    """Length in proportion to volume."""

    def __init__(self, options: VolumetricChambers, length_mm: float, bore_mm2: Vector) -> None:
        self._length_mm = length_mm
        self._slope = options.elongation_mm_per_ml * bore_mm2 * 1e-3

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        return self._length_mm + self._slope * pistons_mm, np.diag(self._slope)


class EnclosedGas:
    """Isothermal gas in each chamber against a segment that resists extension and bending.

    A segment of stiffness EA and EI whose chambers (area A, at radius r) have gauge pressures p
    rests where K (ℓ − L) = A p, with K the stiffness seen along the three chambers.
    """

    def __init__(
        self, options: GasChambers, length_mm: float, radius_mm: float, bore_mm2: Vector
    ) -> None:
        self._length_mm = length_mm
        self._bore_mm2 = bore_mm2
        self._area_mm2 = options.chamber_area_mm2
        self._supply_mm3 = 1e3 * options.supply_volume_ml
        extension = options.axial_stiffness_n / (9.0 * length_mm)
        bending = options.bending_stiffness_n_mm2 * 4.0 / (9.0 * radius_mm**2 * length_mm)
        third = 2.0 * np.pi / 3.0 * np.arange(3)
        self._stiffness = extension + bending * np.cos(third[:, None] - third[None, :])
        pre_n = options.pre_pressure_mpa * self._area_mm2
        stretched = length_mm + np.linalg.solve(self._stiffness, np.full(3, pre_n))
        self._amount = (options.pre_pressure_mpa + ATMOSPHERE_MPA) * (
            self._supply_mm3 + self._area_mm2 * stretched
        )
        self._last = stretched

    def lengths(self, pistons_mm: Vector) -> tuple[Vector, Vector]:
        supply = self._supply_mm3 - self._bore_mm2 * pistons_mm
        lengths = self._last
        for _ in range(_NEWTON_STEPS):
            volume = supply + self._area_mm2 * lengths
            pressure = self._amount / volume
            push = self._area_mm2 * (pressure - ATMOSPHERE_MPA)
            yields = self._stiffness + np.diag(self._area_mm2**2 * pressure / volume)
            change = np.linalg.solve(yields, push - self._stiffness @ (lengths - self._length_mm))
            lengths = lengths + change
            if float(np.abs(change).max()) < _CONVERGED_MM:
                break
        by_piston = self._area_mm2 * pressure / volume * self._bore_mm2
        if np.isfinite(lengths).all():
            self._last = lengths
        return lengths, np.asarray(np.linalg.solve(yields, np.diag(by_piston)))


def chamber_model(options: ArcBody, segment: int, bore_mm2: Vector) -> ChamberModel:
    """The model of one segment's chambers. bore_mm2: (3,) areas of its pistons."""
    length_mm = options.segment_length_mm[segment]
    match options.chambers:
        case VolumetricChambers() as volumetric:
            return Volumetric(volumetric, length_mm, bore_mm2)
        case GasChambers() as gas:
            return EnclosedGas(gas, length_mm, options.chamber_radius_mm, bore_mm2)


# A segment bent to a circular arc, and what its tip does when its shape changes.
#
# A shape is (b_x, b_y, s): the bending as a vector in rad that points to where the segment leans,
# and its length in mm. In these coordinates the straight segment is nothing special.


_STRAIGHT_RAD = 1e-2
"""Below this the first terms of the series are exact to 1e-13."""


def arc(shape: Vector) -> tuple[Vector, Vector]:
    """(3,) end of the segment in mm and (3, 3) rotation of its end frame, from its base frame."""
    x, y, s = shape.tolist()
    c, f, g, _, _ = _terms(x * x + y * y)
    end = np.array([s * f * x, s * f * y, s * g])
    turn = np.array(
        [
            [1.0 - f * x * x, -f * x * y, g * x],
            [-f * x * y, 1.0 - f * y * y, g * y],
            [-g * x, -g * y, c],
        ]
    )
    return end, turn


def arc_end_by_shape(shape: Vector) -> Vector:
    """(3, 3) derivative of the end by b_x, b_y, s."""
    x, y, s = shape.tolist()
    _, f, g, df, dg = _terms(x * x + y * y)
    return np.array(
        [
            [s * (f + df * x * x), s * df * x * y, f * x],
            [s * df * x * y, s * (f + df * y * y), f * y],
            [s * dg * x, s * dg * y, g],
        ]
    )


def arc_carries_by_bending(shape: Vector, point: Vector) -> Vector:
    """(3, 2) derivative by b_x, b_y of `point`, (3,) fixed in the end frame, in the base frame."""
    x, y, _ = shape.tolist()
    u, v, w = point.tolist()
    _, f, g, df, dg = _terms(x * x + y * y)
    along = x * u + y * v
    return np.array(
        [
            [
                -f * (along + x * u) - df * x * x * along + (g + dg * x * x) * w,
                -f * x * v - df * x * y * along + dg * x * y * w,
            ],
            [
                -f * y * u - df * x * y * along + dg * x * y * w,
                -f * (along + y * v) - df * y * y * along + (g + dg * y * y) * w,
            ],
            [
                -g * u - dg * x * along - g * x * w,
                -g * v - dg * y * along - g * y * w,
            ],
        ]
    )


def _terms(squared: float) -> tuple[float, float, float, float, float]:
    """cos θ, f = (1 − cos θ)/θ², g = sin θ/θ, f'/θ and g'/θ for a bending of θ² = `squared`."""
    if squared < _STRAIGHT_RAD**2:
        return (
            1.0 - squared * (0.5 - squared / 24.0),
            0.5 - squared * (1.0 / 24.0 - squared / 720.0),
            1.0 - squared * (1.0 / 6.0 - squared / 120.0),
            -1.0 / 12.0 + squared * (1.0 / 180.0 - squared / 6720.0),
            -1.0 / 3.0 + squared * (1.0 / 30.0 - squared / 840.0),
        )
    angle = squared**0.5
    c, s = cos(angle), sin(angle)
    f, g = (1.0 - c) / squared, s / angle
    return c, f, g, (g - 2.0 * f) / squared, (c - g) / squared


# Arcs in series: from piston positions to the tip, its Jacobian, and the way back.


CHAMBERS = 3
"""Of a segment."""
_SEARCH_STEPS = 60
_SEARCH_DAMPING_MM = 5.0
_FOUND_MM = 0.01
_NO_PROGRESS_MM = 0.001
_LONGEST_SEARCH_STEP = 0.1
"""Of an axis' travel."""


class ArcKinematics:
    """The model, and a `KinematicModel` for reachability."""

    def __init__(self, options: ArcBody, axes: AxisRanges, bore_mm2: Vector) -> None:
        """bore_mm2: (m,) areas of the pistons, m three times the number of segments."""
        self._base = np.array(options.base_offset_mm)
        self._axes = axes
        self._length_mm = options.segment_length_mm
        self._chambers = [
            chamber_model(options, segment, bore_mm2[CHAMBERS * segment : CHAMBERS * (segment + 1)])
            for segment in range(len(options.segment_length_mm))
        ]
        self._shape_by_length = [
            _shape_by_length(options, first) for first in options.first_chamber_rad
        ]
        self._elongation_gain = options.elongation_gain
        self.tolerance_mm = options.tolerance_mm

    def tip(self, u: Vector) -> tuple[Vector, Vector]:
        """(3,) tip in mm and (3, m) its derivative at (m,) piston positions."""
        pistons = u.reshape(-1, CHAMBERS)
        shapes = [self._shape(segment, pistons[segment]) for segment in range(len(pistons))]
        tip = np.zeros(3)  # of all segments behind, in this one's end frame
        by_shape: list[Vector] = []
        for shape, _ in reversed(shapes):
            end, turn = arc(shape)
            here = arc_end_by_shape(shape)
            here[:, :2] += arc_carries_by_bending(shape, tip)
            by_shape = [here, *(turn @ behind for behind in by_shape)]
            tip = end + turn @ tip
        pairs = zip(by_shape, shapes, strict=True)
        jacobian = np.hstack([by_this @ this_by_u for by_this, (_, this_by_u) in pairs])
        return self._base + tip, jacobian

    def reach(self, position_mm: Vector, near_u: Vector | None) -> tuple[Vector, float]:
        """(m,) pistons within their travel that bring the tip nearest, and the miss in mm."""
        axes = self._axes
        middle = 0.5 * (axes.lowest + axes.highest)
        u = middle.copy() if near_u is None else np.clip(near_u, axes.lowest, axes.highest)
        best, best_mm = u, np.inf
        longest = np.full(axes.count, _LONGEST_SEARCH_STEP)
        for _ in range(_SEARCH_STEPS):
            tip, jacobian = self.tip(u)
            missing = position_mm - tip
            miss_mm = float(np.linalg.norm(missing))
            nearer_mm = best_mm - miss_mm
            if nearer_mm > 0.0:
                best, best_mm = u, miss_mm
            if miss_mm <= _FOUND_MM or nearer_mm < _NO_PROGRESS_MM:
                break
            step = axes.travel * bounded_step(
                jacobian * axes.travel,
                missing,
                np.zeros(axes.count),
                np.maximum((axes.lowest - u) / axes.travel, -longest),
                np.minimum((axes.highest - u) / axes.travel, longest),
                _SEARCH_DAMPING_MM,
            )
            u = u + step
        return best, best_mm

    def _shape(self, segment: int, pistons_mm: Vector) -> tuple[Vector, Vector]:
        lengths, by_piston = self._chambers[segment].lengths(pistons_mm)
        by_length = self._shape_by_length[segment]
        shape = by_length @ lengths
        shape[2] += (1.0 - self._elongation_gain) * self._length_mm[segment]
        return shape, by_length @ by_piston


def _shape_by_length(options: ArcBody, first_rad: float) -> Vector:
    """(3, 3) from chamber lengths to (b_x, b_y, s): a segment leans away from its long chambers.

    Without what elongation_gain adds to the length at rest.
    """
    angles = first_rad + 2.0 * np.pi / 3.0 * np.arange(CHAMBERS)
    lean = -2.0 / 3.0 / options.chamber_radius_mm * options.bending_gain
    return np.stack(
        [
            lean * np.cos(angles),
            lean * np.sin(angles),
            np.full(CHAMBERS, options.elongation_gain / CHAMBERS),
        ]
    )


class ArcController:
    """What controllers have in common whose Jacobian is that of arcs, and stays as it is."""

    name: str

    def __init__(self, options: ArcBody, law: TipFollowing, robot: Robot) -> None:
        """Raises ControllerError for a robot that is no such arm, and where a piston would push out
        more gas than there is."""
        bore_mm2 = _bore_mm2(self.name, options, robot)
        _check_cylinders(options, robot, bore_mm2)
        self._metadata = model_metadata(self.name, robot)
        self._follower = TipFollower(law, robot)
        self.kinematics = ArcKinematics(options, AxisRanges.of(robot), bore_mm2)

    @property
    def ready(self) -> bool:
        return self._follower.probed

    @property
    def foresight(self) -> Foresight:
        """What the model says of a path before it is gone."""
        arcs = self.kinematics
        return Foresight(
            lambda tip_mm: arcs.reach(tip_mm, None)[0],
            lambda _, u: arcs.tip(u)[1],
            self._follower.axis_velocity,
        )

    def draw_to(self, posture: Vector) -> None:
        """Draw the axes to (m,) a posture from now on. Raises ValueError for no numbers."""
        self._follower.set_posture(posture)

    def reset(self, observation: Observation) -> None:
        self._follower.reset(observation)

    def observe(self, observation: Observation) -> None:
        """The model is fixed."""

    def learn(self) -> None:
        """The model is fixed, and the body's lag is not."""
        self._follower.work_off()

    def save(self, path: Path) -> None:
        """Whose it is: there is nothing else to keep."""
        save_model(path, self._metadata, {})

    def load(self, path: Path) -> None:
        load_model(path, self._metadata, {})


class ConstantCurvatureController(ArcController):
    """A `Controller`."""

    name = "constant_curvature"

    def __init__(self, options: ConstantCurvature, robot: Robot) -> None:
        super().__init__(options, options, robot)

    def propose(self, observation: Observation) -> Proposal:
        _, jacobian = self.kinematics.tip(observation.targets)
        if not self.ready:
            return self._follower.probe(jacobian, observation)
        tip_step = self._follower.tip_step(observation)
        return self._follower.proposal(
            self._follower.axis_step(jacobian, tip_step, observation), observation
        )


def _check_cylinders(options: ArcBody, robot: Robot, bore_mm2: Vector) -> None:
    """Raises ControllerError where a piston would push out more gas than there is."""
    if not isinstance(options.chambers, GasChambers):
        return
    highest = AxisRanges.of(robot).highest
    pushed_ml = float((1e-3 * bore_mm2 * highest).max())
    if pushed_ml >= options.chambers.supply_volume_ml:
        raise ControllerError(
            f"chambers.supply_volume_ml is {options.chambers.supply_volume_ml:g}, and the pistons "
            f"push out {pushed_ml:.1f} mL at the end of their travel: give the gas in cylinder and "
            f"tube together"
        )


def _bore_mm2(kind: str, options: ArcBody, robot: Robot) -> Vector:
    """(m,) piston areas. Raises ControllerError for a robot that is not such an arm."""
    segments = len(options.segment_length_mm)
    if len(robot.axes) != CHAMBERS * segments:
        raise ControllerError(
            f"{kind} is for {CHAMBERS * segments} chambers ({segments} in "
            f"segment_length_mm), and {robot.robot} has {len(robot.axes)} axes"
        )
    areas = []
    for axis in robot.axes:
        area_mm2 = axis.piston_area_mm2
        if area_mm2 is None:
            raise ControllerError(
                f"{kind} is for cylinders, and {axis.name} is none: it has no bore_mm"
            )
        areas.append(area_mm2)
    return np.array(areas)


def make(options: ConstantCurvature, robot: Robot, seed: int) -> ConstantCurvatureController:
    """It does nothing at random. Raises ControllerError."""
    del seed
    return ConstantCurvatureController(options, robot)
