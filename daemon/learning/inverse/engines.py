"""The engines of the local controllers by name."""

from typing import Literal

import numpy as np

from daemon.learning.inverse.bank import BankControllers
from daemon.learning.inverse.exact import BatchControllers, OracleControllers
from daemon.learning.inverse.local_controller_settings import LocalControllerSettings
from daemon.learning.inverse.local_controllers import LocalControllers
from daemon.learning.inverse.prior import Prior
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.receptive_fields import ReceptiveFields
from drivers.pose import Vector

EngineName = Literal["oracle", "batch", "bank"]

_ENGINES: dict[
    EngineName, type[OracleControllers] | type[BatchControllers] | type[BankControllers]
] = {"oracle": OracleControllers, "batch": BatchControllers, "bank": BankControllers}


def warm_up() -> None:
    """Compile all kernels, or load them from numba's cache: seconds once, then tenths of one."""
    fields = ReceptiveFields(np.zeros((1, 4)), np.eye(4)[None], np.ones(4))
    settings = LocalControllerSettings(1.0, np.ones(1))
    sample = MotionSample(np.zeros(3), np.zeros(1), np.ones(1), np.ones(3))
    for engine in _ENGINES:
        controllers = make_local_controllers(engine, fields, settings, 1, np.zeros(1))
        controllers.add(sample)
        if not controllers.command(sample.delta_tip_mm, sample.tip_mm, sample.u).support > 0.0:
            raise RuntimeError("the local controllers' kernels do not work on this machine")


def make_local_controllers(
    engine: EngineName,
    fields: ReceptiveFields,
    settings: LocalControllerSettings,
    capacity: int,
    posture: Vector,
    prior: Prior | None = None,
) -> LocalControllers:
    """Local controllers with an empty window of `capacity` samples, drawn to (m,) `posture`.

    Raises ValueError for parts that do not belong together.
    """
    return _ENGINES[engine](fields, settings, capacity, posture, prior)
