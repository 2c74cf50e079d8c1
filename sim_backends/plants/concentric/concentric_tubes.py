"""A robot of concentric tubes: rotations and carriages in, shape out.

Where tubes come from decides where they are: they stay on their branch of equilibria until it ends,
then they snap, and they rub on each other. Nothing takes time; a snap is over within a step.
"""

from typing import NamedTuple

import numpy as np

from config.emulation.plants import ConcentricTubesPlant, Tube
from drivers.pose import Pose, product
from sim_backends.plants.concentric.statics import (
    INTERVAL_MM,
    Setting,
    TubeEquilibrium,
    TubeStatics,
)
from sim_backends.plants.concentric.statics_kernels import TubeSet
from sim_backends.plants.plant import (
    GRAVITY_N_G,
    BodyState,
    FloatArray,
    PlantError,
    TipLoad,
    listed,
    tip_force,
)

TOWARDS_X_RAD = np.pi / 2.0
"""From a tube that bends towards x to one whose moment is about x, as the statics have it."""
_FINEST_RAD = 0.12
"""Most that a tube bends within an interval of the integration."""
_STRONGEST_N = 20.0
"""No load beyond this: thin tubes would be drawn out as straight as wires."""
_FURTHEST_RAD, _FURTHEST_MM = 200.0, 5000.0


class _Memory(NamedTuple):
    """All that the tubes remember, replaced as a whole by a step that succeeded.

    slider_rad: (n, S) of the places that rub. snaps: since the tubes were put together.
    """

    equilibrium: TubeEquilibrium
    slider_rad: FloatArray
    snaps: int


