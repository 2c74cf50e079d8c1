"""What every plant is to the lab."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.pose import Pose

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
    further from its centreline.
    """

    centreline_mm: FloatArray
    tip: Pose
    actuator_forces: FloatArray
    radius_mm: float


class PlantError(RuntimeError):
    """The body has no equilibrium that the plant can find. Says at which actuation and load."""


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
