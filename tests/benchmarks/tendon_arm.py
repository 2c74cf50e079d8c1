"""How long one step of the tendon-driven arm takes, how exact it is, and how much it remembers.

`python -m tests.benchmarks tendon_arm` prints one JSON. The paper quotes 0.39 ms for the statics of
such an arm without any load.
"""

import time
from collections.abc import Iterable
from functools import partial

import numpy as np

from config.emulation.plants import TendonArmPlant
from sim_backends.plants.plant import FloatArray, TipLoad
from sim_backends.plants.tendon_arm.tendon_arm import TendonArm
from tests.benchmarks.timing import Figures, pieces
from tests.sim_backends.plants.tendon_arms import (
    PERIOD_S,
    SHIPPED,
    bend,
    led,
    moved,
    paid_out,
    plant,
    walk,
)

QUOTED_MS = 0.39
STEP_MM = 0.125
"""Five millimetres of tendon a second, the fastest that the drives move."""
REFINED = 16
AT_REST = np.zeros(4)


def measure(tiny: bool = False) -> Figures:
    """Wall clock and the thread's own time, in ms, by what the arm does. Kernels are warm."""
    steps = 20 if tiny else 3000
    moving = walk(0, steps, STEP_MM)
    level = plant(gravity_direction=(0.0, -1.0, 0.0))
    return {"quoted_ms": QUOTED_MS} | pieces(
        {
            "still_30_g": partial(_timed, SHIPPED, [bend(3.0, 1.0, 2.0)] * steps, 30.0),
            "moving_no_friction_30_g": partial(_timed, plant(friction=0.0), moving, 30.0),
            "moving_unloaded": partial(_timed, SHIPPED, moving, 0.0),
            "moving_30_g": partial(_timed, SHIPPED, moving, 30.0),
            "moving_30_g_level": partial(_timed, level, moving, 30.0),
            "jumps_30_g": partial(_timed, SHIPPED, _jumps(steps // 10), 30.0),
            "tip_error_um": partial(_errors, 1 if tiny else 12),
            "tip_by_start_mm": partial(_by_start, *((1, 2) if tiny else (12, 12))),
        }
    )


def _timed(config: TendonArmPlant, places: Iterable[FloatArray], grams: float) -> Figures:
    arm, load = TendonArm(config), TipLoad(grams)
    for place in walk(1, 50):
        moved(arm, place, load)
    arm.reset()
    wall_ms, own_ms = [], []
    for place in places:
        wall_s, own_s = time.perf_counter(), time.thread_time()
        arm.step(place, load, PERIOD_S)
        wall_ms.append(1e3 * (time.perf_counter() - wall_s))
        own_ms.append(1e3 * (time.thread_time() - own_s))
    return {
        "median_ms": round(float(np.median(wall_ms)), 4),
        "p99_ms": round(float(np.quantile(wall_ms, 0.99)), 4),
        "median_thread_ms": round(float(np.median(own_ms)), 4),
        "p99_thread_ms": round(float(np.quantile(own_ms, 0.99)), 4),
        "worst_thread_ms": round(max(own_ms), 4),
    }


def _jumps(count: int) -> list[FloatArray]:
    generator = np.random.default_rng(2)
    return [paid_out(generator) for _ in range(count)]


def _errors(ways: int) -> Figures:
    """Tip against eight times as many intervals, all along the same way."""
    coarse, fine = TendonArm(SHIPPED), TendonArm(SHIPPED, intervals_per_span=REFINED)
    generator, here, load, errors = np.random.default_rng(4), AT_REST, TipLoad(30.0), []
    for _ in range(ways):
        goal = paid_out(generator)
        count = max(1, int(np.ceil(np.abs(goal - here).max() / 0.5)))
        for k in range(1, count + 1):
            place = here + (goal - here) * k / count
            one, other = (moved(arm, place, load).tip.position_mm for arm in (coarse, fine))
            errors.append(1e3 * float(np.linalg.norm(one - other)))
        here = goal
    return {"mean": round(float(np.mean(errors)), 3), "max": round(max(errors), 3)}


def _by_start(targets: int, starts: int) -> Figures:
    """Spread of the tip at the same motors, led there from random others."""
    arm, generator, spreads, furthest = TendonArm(SHIPPED), np.random.default_rng(5), [], 0.0
    for _ in range(targets):
        goal, tips = paid_out(generator), []
        for _ in range(starts):
            arm.reset()
            start = paid_out(generator)
            led(arm, AT_REST, start)
            tips.append(led(arm, start, goal).tip.position_mm)
        away = np.linalg.norm(np.array(tips) - np.mean(tips, axis=0), axis=1)
        spreads.append(float(np.sqrt((away**2).mean())))
        furthest = max(furthest, float(away.max()))
    return {
        "rms_mean": round(float(np.mean(spreads)), 2),
        "rms_p95": round(float(np.quantile(spreads, 0.95)), 2),
        "furthest": round(furthest, 2),
    }