class ConcentricTubes:
    """A `Plant`. Its actuators are rotations of the tubes, rad, then carriages, mm.

    At zero a tube bends towards x. The base frame stands where the mouth is with all at zero.
    """

    def __init__(self, config: ConcentricTubesPlant) -> None:
        self._config = config
        self._carriage = np.array([tube.carriage for tube in config.tubes])
        self._collar_mm = np.array([tube.collar_mm for tube in config.tubes])
        self._end_mm = np.array([length_mm(tube) for tube in config.tubes])
        self._towards_x_rad = TOWARDS_X_RAD + turned_rad(config)
        self._moves = config.mouth == "first_collar"
        direction = np.array(config.gravity_direction)
        self._down = direction / np.linalg.norm(direction)
        self._bound_rad = config.presliding_rad if config.friction_nmm > 0.0 else 0.0
        self._statics = statics_of(config)
        self._rested = self._at_rest()
        self._memory = self._rested

    @property
    def actuator_count(self) -> int:
        return len(self._config.tubes) + self._config.carriages

    def reset(self) -> None:
        """Forget the past: the tubes are newly put together, with their axes at zero."""
        self._memory = self._rested

    def step(self, actuators: FloatArray, load: TipLoad, dt_s: float) -> BodyState:
        """Turn and push the tubes to `actuators` and let them follow.

        actuators: (m,) rad, then mm. Raises PlantError for inputs that make no sense, collars that
        would have to pass each other, and where there is no equilibrium; nothing has moved then.
        """
        setting, forward_mm = self._setting(actuators, load)
        if not 0.0 <= dt_s < np.inf:
            raise PlantError(f"a step takes 0 s or longer, not {dt_s} s")
        memory = self._memory
        start = memory.equilibrium
        slider_rad = self._faded(memory, setting)
        still = _same(setting, start.setting)
        followed = (start, 0) if still else self._statics.follow(start, setting, slider_rad)
        if followed is None:
            raise PlantError(
                f"the tubes have no equilibrium at actuators {listed(actuators)} (rad, mm) with "
                f"{load.mass_g:g} g and {listed(load.force_n)} N at the tip"
            )
        found, snaps = followed
        self._memory = self._remembered(found, slider_rad, memory.snaps + snaps)
        return self._state(self._memory, forward_mm)

    def _faded(self, memory: _Memory, setting: Setting) -> FloatArray:
        """Sliders after a push: what rubs along the tubes cannot hold them against turning."""
        rubbing = memory.equilibrium.rubbing_rad
        pushed_mm = np.abs(_between(setting.collar_mm - memory.equilibrium.setting.collar_mm))
        kept = np.exp(-pushed_mm / self._config.friction_fades_mm)[:, None]
        return np.asarray(rubbing + kept * (memory.slider_rad - rubbing))

    def _remembered(self, found: TubeEquilibrium, slider_rad: FloatArray, snaps: int) -> _Memory:
        rubbing, bound = found.rubbing_rad, self._bound_rad
        return _Memory(found, np.clip(slider_rad, rubbing - bound, rubbing + bound), snaps)

    def _state(self, memory: _Memory, forward_mm: float) -> BodyState:
        found = memory.equilibrium
        march, tip = found.march, found.layout.tip_node
        centreline_mm = march.position_mm + np.array([0.0, 0.0, forward_mm])
        half = 0.5 * (march.angle_rad[tip, -1] - TOWARDS_X_RAD)
        spin = (float(np.cos(half)), 0.0, 0.0, float(np.sin(half)))
        turn = np.array(product(march.quaternion[tip].tolist(), spin))
        return BodyState(
            centreline_mm,
            Pose(centreline_mm[tip].copy(), turn),
            self._forces(found),
            self._config.tubes[0].outer_radius_mm,
            found.determinant,
            memory.snaps,
        )

    def _forces(self, found: TubeEquilibrium) -> FloatArray:
        """(m,) N·mm of the rotations, then N of the carriages."""
        tubes, count = self._statics.tubes, len(self._config.tubes)
        pushes = self._statics.pushes(found)
        forces = np.zeros(self.actuator_count)
        forces[:count] = -tubes.torsion_n_mm2 * found.base[:count]
        np.add.at(forces, count + self._carriage, pushes)
        if self._moves:  # the carriage of the mouth leaves the other tubes behind, and bears all
            forces[count] -= pushes.sum() + found.layout.force_n[0, 0, 2]
        return forces

    def _setting(self, actuators: FloatArray, load: TipLoad) -> tuple[Setting, float]:
        """Where tubes are held, and how far forward the mouth is. Raises PlantError."""
        values = np.array(actuators, dtype=np.float64)
        count = len(self._config.tubes)
        if values.shape != (self.actuator_count,):
            raise PlantError(
                f"the tubes have {self.actuator_count} actuators, not {np.size(actuators)}"
            )
        for index, place in enumerate(values.tolist()):
            if not abs(place) <= (_FURTHEST_RAD if index < count else _FURTHEST_MM):
                raise PlantError(
                    f"actuator {index} cannot be at {place:g} {'rad' if index < count else 'mm'}"
                )
        forward_mm = float(values[count]) if self._moves else 0.0
        collar_mm = self._collar_mm + values[count + self._carriage] - forward_mm
        if not (np.diff(collar_mm) < 0.0).all():
            raise PlantError(
                f"collars at {listed(collar_mm)} mm from the mouth would have to pass each other"
            )
        if not (collar_mm[0] <= 1e-9 and (collar_mm + self._end_mm).max() > 1.0):
            raise PlantError(
                f"with collars at {listed(collar_mm)} mm no tube comes out of the mouth, or the "
                "first collar would have to come out of it"
            )
        force_n = tip_force(load, self._down, _STRONGEST_N)
        rotation_rad = values[:count] + self._towards_x_rad
        return Setting(rotation_rad, np.minimum(collar_mm, 0.0), force_n), forward_mm

    def _at_rest(self) -> _Memory:
        setting, _ = self._setting(np.zeros(self.actuator_count), TipLoad())
        slider_rad = self._statics.no_sliders()
        found = self._statics.at_rest(setting, slider_rad)
        if found is None:
            raise PlantError("the tubes find no shape with their axes at zero")
        return self._remembered(found, slider_rad, 0)


