"""The tendon-driven arm of Thompson et al.: motors in, shape out.

A Cosserat rod, disks, and tendons through them that are elastic, can go slack and rub at every
disk. So the shape at a place of the motors depends on where they came from (the paper's figure 3).
Friction of this kind asks only which way, not how fast: nothing takes time but what a drive train
may take before it answers. A step counts as one
even motion; tendons that would slip to and fro within it are not seen to.
"""

from typing import NamedTuple

import numpy as np

from config.emulation.plants import TendonArmPlant
from sim_backends.plants.plant import (
    GRAVITY_N_G,
    BodyState,
    FloatArray,
    PlantError,
    TipLoad,
    body_state,
    listed,
    tip_force,
)
from sim_backends.plants.shooting import ConstantPull, Drive, Equilibrium, Path, Problem, Solver
from sim_backends.plants.tendon_arm.statics_kernels import Strung
from sim_backends.plants.tendon_arm.tendons import Holes, TendonDrive, rod_of, strung
from sim_backends.plants.transmission import Transmission

_TOLERANCE = 1e-6
"""Of the solver: a tenth of a micrometre at the tip."""

_PATIENCE = 4
"""Of the solver: steps that come no nearer."""

INTERVALS_PER_SPAN = 2
"""Between two plates. Then the tip is right to 5 µm, wherever the arm can go."""


class _Memory(NamedTuple):
    """All that the arm remembers, replaced as a whole by a step that succeeded.

    ahead: how far the last step moved the equilibrium's unknowns. wound_mm: (m,) on the spools,
    behind the backlash. at_motor_n: (m,) tension that the motors hold.
    """

    equilibrium: Equilibrium
    ahead: FloatArray
    holes: Holes
    wound_mm: FloatArray
    at_motor_n: FloatArray
    load_n: FloatArray
    transmission: Transmission


class TendonArm:
    """A `Plant` of one actuator per tendon; mm that are wound up, positive pulls."""

    def __init__(
        self, config: TendonArmPlant, intervals_per_span: int = INTERVALS_PER_SPAN
    ) -> None:
        self._config = config
        self._rod = rod_of(config, intervals_per_span)
        self._solver = Solver(self._rod, _TOLERANCE, _PATIENCE)
        direction = np.array(config.gravity_direction)
        self._down = direction / np.linalg.norm(direction)
        self._weight_n = GRAVITY_N_G * config.mass_g * self._down
        self._strung, self._rested = self._string()
        self._memory = self._rested

    @property
    def actuator_count(self) -> int:
        return len(self._config.tendons)

    @property
    def tension_n(self) -> FloatArray:
        """(n+1, m) of each tendon, at its motor and in its spans, base first."""
        spans = self._memory.equilibrium.pull_n.reshape(self._config.disks, -1)
        return np.vstack([self._memory.at_motor_n, spans])

    def reset(self) -> None:
        """Forget the past: the arm is newly strung, and its motors have not moved yet."""
        self._memory = self._rested

    def step(self, actuators: FloatArray, load: TipLoad, dt_s: float) -> BodyState:
        """Turn the motors to `actuators` and let the arm follow.

        actuators: (m,) mm of tendon wound up. Raises PlantError for inputs that make no sense and
        where there is no equilibrium; the arm then keeps its last state.
        """
        motor_mm = self._motors(actuators)
        load_n = tip_force(load, self._down, self._config.axial_stiffness_n)
        if not 0.0 <= dt_s < np.inf:
            raise PlantError(f"a step takes 0 s or longer, not {dt_s} s")
        memory = self._memory
        transmission = memory.transmission.after(motor_mm, dt_s)
        wound_mm = transmission.arrived
        path = self._path(memory, wound_mm, load_n)
        found = self._solver.find(path, memory.equilibrium, memory.ahead)
        if found is None:
            raise PlantError(
                f"the arm has no equilibrium at actuators {listed(motor_mm)} mm with "
                f"{load.mass_g:g} g and {listed(load.force_n)} N at the tip"
            )
        holes, at_motor_n = self._drive(memory.holes, wound_mm).after(found.march, found.pull_n)
        ahead = found.unknowns - memory.equilibrium.unknowns
        self._memory = _Memory(found, ahead, holes, wound_mm, at_motor_n, load_n, transmission)
        return body_state(found.march, self._config.body_radius_mm, at_motor_n.copy())

    def _path(self, memory: _Memory, wound_mm: FloatArray, load_n: FloatArray) -> Path:
        """From motors and load as they were to these, in one even motion."""

        def problem(t: float) -> Problem:
            wound = memory.wound_mm + t * (wound_mm - memory.wound_mm)
            tip_n = memory.load_n + t * (load_n - memory.load_n)
            return self._problem(self._drive(memory.holes, wound), tip_n)

        return problem

    def _drive(self, holes: Holes, wound_mm: FloatArray) -> TendonDrive:
        return TendonDrive(self._rod, self._strung, holes, wound_mm)

    def _problem(self, drive: Drive, tip_n: FloatArray) -> Problem:
        force = self._rod.internal_force(tip_n, self._weight_n)
        return Problem(force, drive, self._rod.stiffness, self._rod.rest)

    def _motors(self, actuators: FloatArray) -> FloatArray:
        """(m,) mm. Raises PlantError for places where no motor can be."""
        motor_mm = np.array(actuators, dtype=np.float64)
        if motor_mm.shape != (self.actuator_count,):
            raise PlantError(
                f"the arm has {self.actuator_count} actuators, not {np.size(actuators)}"
            )
        end = self._config.length_mm
        possible = np.abs(motor_mm) < end
        if not possible.all():
            index = int(np.argmin(possible))
            raise PlantError(
                f"actuator {index} cannot be at {motor_mm[index]:g} mm: there is no more tendon "
                f"than the arm is long, {end:g} mm"
            )
        return motor_mm

    def _string(self) -> tuple[Strung, _Memory]:
        """Give every tendon its pretension, with the motors at zero and nothing at the tip."""
        still, free = np.zeros(self.actuator_count), np.zeros(3)
        pull_n = np.full(self._rod.routes, self._config.pretension_n)
        constant = self._problem(ConstantPull(self._rod, pull_n), free)
        found = self._solver.raise_load(constant, pull_n, free)
        if found is not None:
            tendons, holes = strung(self._config, self._rod, found.march)
            drive = TendonDrive(self._rod, tendons, holes, still)
            found = self._solver.settle(self._problem(drive, free), found)
        if found is None:
            raise PlantError("the arm cannot carry its own weight and the tendons' pretension")
        holes, at_motor_n = drive.after(found.march, found.pull_n)
        config = self._config
        return tendons, _Memory(
            equilibrium=found,
            ahead=np.zeros(found.unknowns.shape),
            holes=holes,
            wound_mm=still,
            at_motor_n=at_motor_n,
            load_n=free,
            transmission=Transmission.rested(config.dead_time_s, config.backlash_mm, still),
        )


