"""From what a robot file says of a body to the body, at rest."""

import numpy as np

from config.documents.kinds import PLANTS, KindError, described, entry_of, maker, variation
from config.emulation.lab import Emulation
from config.emulation.plants import ConcentricTubesPlant, SoftArmPlant, TendonArmPlant
from config.robot import Robot
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.plant import (
    BodyState,
    FloatArray,
    ForeignPlantError,
    Plant,
    PlantError,
    TipLoad,
)
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm


class LabError(ValueError):
    """The lab cannot be built; the text says why."""


def plant_of(emulation: Emulation, robot: Robot) -> Plant:
    """The body of this robot, at rest. Raises LabError where its axes cannot move it."""
    options = emulation.plant
    try:
        entry, make = entry_of(PLANTS, options), maker(PLANTS, options)
    except KindError as error:
        raise LabError(str(error)) from None
    if entry.shipped:
        ours: Plant = make(options, robot)
        return ours
    try:
        return GuardedPlant(str(entry), make(options, robot), len(robot.axes))
    except (Exception, SystemExit) as error:  # whatever a package does
        raise LabError(f"{entry} cannot be made: {described(error)}") from error


def another_body(emulation: Emulation, seed: int) -> Emulation:
    """The same lab with another body of the same design in it, as one made body differs from the
    next; the same seed gives the same body. Raises LabError where a package has no others."""
    options = emulation.plant
    try:
        make = variation(PLANTS, options)
        if make is None:
            raise LabError(f"{entry_of(PLANTS, options)} has no other bodies of its design")
        other = make(options, seed)
        if type(other) is not type(options):
            raise LabError(f"{entry_of(PLANTS, options)}: another body is {other!r:.60}")
    except KindError as error:
        raise LabError(str(error)) from None
    return emulation.model_copy(update={"plant": other})


# What makes those that are shipped: (options, robot) → a plant.


def soft_arm(options: SoftArmPlant, robot: Robot) -> Plant:
    """Raises LabError."""
    pistons_mm2 = [axis.piston_area_mm2 for axis in robot.axes]
    if None in pistons_mm2:
        raise LabError("a soft arm needs linear_stepper axes with a bore_mm: they push its gas")
    try:
        return SoftArm(options, [area for area in pistons_mm2 if area is not None])
    except (ValueError, PlantError) as error:
        raise LabError(f"this soft arm cannot be at rest: {error}") from None


def tendon_arm(options: TendonArmPlant, robot: Robot) -> Plant:
    """Raises LabError."""
    pulling = [axis.tension_range_n is not None for axis in robot.axes]
    if not all(pulling) or len(pulling) != len(options.tendons):
        raise LabError(
            f"a tendon arm needs a tendon_motor axis for each of its {len(options.tendons)} tendons"
        )
    try:
        return TendonArm(options)
    except (ValueError, PlantError) as error:
        raise LabError(f"this tendon arm cannot be at rest: {error}") from None


def concentric_tubes(options: ConcentricTubesPlant, robot: Robot) -> Plant:
    """Raises LabError."""
    units = ["rad"] * len(options.tubes) + ["mm"] * options.carriages
    if [axis.unit for axis in robot.axes] != units:
        raise LabError(
            f"concentric tubes need a tube_rotation axis for each of the {len(options.tubes)} "
            f"tubes, then a tube_translation axis for each of the {options.carriages} carriages"
        )
    try:
        return ConcentricTubes(options)
    except (ValueError, PlantError) as error:
        raise LabError(f"these tubes cannot be at rest: {error}") from None


class GuardedPlant:
    """A `Plant` round one of a package: what that does wrong is told with its name."""

    def __init__(self, whose: str, plant: Plant, axes: int) -> None:
        """whose: as errors call it. axes: m. Raises ValueError for another number of actuators."""
        self._whose, self._plant = whose, plant
        if plant.actuator_count != axes:
            raise ValueError(f"it has {plant.actuator_count} actuators, and the robot {axes} axes")
        self.actuator_count = axes

    def reset(self) -> None:
        """As `Plant` says."""
        try:
            self._plant.reset()
        except (Exception, SystemExit) as error:  # whatever a package does
            raise ForeignPlantError(f"{self._whose} failed: {described(error)}") from error

    def step(self, actuators: FloatArray, load: TipLoad, dt_s: float) -> BodyState:
        """As `Plant` says."""
        try:
            state = self._plant.step(actuators.copy(), load, dt_s)
            self._check(state)
        except (Exception, SystemExit) as error:  # as above
            raise ForeignPlantError(f"{self._whose} failed: {described(error)}") from error
        return state

    def _check(self, state: BodyState) -> None:
        if not isinstance(state, BodyState):
            raise TypeError(f"it gave no BodyState, but {state!r:.60}")
        line = np.asarray(state.centreline_mm)
        if line.ndim != 2 or line.shape[1] != 3 or len(line) < 2:
            raise ValueError(f"its centreline has the shape {line.shape}")
        forces = np.asarray(state.actuator_forces)
        if forces.shape != (self.actuator_count,):
            raise ValueError(f"its actuator_forces have the shape {forces.shape}")
        tip = (np.asarray(state.tip.position_mm), np.asarray(state.tip.quaternion))
        if [one.shape for one in tip] != [(3,), (4,)]:
            raise ValueError(f"its tip has the shapes {tip[0].shape} and {tip[1].shape}")
        for what, values in (("centreline", line), ("tip", np.concatenate(tip)), ("force", forces)):
            if not np.isfinite(values).all():
                raise ValueError(f"its {what} is not a number")
        if not 0.0 < state.radius_mm < np.inf:
            raise ValueError(f"its radius is {state.radius_mm} mm")