def statics_of(config: ConcentricTubesPlant, *, ideal: bool = False) -> TubeStatics:
    """The statics of these tubes; `ideal` ones weigh nothing and do not rub on each other."""
    direction = np.array(config.gravity_direction)
    sharpest = max(abs(s.curvature_per_mm) for tube in config.tubes for s in tube.sections)
    tubes = tube_set(config.tubes)
    if ideal:
        tubes = tubes._replace(weight_n_mm=np.zeros(len(config.tubes)))
    return TubeStatics(
        tubes,
        direction / np.linalg.norm(direction),
        twisting=config.twisting_transmissions,
        friction_nmm=0.0 if ideal else config.friction_nmm,
        presliding_rad=config.presliding_rad,
        interval_mm=min(INTERVAL_MM, _FINEST_RAD / max(sharpest, 1e-6)),
    )


def tube_set(tubes: tuple[Tube, ...]) -> TubeSet:
    """The tubes as arrays."""
    most = max(len(tube.sections) for tube in tubes)
    end_mm, curvature = np.zeros((len(tubes), most)), np.zeros((len(tubes), most))
    for i, tube in enumerate(tubes):
        lengths = [section.length_mm for section in tube.sections]
        end_mm[i] = np.cumsum(lengths + [0.0] * (most - len(lengths)))
        curvature[i, : len(lengths)] = [section.curvature_per_mm for section in tube.sections]
    return TubeSet(
        end_mm,
        curvature,
        np.array([tube.bending_stiffness_n_mm2 for tube in tubes]),
        np.array([tube.torsion_stiffness_n_mm2 for tube in tubes]),
        np.array([1e-3 * GRAVITY_N_G * tube.mass_mg_mm for tube in tubes]),
    )


def turned_rad(config: ConcentricTubesPlant) -> FloatArray:
    """(n,) what homing has left of each tube's angle."""
    return np.array([tube.turned_rad for tube in config.tubes])


def length_mm(tube: Tube) -> float:
    """From its collar to its end."""
    return sum(section.length_mm for section in tube.sections)


def _between(pushed_mm: FloatArray) -> FloatArray:
    """(n,) how far each tube is pushed against one beside it, the first one against the second."""
    if len(pushed_mm) == 1:
        return np.zeros(1)
    steps = np.diff(pushed_mm)
    behind, ahead = np.append(steps, steps[-1]), np.append(steps[0], steps)
    return np.asarray(np.maximum(np.abs(behind), np.abs(ahead)))


def _same(one: Setting, other: Setting) -> bool:
    return all(bool((a == b).all()) for a, b in zip(one, other, strict=True))


# Sets of tubes that differ as one made set differs from the next.


_CURVATURE = 0.06
_STIFFNESS = 0.05


def variation(plant: ConcentricTubesPlant, seed: int) -> ConcentricTubesPlant:
    """Another set of the same design; the same seed gives the same set.

    Of every tube by itself, uniform: its curvature ±6 %, its stiffness, bending and torsional
    alike, ±5 %. Sets that were measured lie within these.
    """
    generator = np.random.default_rng(seed)

    def another(tube: Tube) -> Tube:
        bent = 1.0 + float(generator.uniform(-_CURVATURE, _CURVATURE))
        stiffer = 1.0 + float(generator.uniform(-_STIFFNESS, _STIFFNESS))
        sections = tuple(
            section.model_copy(update={"curvature_per_mm": bent * section.curvature_per_mm})
            for section in tube.sections
        )
        return tube.model_copy(
            update={
                "sections": sections,
                "bending_stiffness_n_mm2": stiffer * tube.bending_stiffness_n_mm2,
                "torsion_stiffness_n_mm2": stiffer * tube.torsion_stiffness_n_mm2,
            }
        )

    return plant.model_copy(update={"tubes": tuple(another(tube) for tube in plant.tubes)})
