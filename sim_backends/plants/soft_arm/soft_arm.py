"""A pneumatic arm as that of Ho et al. 2018, standing on its base: pistons in, shape out.

A Cosserat rod, segments in series whose chambers enclose gas, and a body that slips and creeps a
little. The tip is up, so weight compresses the arm and makes it softer: it answers to a load like
a column below its buckling load, which no constant-curvature model shows.
"""

from collections.abc import Sequence
from math import exp, expm1
from typing import NamedTuple

import numpy as np

from config.emulation.plants import SoftArmPlant
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
from sim_backends.plants.rod import Rod, Route, Section, helix
from sim_backends.plants.shooting import ConstantPull, Equilibrium, Path, Problem, Solver
from sim_backends.plants.soft_arm.chambers import Chambers, ChamberSolver
from sim_backends.plants.soft_arm.creep import Creep
from sim_backends.plants.soft_arm.gas import ATMOSPHERE_MPA, GasLines
from sim_backends.plants.soft_arm.hysteresis import StopOperators
from sim_backends.plants.transmission import Transmission

INTERVALS = 20
SLIDERS = 6
TOLERANCE = 4e-8
"""Of equilibria, as `shooting.Solver` has it: they are known to some nanometres."""

_HOUR_S = 3600.0
_DOWN = np.array([0.0, 0.0, -1.0])
"""It stands on its base."""


class _Memory(NamedTuple):
    """All that the arm remembers, replaced as a whole by a step that succeeded.

    ahead: how far the last step moved the equilibrium's unknowns. amount and in_chamber: (m,) gas
    of each line and of its chamber, MPa·mm³. age_s: since it was new.
    """

    equilibrium: Equilibrium
    ahead: FloatArray
    amount: FloatArray
    in_chamber: FloatArray
    sliders: StopOperators
    creep: Creep
    cylinder_mm3: FloatArray
    load_n: FloatArray
    transmission: Transmission
    age_s: float


