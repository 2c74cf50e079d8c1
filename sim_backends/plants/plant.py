"""What every plant is to the lab."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from config.emulation.plants import SoftArmPlant
from drivers.pose import Pose
from sim_backends.plants.rod_kernels import March

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class TipLoad:
    """What hangs on the tip. A dead load: its direction stays when the tip turns.

    mass_g: weight in g, pulled by gravity. force_n: (3,) any further force, base frame.
    """

    mass_g: float = 0.0
    force_n: tuple[float, float, float] = (0.0, 0.0, 0.0)


class BodyState(NamedTuple):
    """The body at rest under its actuators and its load, in the robot's base frame.

    centreline_mm: (n, 3) from base to tip. tip: placement of the tip's frame.
    actuator_forces: (m,) N that each actuator must hold (N·mm for a rotation), positive where
    the body pushes the actuator back towards lower positions. radius_mm: nothing of the body is
    further from its centreline. stability: 0 where the shape is about to give way to another one
    that is far from it; bodies that never do that have 1. snaps: how often this has happened.
    """

    centreline_mm: FloatArray
    tip: Pose
    actuator_forces: FloatArray
    radius_mm: float
    stability: float = 1.0
    snaps: int = 0


class PlantError(RuntimeError):
    """The body has no equilibrium that the plant can find. Says at which actuation and load."""


class ForeignPlantError(PlantError):
    """A plant of a package has done what none may do. Says whose it is."""


class Plant(Protocol):
    """A body that actuators shape. It has memory: hysteresis, creep and lag need `dt_s`."""

    @property
    def actuator_count(self) -> int:
        """Number of actuators m."""
        ...

    def reset(self) -> None:
        """Forget the past: a body that has rested at zero actuation for long."""
        ...

    def step(self, actuators: FloatArray, load: TipLoad, dt_s: float) -> BodyState:
        """Move the actuators to `actuators` within `dt_s` and let the body follow.

        actuators: (m,) mm of each actuator (rad for a rotation). The load may change at any step.
        Time passes in steps only: the same steps after a reset give the same states to the last
        bit. Raises PlantError, also for inputs that are not finite; the plant then keeps its last
        state.
        """
        ...


# A rod in balance as the lab sees it.


def body_state(march: March, radius_mm: float, actuator_forces: FloatArray) -> BodyState:
    """Copies of what the march says. actuator_forces: (m,) N."""
    tip = Pose(march.position_mm[-1].copy(), march.quaternion[-1].copy())
    return BodyState(march.position_mm.copy(), tip, actuator_forces, radius_mm)


# What hangs on a tip, as a force; and numbers as error messages show them.


GRAVITY_N_G = 9.80665e-3
"""Weight in N of one gram."""


def tip_force(load: TipLoad, down: FloatArray, most_n: float) -> FloatArray:
    """(3,) N of a load, with gravity along the unit vector `down`.

    most_n: what the body's axial stiffness bears. Raises PlantError for more, and for a load that
    makes no sense.
    """
    force = np.array(load.force_n, dtype=np.float64)
    if not 0.0 <= load.mass_g < np.inf or force.shape != (3,) or not np.isfinite(force).all():
        raise PlantError(f"there is no load of {load.mass_g} g and {load.force_n} N")
    weight_n = GRAVITY_N_G * load.mass_g
    if max(weight_n, float(np.abs(force).max())) > most_n:
        raise PlantError(
            f"{load.mass_g:g} g and {listed(load.force_n)} N at the tip are more than the arm can "
            f"bear ({most_n:g} N)"
        )
    return np.asarray(force + weight_n * down)


def listed(values: Sequence[float] | FloatArray) -> str:
    """As `[1, 2.5]`."""
    return "[" + ", ".join(f"{value:g}" for value in np.asarray(values)) + "]"


# Plants that differ as one built arm differs from the next.


_STIFFNESS = 0.10
_CHAMBER = 0.04
_MASS = 0.03
_HYSTERESIS = 0.15
_TIME = 0.15
_PRE_PRESSURE = 0.05
_ROTATION_RAD = 0.05


def variation(plant: SoftArmPlant, seed: int) -> SoftArmPlant:
    """Another arm of the same design; the same seed gives the same arm.

    Every figure is even-handedly better or worse, uniform within its bounds: stiffness ±10 % (one
    batch of silicone, so bending and axial alike), each chamber's area ±4 % by itself, mass ±3 %,
    pre-pressure ±5 %, hysteresis, creep, play and times ±15 %, each joint's angle ±0.05 rad.
    """
    generator = np.random.default_rng(seed)

    def about(value: float, share: float) -> float:
        return value * float(generator.uniform(1.0 - share, 1.0 + share))

    stiffer = about(1.0, _STIFFNESS)
    return plant.model_validate(
        {
            **plant.model_dump(),
            "bending_stiffness_n_mm2": plant.bending_stiffness_n_mm2 * stiffer,
            "axial_stiffness_n": plant.axial_stiffness_n * stiffer,
            "chamber_area_ratios": tuple(about(r, _CHAMBER) for r in plant.chamber_area_ratios),
            "mass_g": about(plant.mass_g, _MASS),
            "pre_pressure_mpa": about(plant.pre_pressure_mpa, _PRE_PRESSURE),
            "hysteresis": min(0.5, about(plant.hysteresis, _HYSTERESIS)),
            "creep": min(0.3, about(plant.creep, _HYSTERESIS)),
            "creep_time_s": about(plant.creep_time_s, _TIME),
            "pneumatic_lag_s": min(1.0, about(plant.pneumatic_lag_s, _TIME)),
            "segments": tuple(
                segment.model_copy(update={"rotation_rad": segment.rotation_rad + off})
                for segment, off in zip(
                    plant.segments,
                    [
                        0.0,
                        *generator.uniform(-_ROTATION_RAD, _ROTATION_RAD, len(plant.segments) - 1),
                    ],
                    strict=True,
                )
            ),
            "dead_time_s": min(0.5, about(plant.dead_time_s, _TIME)),
            "backlash_mm": about(plant.backlash_mm, _TIME),
        }
    )
