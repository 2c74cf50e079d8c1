"""PID through the Jacobian of arcs: what its three parts do, and that nothing winds it up."""

from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import load_controller_options
from config.tasks.peers import PidConstantCurvature
from daemon.array_files import ModelError
from daemon.control.controller import ControllerError, Observation
from daemon.control.reachability import Bounds, HasKinematics, unreachable
from daemon.controllers.make_controller import make_controller
from daemon.controllers.peers.pid_constant_curvature import Pid, PidConstantCurvatureController
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT, rectangle, started

NONE = np.zeros(3)


def options(**changes: object) -> PidConstantCurvature:
    asked = load_controller_options({"kind": "pid_constant_curvature", **changes})
    assert isinstance(asked, PidConstantCurvature)
    return asked


def controller(**changes: object) -> PidConstantCurvatureController:
    return PidConstantCurvatureController(options(**changes), ROBOT)


def seen(
    tip: Vector = NONE, reference: Vector = NONE, velocity: Vector = NONE, believed: bool = True
) -> Observation:
    u = np.full(6, 20.0)
    return Observation(0, DT_S, u, u, tip, NONE, reference, velocity, believed)


def errors_on_a_ramp(asked: PidConstantCurvature, speed_mm_s: float = 10.0) -> Vector:
    """(n,) mm along x, of a tip that goes half as fast as it is asked to."""
    pid, tip, found = Pid(asked), NONE, []
    for k in range(1200):
        reference = np.array([speed_mm_s * k * DT_S, 0.0, 0.0])
        now = seen(tip, reference, np.array([speed_mm_s, 0.0, 0.0]))
        found.append(reference[0] - tip[0])
        tip = tip + 0.5 * DT_S * pid.ask(now, DT_S)
    return np.array(found)


@pytest.mark.parametrize("feed_forward", [True, False])
def test_a_reference_that_moves_is_caught_by_the_integral(feed_forward: bool) -> None:
    caught = errors_on_a_ramp(options(feed_forward=feed_forward))
    behind = errors_on_a_ramp(options(feed_forward=feed_forward, integral_per_s2=0.0))
    assert abs(caught[-1]) < 0.05
    assert behind[-1] > 2.0


def test_a_reference_that_jumps_is_no_kick_of_the_textbook_loop_s_derivative() -> None:
    velocity = np.array([40.0, 0.0, 0.0])
    textbook = options(feed_forward=False, derivative=0.5, integral_per_s2=0.0)
    assert not Pid(textbook).ask(seen(velocity=velocity), DT_S).any()
    moving = seen()._replace(tip_velocity_mm_s=velocity)
    assert Pid(textbook).ask(moving, DT_S)[0] == pytest.approx(-20.0)


def test_what_is_not_measured_is_not_integrated() -> None:
    pid = Pid(options(gain_per_s=1.0, derivative=0.0))
    away = np.array([5.0, 0.0, 0.0])
    asked = [pid.ask(seen(reference=away, believed=False), DT_S)[0] for _ in range(3)]
    assert asked == [5.0] * 3
    assert pid.ask(seen(reference=away), DT_S)[0] > 5.0


@pytest.mark.parametrize("kept_back_by", ["gate", "travel"])
def test_the_integral_does_not_wind_up_while_the_axes_cannot_follow(kept_back_by: str) -> None:
    loop = started(controller(), np.array([0.0, 0.0, 190.0]))
    home = loop.tip_mm
    there = home + np.array([25.0 if kept_back_by == "gate" else 400.0, 0.0, 0.0])
    if kept_back_by == "gate":
        loop.permitted = np.zeros_like
    for _ in range(400):
        loop.step(there, NONE)
    loop.permitted = lambda step: step
    beyond_mm = []
    for _ in range(360):
        loop.step(home, NONE)
        beyond_mm.append((home - loop.tip_mm)[0])
    assert abs(beyond_mm[-1]) < 1.0
    assert max(beyond_mm) < 5.0, "on the other side of where it was to stop"
    if kept_back_by == "gate":
        assert min(beyond_mm) > -2.0


def test_it_follows_the_rectangle_with_a_load_that_it_knows_nothing_of() -> None:
    path = rectangle(cycle_s=60.0)
    loop = started(controller(), make_trajectory(path, Path()).start_mm, load_g=20.0)
    followed = loop.follow(path)
    assert followed.mean_mm < 0.9
    assert followed.max_mm < 4.0


def test_the_same_motion_is_answered_the_same_way() -> None:
    def answers() -> Vector:
        loop = started(controller(), np.array([10.0, 0.0, 188.0]))
        return np.array([loop.step(loop.tip_mm + 1.0, NONE) for _ in range(20)])

    np.testing.assert_array_equal(answers(), answers())


def test_a_tip_that_is_no_number_is_an_error_and_leaves_nothing_behind() -> None:
    one, other = controller(), controller()
    place = np.array([0.0, 0.0, 185.0])
    with pytest.raises(ControllerError):
        one.propose(seen(np.full(3, np.nan), place))
    again = seen(place, place + 1.0)
    for own in (one, other):
        own.reset(again)
    np.testing.assert_array_equal(one.propose(again).delta_u, other.propose(again).delta_u)


@pytest.mark.parametrize("robot", ["tendon_arm.yaml", "concentric_tubes.yaml"])
def test_a_robot_that_is_no_such_arm_is_refused_by_name(robot: str) -> None:
    other = load_robot(SHIPPED_ROBOTS / robot).robot
    with pytest.raises(ControllerError, match="pid_constant_curvature is for"):
        make_controller(options(), other, seed=1)


def test_what_is_saved_says_whose_it_is(tmp_path: Path) -> None:
    path = tmp_path / "pid.npz"
    controller().save(path)
    controller().load(path)
    other = PidConstantCurvatureController(options(), ROBOT.model_copy(update={"robot": "other"}))
    with pytest.raises(ModelError):
        other.load(path)


def test_where_the_arm_does_not_come_is_known_before_the_start() -> None:
    known = controller()
    assert isinstance(known, HasKinematics)
    far = make_trajectory(rectangle(60.0, z_mm=290.0), Path())
    assert unreachable(far, Bounds(model=known.kinematics)) is not None
