"""How long the learnt model of concentric tubes takes: to answer, to learn, in a control step."""

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from config.loader import load_robot
from config.tasks.controllers import LearnedKinematics, load_controller_options
from daemon.control import tip_following
from daemon.control.controller import Observation
from daemon.controllers.learned_kinematics import LearnedKinematicsController
from daemon.learning.forward.pose_model import PoseModel
from daemon.learning.lwpr.model import Lwpr, warm_up
from tests import SHIPPED_ROBOTS
from tests.benchmarks.timing import Figures, percentiles, pieces

CALLS = 4000
EPOCH = 435_200
"""Samples of the shipped model: 85 % of 80³."""
MODEL = SHIPPED_ROBOTS.parent / "models" / "concentric_tubes_pose.npz"


def measure(tiny: bool = False) -> Figures:
    """Microseconds per call with the cost of calling from Python, and an epoch's seconds."""
    warm_up()
    tip_following.warm_up()
    calls = 20 if tiny else CALLS
    model = PoseModel.load(MODEL)
    named: dict[str, Callable[[], Figures]] = {
        "predict": partial(_asked, model.lwpr.predict, calls),
        "slopes": partial(_asked, model.lwpr.slopes, calls),
        "epoch": partial(_epoch, model, 5 * calls),
    }
    for feedback in ("model", "tracker"):
        named[f"control_step_{feedback}"] = partial(_steps, calls, feedback=feedback)
    return pieces(named)


def _places(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    random = np.random.default_rng(1)
    return random.uniform([-np.pi, -np.pi, 20.0], [np.pi, np.pi, 87.0], (count, 3))


def _asked(ask: Callable[[Any], object], calls: int) -> Figures:
    places = _places(calls)
    return {"us": percentiles(_times(lambda i: ask(places[i]), calls), 1e6)}


def _epoch(model: PoseModel, samples: int) -> Figures:
    """By a part of it: what is learnt is what the model says already."""
    lwpr = Lwpr.from_arrays(model.lwpr.settings, model.lwpr.to_arrays())
    places = _places(samples)
    said = [lwpr.predict(place) for place in places]
    began = time.perf_counter()
    for place, row in zip(places, said, strict=True):
        lwpr.update(place, row)
    each_s = (time.perf_counter() - began) / samples
    return {"fields": lwpr.count, "update_us": 1e6 * each_s, "epoch_s": EPOCH * each_s}


def _steps(calls: int, **options: Any) -> Figures:
    """Observe with adaptation, and propose a step for position and direction."""
    asked = load_controller_options(
        {"kind": "learned_kinematics", "model": f"builtin:{MODEL.name}", **options}
    )
    assert isinstance(asked, LearnedKinematics)
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    controller = LearnedKinematicsController(asked, robot)
    start, way = np.array([0.0, 2.0, 1.2, 0.0, 0.0]), np.array([0.3, 0.5, -0.5, 1.0, 5.0])
    seen = []
    for share in np.linspace(0.0, 1.0, calls):
        u = start + share * way
        pose = controller.learnt.pose(u)
        tip, direction = pose.position_mm + 1.0, pose.direction
        seen.append(
            Observation(
                round(share * calls * 25e6), 0.025, u, u, tip, np.zeros(3), tip, np.ones(3),
                True, None, direction, direction, np.zeros(3),
            )
        )  # fmt: skip
    controller.reset(seen[0])

    def step(i: int) -> None:
        controller.observe(seen[i])
        controller.propose(seen[i])

    return {"us": percentiles(_times(step, calls), 1e6), "adapted": controller.adapted}


def _times(call: Callable[[int], object], calls: int) -> list[float]:
    call(0)
    times = []
    for number in range(calls):
        began = time.perf_counter()
        call(number)
        times.append(time.perf_counter() - began)
    return times