# Tendon-driven arms that differ as one built arm differs from the next.


_STIFFNESS = 0.10
_MASS = 0.05
_FRICTION = 0.20
_PLAY = 0.25
_DRIVE = 0.15
_PRETENSION = 0.15
_RADIUS = 0.02
_ANGLE_RAD = 0.03


def variation(plant: TendonArmPlant, seed: int) -> TendonArmPlant:
    """Another arm of the same design; the same seed gives the same arm.

    Uniform within its bounds: stiffness ±10 % (one batch, so all alike), mass ±5 %, friction ±20 %,
    play ±25 %, stiffness of the drive trains ±15 %, pretension ±15 %, the tendons' distance from
    the axis ±2 %, and the place of each by itself ±0.03 rad.
    """
    generator = np.random.default_rng(seed)

    def about(value: float, share: float) -> float:
        return value * float(generator.uniform(1.0 - share, 1.0 + share))

    stiffer = about(1.0, _STIFFNESS)
    return plant.model_validate(
        {
            **plant.model_dump(),
            "bending_stiffness_n_mm2": plant.bending_stiffness_n_mm2 * stiffer,
            "torsion_stiffness_n_mm2": plant.torsion_stiffness_n_mm2 * stiffer,
            "shear_stiffness_n": plant.shear_stiffness_n * stiffer,
            "axial_stiffness_n": plant.axial_stiffness_n * stiffer,
            "mass_g": about(plant.mass_g, _MASS),
            "friction": min(1.0, about(plant.friction, _FRICTION)),
            "backlash_mm": about(plant.backlash_mm, _PLAY),
            "drive_stiffness_n_mm": about(plant.drive_stiffness_n_mm, _DRIVE),
            "pretension_n": about(plant.pretension_n, _PRETENSION),
            "tendon_radius_mm": about(plant.tendon_radius_mm, _RADIUS),
            "tendons": tuple(
                {
                    "angle_rad": tendon.angle_rad
                    + float(generator.uniform(-_ANGLE_RAD, _ANGLE_RAD)),
                    "turns": tendon.turns,
                }
                for tendon in plant.tendons
            ),
        }
    )
