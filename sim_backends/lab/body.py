"""The body between drives and tracker: shafts move it, it pushes back, the tracker sees it."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, Protocol

import numpy as np

from config.axis import Axis
from drivers.axis_scale import axis_scale
from drivers.pose import Pose
from sim_backends.plants.plant import (
    BodyState,
    FloatArray,
    ForeignPlantError,
    Plant,
    PlantError,
    TipLoad,
)

_SHORTEST_STEP_NS = 1_000_000
_TOLD_FOR_NS = 500_000_000
"""Whoever looks ten times a second sees a failure of a single step."""
_AT_THE_BASE = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


class Shaft(Protocol):
    """What a drive turns, whatever the drive is."""

    @property
    def position_counts(self) -> float:
        """Where it is, in encoder counts from the lab's own zero."""
        ...

    def set_load(self, torque_nmm: float) -> None:
        """What it has to hold; positive pushes towards lower counts."""
        ...

    def drag_to(self, counts: float) -> bool:
        """Turn it by hand. False: a motor holds it."""
        ...


class BodyRecord(NamedTuple):
    """The truth at one moment, which no driver can see."""

    t_ns: int
    actuators: FloatArray
    """(m,) mm or rad."""
    state: BodyState
    plant_failures: int
    """Steps for which the plant found no equilibrium; the body then stayed as it was."""
    last_failure: str


class Body:
    """The plant, coupled to the shafts of its axes."""

    def __init__(
        self,
        plant: Plant,
        axes: Sequence[Axis],
        shafts: Sequence[Shaft],
        load: TipLoad,
        tell: Callable[[str], None] = lambda _: None,
    ) -> None:
        """tell: hears why the plant begins to fail. Raises PlantError if that is at once."""
        self.load = load
        """What hangs on the tip; may change at any time."""
        self.play: Callable[[float], FloatArray] | None = None
        """Scripted actuation: (m,) mm or rad at a time in s since it began."""
        self._plant = plant
        self._tell, self._failing = tell, False
        self._shafts = shafts
        self._scales = [axis_scale(axis) for axis in axes]
        self._torque_per_force = [
            axis.drive.rated_torque_nmm / 1000.0 / scale.force_per_permille
            for axis, scale in zip(axes, self._scales, strict=True)
        ]
        self._play_began_ns = 0
        self._failures, self._last_failure = 0, ""
        self._foreign, self._foreign_ns = "", 0
        self._t_ns = 0
        self._actuators = self._read_shafts()
        self._state = plant.step(self._actuators, load, 0.0)

    def begin_play(self, play: Callable[[float], FloatArray] | None, t_ns: int) -> None:
        """Turn the shafts that no motor holds as `play` says, or leave them alone again (None)."""
        self.play, self._play_began_ns = play, t_ns

    def advance(self, t_ns: int) -> None:
        """Let the body follow its shafts up to `t_ns`."""
        dt_ns = t_ns - self._t_ns
        if dt_ns < _SHORTEST_STEP_NS:
            return
        self._t_ns = t_ns
        if self.play is not None:
            self._turn_by_hand(self.play((t_ns - self._play_began_ns) * 1e-9))
        self._actuators = self._read_shafts()
        try:
            self._state = self._plant.step(self._actuators, self.load, dt_ns * 1e-9)
        except PlantError as error:
            self._failures += 1
            self._last_failure = str(error)
            if isinstance(error, ForeignPlantError):
                self._foreign, self._foreign_ns = str(error), t_ns
            if not self._failing:
                self._tell(f"the body stays as it is: {error}")
            self._failing = True
        else:
            self._failing = False
        for shaft, force, ratio in zip(
            self._shafts, self._state.actuator_forces, self._torque_per_force, strict=True
        ):
            shaft.set_load(float(force) * ratio)

    @property
    def failing(self) -> str:
        """What a package's plant has just done that none may do; empty: nothing. That ours finds no
        equilibrium belongs to bodies."""
        recent = self._foreign and self._t_ns - self._foreign_ns < _TOLD_FOR_NS
        return self._foreign if recent else ""

    @property
    def advanced_ns(self) -> int:
        """Up to when the body has followed its shafts."""
        return self._t_ns

    def poses(self, t_ns: int) -> Mapping[str, Pose]:
        """Where tip and base are at `t_ns`, in the robot's base frame."""
        self.advance(t_ns)
        return {"tip": self._state.tip, "base": _AT_THE_BASE}

    @property
    def record(self) -> BodyRecord:
        """The truth as of the last `advance`."""
        return BodyRecord(
            self._t_ns, self._actuators, self._state, self._failures, self._last_failure
        )

    def _read_shafts(self) -> FloatArray:
        return np.array(
            [
                scale.position(shaft.position_counts)
                for scale, shaft in zip(self._scales, self._shafts, strict=True)
            ]
        )

    def _turn_by_hand(self, positions: FloatArray) -> None:
        for scale, shaft, position in zip(self._scales, self._shafts, positions, strict=True):
            shaft.drag_to(float(position) * scale.counts_per_unit)
