"""What a controller is shown together belongs together, and it gets the time to learn from it."""

import asyncio
from functools import cache

import numpy as np
import pytest

from daemon.control.controller import Observation
from drivers.pose import Vector
from tests.daemon.service.rig import Rig, on_a_rig

QUICK_CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 10.0,
    "cycle_s": 6.0,
    "cycles": 3,
}
EVERY_S = 0.001
SHIFTS_S = np.linspace(-0.06, 0.06, 241)


class Shown:
    """What a controller was shown while it led the tip round, and where all really was."""

    def __init__(self) -> None:
        self.observations: list[Observation] = []
        self.learnt = 0
        self.frames = 0
        self.t_s: list[float] = []
        self.shafts: list[list[float]] = []

    def late_s(self) -> float:
        """By how much the axes of an observation are older than its time says."""
        true = np.array(self.shafts)
        t_s = np.array([one.t_ns for one in self.observations]) * 1e-9
        u = np.array([one.u for one in self.observations])
        off = [float(np.sum((u - _at(t_s - shift, self.t_s, true)) ** 2)) for shift in SHIFTS_S]
        return float(SHIFTS_S[int(np.argmin(off))])


def _at(t_s: Vector, times_s: list[float], rows: Vector) -> Vector:
    """(n, m) of the shafts, between the rows."""
    return np.array([np.interp(t_s, times_s, column) for column in rows.T]).T


@cache
def shown() -> Shown:
    found = Shown()

    async def scene(rig: Rig) -> None:
        await rig.running(QUICK_CIRCLE)
        loop = rig.service.loop
        controller, scales = loop.controller, [channel.scale for channel in loop.channels]
        assert controller is not None
        observe, learn = controller.observe, controller.learn

        def noted(observation: Observation) -> None:
            found.observations.append(observation)
            observe(observation)

        def learning() -> None:
            found.learnt += 1
            learn()

        controller.observe = noted  # type: ignore[method-assign]
        controller.learn = learning  # type: ignore[method-assign]
        began = loop.steps
        for _ in range(round(8.0 / EVERY_S)):
            found.t_s.append(rig.service.clock.now_ns() * 1e-9)
            counts = rig.shafts()
            found.shafts.append([s.position(c) for s, c in zip(scales, counts, strict=True)])
            await asyncio.sleep(EVERY_S)
        found.frames = loop.steps - began

    on_a_rig(scene)
    # Witnesses begin before the first observation, and end after the last.
    inside = (found.t_s[0] + 0.1, found.t_s[-1] - 0.1)
    found.observations = [
        one for one in found.observations if inside[0] < one.t_ns * 1e-9 < inside[1]
    ]
    return found


def test_axes_are_shown_where_they_were_when_the_tip_was_measured() -> None:
    """To a part of a bus cycle, which is how often they tell where they are."""
    assert len(shown().observations) > 200
    assert shown().late_s() == pytest.approx(0.0, abs=0.003)


def test_every_frame_is_shown_and_leaves_time_to_learn_from_it() -> None:
    assert len(shown().observations) == pytest.approx(40 * 7.8, abs=3)
    assert shown().learnt >= shown().frames