class SoftArm:
    """A `Plant` of one actuator per chamber, segment by segment from the base on."""

    def __init__(self, config: SoftArmPlant, piston_area_mm2: Sequence[float]) -> None:
        if len(piston_area_mm2) != config.chambers:
            raise ValueError(f"the arm needs {config.chambers} pistons, not {piston_area_mm2}")
        self._config = config
        self._piston_mm2 = np.asarray(piston_area_mm2, dtype=np.float64)
        self._cylinder_mm3 = 1e3 * config.cylinder_volume_ml
        """With the piston at zero."""
        self._tube_mm3 = 1e3 * config.tube_volume_ml
        self._end_mm: list[float] = (self._cylinder_mm3 / self._piston_mm2).tolist()
        self._pneumatic_lag_s = config.pneumatic_lag_s
        self._area_mm2 = config.chamber_area_mm2 * np.asarray(config.chamber_area_ratios)
        self._rod = _rod(config)
        self._solver: Solver = ChamberSolver(self._rod, TOLERANCE)
        self._weight_n = GRAVITY_N_G * config.mass_g * _DOWN
        self._hanging = (TipLoad(), np.zeros(3))
        self._pulled_by = (np.zeros(3), np.zeros((0, 3)))
        """A force at the tip, and what it makes inside."""
        self._rested = self._rest()
        self._memory = self._rested

    @property
    def actuator_count(self) -> int:
        return len(self._piston_mm2)

    @property
    def chamber_pressure_mpa(self) -> FloatArray:
        """(m,) absolute pressure in the chambers."""
        return self._memory.in_chamber / (self._area_mm2 * self.chamber_length_mm)

    @property
    def chamber_length_mm(self) -> FloatArray:
        """(m,) length of the chambers along their middle."""
        return self._memory.equilibrium.march.length_mm.copy()

    def reset(self) -> None:
        """Forget the past: the arm has rested at zero actuation for long."""
        self._memory = self._rested

    def step(self, actuators: FloatArray, load: TipLoad, dt_s: float) -> BodyState:
        """Move the pistons to `actuators` within `dt_s` and let the arm follow.

        actuators: (m,) mm, positive pushes gas into the chamber. Raises PlantError for inputs that
        make no sense and where there is no equilibrium; the arm then keeps its last state.
        """
        shafts = self._shafts(actuators)
        load_n = self._tip_force(load)
        if not 0.0 <= dt_s < np.inf:
            raise PlantError(f"a step takes 0 s or longer, not {dt_s} s")
        memory = self._memory
        transmission = memory.transmission.after(shafts, dt_s)
        cylinder_mm3 = np.asarray(self._cylinder_mm3 - self._piston_mm2 * transmission.arrived)
        memory = memory._replace(amount=self._leaked(memory, dt_s))
        gas = self._gas(memory, cylinder_mm3, dt_s)
        found = self._solver.find(
            self._path(memory, gas, cylinder_mm3, load_n, dt_s), memory.equilibrium, memory.ahead
        )
        if found is None:
            raise PlantError(
                f"the arm has no equilibrium at actuators {listed(actuators)} mm with "
                f"{load.mass_g:g} g and {listed(load.force_n)} N at the tip"
            )
        lengths = found.march.length_mm
        in_chamber = gas.amount_in_chamber(lengths)
        self._memory = _Memory(
            equilibrium=found,
            ahead=found.unknowns - memory.equilibrium.unknowns,
            amount=memory.amount,
            in_chamber=in_chamber,
            sliders=memory.sliders.after(lengths),
            creep=memory.creep.after(dt_s, found.march.strain),
            cylinder_mm3=cylinder_mm3,
            load_n=load_n,
            transmission=transmission,
            age_s=memory.age_s + dt_s,
        )
        gauge_mpa = gas.cylinder_pressure(in_chamber) - ATMOSPHERE_MPA
        return body_state(found.march, self._config.body_radius_mm, gauge_mpa * self._piston_mm2)

    def _path(
        self,
        memory: _Memory,
        gas: GasLines,
        cylinder_mm3: FloatArray,
        load_n: FloatArray,
        dt_s: float,
    ) -> Path:
        """From pistons and load as they were to these, all within one step in time.

        gas: with the pistons at the end of it.
        """
        stiffness, rest = memory.creep.over(dt_s)
        if self._config.ageing > 0.0:
            stiffness = stiffness * self._left_of_stiffness(memory.age_s + dt_s)

        def problem(t: float) -> Problem:
            if t == 1.0:  # nearly always the only one
                return self._problem(gas, memory.sliders, load_n, stiffness, rest)
            pistons = memory.cylinder_mm3 + t * (cylinder_mm3 - memory.cylinder_mm3)
            between = self._gas(memory, pistons, dt_s)
            tip_n = memory.load_n + t * (load_n - memory.load_n)
            return self._problem(between, memory.sliders, tip_n, stiffness, rest)

        return problem

    def _problem(
        self,
        gas: GasLines,
        sliders: StopOperators,
        tip_n: FloatArray,
        stiffness: FloatArray,
        rest: FloatArray,
    ) -> Problem:
        if tip_n is not self._pulled_by[0]:  # the same hangs there for most steps
            self._pulled_by = (tip_n, self._rod.internal_force(tip_n, self._weight_n))
        drive = Chambers(self._rod.presence, gas, sliders)
        return Problem(self._pulled_by[1], drive, stiffness, rest)

    def _gas(self, memory: _Memory, cylinder_mm3: FloatArray, dt_s: float) -> GasLines:
        kept = exp(-dt_s / self._pneumatic_lag_s)
        supply_mm3 = cylinder_mm3 + self._tube_mm3
        return GasLines(memory.amount, memory.in_chamber, supply_mm3, self._area_mm2, kept)

    def _tip_force(self, load: TipLoad) -> FloatArray:
        """(3,) N. The same load hangs on the tip for most steps. Raises PlantError."""
        if load is not self._hanging[0]:
            self._hanging = (load, tip_force(load, _DOWN, self._config.axial_stiffness_n))
        return self._hanging[1]

    def _leaked(self, memory: _Memory, dt_s: float) -> FloatArray:
        """(m,) gas in each line after `dt_s` of leaking. Its excess over what the atmosphere would
        fill the line with goes down in proportion to itself."""
        rate_per_s = self._config.leak_per_hour / _HOUR_S
        if not rate_per_s > 0.0:
            return memory.amount
        lengths = memory.equilibrium.march.length_mm
        whole_mm3 = memory.cylinder_mm3 + self._tube_mm3 + self._area_mm2 * lengths
        excess = memory.amount - ATMOSPHERE_MPA * whole_mm3
        return np.asarray(memory.amount + expm1(-rate_per_s * dt_s) * excess)

    def _left_of_stiffness(self, age_s: float) -> float:
        config = self._config
        return 1.0 + config.ageing * expm1(-age_s / (_HOUR_S * config.ageing_time_h))

    def _shafts(self, actuators: FloatArray) -> FloatArray:
        """(m,) mm. Raises PlantError for places where no piston can be."""
        positions = np.asarray(actuators, dtype=np.float64)
        if positions.shape != self._piston_mm2.shape:
            raise PlantError(
                f"the arm has {self.actuator_count} actuators, not {np.size(actuators)}"
            )
        for index, (place, end) in enumerate(zip(positions.tolist(), self._end_mm, strict=True)):
            if not -end < place < end:
                raise PlantError(
                    f"actuator {index} cannot be at {place:g} mm: its piston meets the ends of the "
                    f"cylinder at {-end:.1f} and {end:.1f} mm"
                )
        return positions.copy()

    def _rest(self) -> _Memory:
        """The arm as it stands when left alone for long, newly filled with its gas."""
        config, rod = self._config, self._rod
        still = np.zeros(self.actuator_count)
        force = rod.internal_force(np.zeros(3), self._weight_n)
        drive = ConstantPull(rod, -config.pre_pressure_mpa * self._area_mm2)
        problem = Problem(force, drive, rod.stiffness, rod.rest)
        found = self._solver.raise_load(problem, still, np.zeros(3))
        if found is None:
            raise PlantError("the arm cannot carry its own weight")
        lengths = found.march.length_mm
        pressure = config.pre_pressure_mpa + ATMOSPHERE_MPA
        cylinder_mm3 = np.full(self.actuator_count, self._cylinder_mm3)
        supply_mm3 = cylinder_mm3 + self._tube_mm3
        creep = Creep.rested(
            rod.stiffness, rod.rest, found.march.strain, config.creep, config.creep_time_s
        )
        return _Memory(
            equilibrium=found,
            ahead=np.zeros_like(found.unknowns),
            amount=pressure * (supply_mm3 + self._area_mm2 * lengths),
            in_chamber=pressure * self._area_mm2 * lengths,
            sliders=_sliders(config, lengths),
            creep=creep,
            cylinder_mm3=cylinder_mm3,
            load_n=np.zeros(3),
            transmission=Transmission.rested(config.dead_time_s, config.backlash_mm, still),
            age_s=0.0,
        )


