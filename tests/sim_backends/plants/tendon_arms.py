"""Tendon-driven arms to test with, and motions of theirs."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from config.emulation.plants import TendonArmPlant
from sim_backends.plants.plant import BodyState, FloatArray, TipLoad
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm

SHIPPED = TendonArmPlant(kind="tendon_arm")
FREE = TipLoad()
PERIOD_S = 0.025
ANGLES = np.array([0.0, 2 * np.pi / 3, -2 * np.pi / 3])


def plant(**changes: Any) -> TendonArmPlant:
    """The shipped arm but for these figures."""
    return TendonArmPlant.model_validate({**SHIPPED.model_dump(), **changes})


SMOOTH = plant(friction=0.0, backlash_mm=0.0)
"""Nothing rubs and nothing has play."""
TIGHT = plant(backlash_mm=0.0)
"""Tendons rub, and nothing has play."""


def with_tendons(*tendons: tuple[float, float], **changes: Any) -> TendonArmPlant:
    """A smooth arm without weight, with tendons at these angles and with these turns."""
    routes = tuple({"angle_rad": angle, "turns": turns} for angle, turns in tendons)
    smooth = {"friction": 0.0, "backlash_mm": 0.0, "mass_g": 0.0}
    return plant(tendons=routes, **{**smooth, **changes})


def moved(
    arm: TendonArm, actuators: Iterable[float], load: TipLoad = FREE, dt_s: float = PERIOD_S
) -> BodyState:
    return arm.step(np.array(list(actuators), dtype=np.float64), load, dt_s)


def led(
    arm: TendonArm, start: FloatArray, goal: FloatArray, load: TipLoad = FREE, step_mm: float = 0.5
) -> BodyState:
    """Straight from `start` to `goal` in even steps of at most `step_mm`."""
    count = max(1, int(np.ceil(np.abs(goal - start).max() / step_mm)))
    for k in range(1, count + 1):
        state = moved(arm, start + (goal - start) * k / count, load)
    return state


def bend(pull_mm: float, direction_rad: float = 0.0, helical_mm: float = 0.0) -> FloatArray:
    """(4,) motors that bend the arm to one side without pressing it together."""
    return np.append(pull_mm * np.cos(direction_rad - ANGLES), helical_mm)


def paid_out(generator: np.random.Generator) -> FloatArray:
    """(4,) motors anywhere in the arm's reach; tendons that it bends away from are slack."""
    motors = bend(generator.uniform(0, 14), generator.uniform(-np.pi, np.pi))
    motors[:3] -= 2.0 * (motors[:3] < 0.0)
    motors[3] = generator.uniform(0, 12)
    return motors


def walk(seed: int, steps: int, step_mm: float = 0.25) -> list[FloatArray]:
    """On straight lines from place to place."""
    generator, here, places = np.random.default_rng(seed), np.zeros(4), list[FloatArray]()
    while len(places) < steps:
        goal = bend(
            generator.uniform(0, 8), generator.uniform(-np.pi, np.pi), generator.uniform(-1, 6)
        )
        count = int(np.ceil(np.abs(goal - here).max() / step_mm))
        places.extend(here + (goal - here) * k / count for k in range(1, count + 1))
        here = goal
    return places[:steps]
