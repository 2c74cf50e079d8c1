"""Both controllers without learning, on the arm's physics: the paper's rectangle in a minute.

What is asked is about twice what was measured over many seeds, arms and loads.
"""

from pathlib import Path

import numpy as np

from config.tasks.controllers import Broyden, ConstantCurvature, ControllerOptions
from daemon.control.controller import Controller
from daemon.controllers.broyden import BroydenController
from daemon.controllers.make_controller import make_controller
from daemon.reference.trajectories import make_trajectory
from tests.daemon.control.closed_loop import ROBOT, ClosedLoop, rectangle

ROUND = rectangle(cycle_s=60.0)
START_MM = make_trajectory(ROUND, Path()).start_mm


def made(options: ControllerOptions) -> Controller:
    return make_controller(options, ROBOT, seed=1)


def started(options: ControllerOptions, load_g: float) -> ClosedLoop:
    loop = ClosedLoop(made(options), load_g)
    loop.start()
    loop.explore()
    loop.lead(START_MM)
    return loop


def test_broyden_follows_the_rectangle_without_any_model() -> None:
    followed = started(Broyden(kind="broyden"), load_g=24.0).follow(ROUND)
    assert followed.mean_mm < 1.5
    assert followed.max_mm < 12.0


def test_constant_curvature_follows_the_rectangle_by_feedback() -> None:
    followed = started(ConstantCurvature(kind="constant_curvature"), load_g=30.0).follow(ROUND)
    assert followed.mean_mm < 1.2
    assert followed.max_mm < 3.0


def test_what_broyden_measured_at_first_is_what_the_arm_does() -> None:
    controller = made(Broyden(kind="broyden"))
    loop = ClosedLoop(controller)
    loop.start()
    loop.explore()
    assert isinstance(controller, BroydenController)
    measured = controller.jacobian
    assert measured is not None
    for axis in range(6):
        before = loop.body.tip.position_mm
        settled = ClosedLoop(made(Broyden(kind="broyden")))
        settled.targets = loop.targets + 3.0 * np.eye(6)[axis]
        for _ in range(60):
            settled.measure()
        truth = (settled.body.tip.position_mm - before) / 3.0
        assert np.linalg.norm(measured[:, axis] - truth) < 0.25 * np.linalg.norm(truth)


def test_a_rest_in_between_does_not_make_it_jump() -> None:
    loop = started(ConstantCurvature(kind="constant_curvature"), 0.0)
    loop.start()
    first = loop.step(loop.tip_mm, np.zeros(3))
    assert np.abs(first).max() < 0.05