def _rod(config: SoftArmPlant) -> Rod:
    """The arm's body. Silicone keeps its volume: shear modulus E/3, so GA = EA/3, GJ = 2/3 EI."""
    section = Section(
        bending_n_mm2=config.bending_stiffness_n_mm2,
        torsion_n_mm2=config.bending_stiffness_n_mm2 * 2.0 / 3.0,
        shear_n=config.axial_stiffness_n / 3.0,
        axial_n=config.axial_stiffness_n,
    )
    chambers, start = list[Route](), 0.0
    for segment in config.segments:
        end, apart = start + segment.length_mm, 2.0 * np.pi / segment.chambers
        turns = [segment.rotation_rad + apart * index for index in range(segment.chambers)]
        radius = config.chamber_radius_mm
        chambers += [helix(radius, turn, start, end, chamber=True) for turn in turns]
        start = end
    return Rod(config.length_mm, section, chambers, INTERVALS)


def _sliders(config: SoftArmPlant, length_mm: FloatArray) -> StopOperators:
    """Sliders at rest. n springs k, evenly round, resist a segment's bending like n/2 k r²."""
    stiffness = list[float]()
    for segment in config.segments:
        bending = config.bending_stiffness_n_mm2 / segment.length_mm
        springs = 0.5 * segment.chambers * config.chamber_radius_mm**2
        stiffness += [config.hysteresis * bending / springs] * segment.chambers
    return StopOperators(
        np.repeat(np.array(stiffness)[:, None] / SLIDERS, SLIDERS, axis=1),
        config.hysteresis_reach_mm * np.arange(1, SLIDERS + 1) / SLIDERS,
        np.repeat(length_mm[:, None], SLIDERS, axis=1),
    )
