"""A soft arm that is led, and its paths."""

from collections.abc import Callable
from copy import deepcopy
from functools import cache

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from config.tasks.controllers import ForwardJacobian
from config.tasks.trajectory import Circle
from daemon.control.controller import Observation, Phase
from daemon.controllers.forward_jacobian import ForwardJacobianController
from drivers.pose import Vector
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import (
    DT_S,
    PISTON_MM2,
    ROBOT,
    ClosedLoop,
    started,
)

START_MM = np.array([30.0, 0.0, 185.0])


def loop_on(body: str | dict[str, float], model: str, learning: bool = True) -> ClosedLoop:
    """At the start of its circle. body: a named one, or what is different on another."""
    figures = {"body": body} if isinstance(body, str) else body
    return deepcopy(_standing(tuple(figures.items()), model, learning))


@cache
def _standing(figures: tuple[tuple[str, object], ...], model: str, learning: bool) -> ClosedLoop:
    """Brought there once: nobody may go on from it but with a copy."""
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", **dict(figures)})
    options = ForwardJacobian(
        kind="forward_jacobian",
        model=model,
        learning=learning,
        lead=True,
        gain_per_s=6.0,
        max_tip_speed_mm_s=80.0,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(closed_loop, "soft_arm", lambda _: SoftArm(plant, [PISTON_MM2] * 6))
        return started(ForwardJacobianController(options, ROBOT, 1), START_MM)


def circle(speed_mm_s: float, cycles: int) -> Circle:
    return Circle(
        kind="circle",
        center_mm=(0.0, 0.0, 185.0),
        radius_mm=30.0,
        cycle_s=60.0 * np.pi / speed_mm_s,
        cycles=cycles,
    )


def by_cycle(loop: ClosedLoop, speed_mm_s: float, cycles: int) -> list[float]:
    errors = loop.follow(circle(speed_mm_s, cycles)).errors_mm
    return [float(part.mean()) for part in np.array_split(errors, cycles)]


def observed(
    t_s: float,
    tip_mm: Vector,
    told_mm: Vector,
    at: Callable[[float], tuple[Vector, Vector]],
    phase: Phase | None = None,
) -> Observation:
    """Of a tip whose axes are its coordinates. at: the reference and its velocity, by time."""
    reference_mm, velocity_mm_s = at(t_s)
    return Observation(
        t_ns=round(t_s * 1e9),
        dt_s=DT_S,
        tip_mm=tip_mm,
        tip_velocity_mm_s=velocity_mm_s,
        u=told_mm,
        targets=told_mm,
        reference_mm=reference_mm,
        reference_velocity_mm_s=velocity_mm_s,
        ahead=lambda lead_s: at(t_s + lead_s),
        phase=phase,
    )
