"""A path that the axes are too slow for is told before it is gone, and no other one."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import Broyden, ForwardJacobian, LearnedKinematics, RewardWeighted
from config.tasks.trajectory import Circle, Hold, Rectangle, TrajectoryOptions, Waypoints
from daemon.control.axis_speeds import BEHIND_MM, Foresight, HasForesight, unhurried_s
from daemon.control.reachability import Bounds, too_fast
from daemon.controllers.forward_jacobian import ForwardJacobianController
from daemon.controllers.make_controller import make_controller
from daemon.reference.trajectories import make_trajectory
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.experiment_file import load_experiment
from drivers.pose import Vector
from sim_backends.plants.plant import TipLoad
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import ROBOT, pretrained, rectangle, soft_arm, started

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

AXES = replace(
    AxisRanges.of(ROBOT),
    names=("x", "y", "z"),
    lowest=np.full(3, -500.0),
    highest=np.full(3, 500.0),
    max_velocity=np.array([10.0, 20.0, 30.0]),
    scale=np.full(3, 1000.0),
    units=("mm", "mm", "mm"),
)
"""Each moves the tip along one coordinate, by 2 mm per mm."""


def gantry(known: bool = True) -> Foresight:
    return Foresight(
        lambda tip_mm: 0.5 * tip_mm,
        lambda tip_mm, _: 2.0 * np.eye(3) if known or tip_mm[0] < 0.0 else None,
        lambda jacobian, velocity, _: np.asarray(velocity / jacobian.diagonal()),
    )


def said(
    options: TrajectoryOptions, foresight: Foresight | None = None, axes: AxisRanges = AXES
) -> str | None:
    trajectory = make_trajectory(options, Path())
    bounds = Bounds(axes=axes, foresight=gantry() if foresight is None else foresight)
    return next((why for why in too_fast(trajectory, bounds) if why), None)


def circle(speed_mm_s: float, radius_mm: float = 30.0, cycles: int = 1) -> Circle:
    return Circle(
        kind="circle",
        center_mm=(0.0, 0.0, 0.0),
        radius_mm=radius_mm,
        cycle_s=2.0 * np.pi * radius_mm / speed_mm_s,
        cycles=cycles,
    )


def way(*points: tuple[float, float, float, float]) -> Waypoints:
    return Waypoints(kind="waypoints", points=points)


def test_the_axis_its_speed_what_is_needed_and_what_would_do_are_told() -> None:
    text = said(circle(30.0))
    assert text is not None
    assert "the circle trajectory is at" in text
    assert "at 30 mm/s, and x would have to go 15 mm/s, where 10 is the most" in text
    found = re.search(r"Up to ([\d.]+) mm/s it can be followed: let a cycle take ([\d.]+) s", text)
    assert found is not None
    fastest, lasts_s = map(float, found.groups())
    assert 20.0 <= fastest < 24.0  # 20 mm/s keeps x within its speed all the time
    assert fastest * lasts_s == pytest.approx(2.0 * np.pi * 30.0, rel=5e-3)
    assert said(circle(fastest)) is None


def test_a_path_along_which_every_axis_is_fast_enough_is_not_refused() -> None:
    assert said(circle(19.9)) is None
    assert said(Hold(kind="hold", position_mm=(3.0, 0.0, 0.0), duration_s=36000.0)) is None


def test_a_short_haste_is_no_path_that_is_too_fast() -> None:
    hurried = (0.5 * BEHIND_MM, 0.9 * BEHIND_MM, 1.5 * BEHIND_MM)
    slow_s = 5.0
    answers = [
        # Twice as fast as x may, for as long as leaves the tip so far behind; then rest.
        said(way((0, 0, 0, 0), (far / 20.0, 2.0 * far, 0, 0), (slow_s, 2.0 * far, 0, 0)))
        for far in hurried
    ]
    assert answers[:2] == [None, None]
    assert answers[2] is not None


def test_what_is_left_behind_in_one_cycle_is_missing_in_the_next() -> None:
    # Out and back along x at 21 mm/s of 20: 1.4 mm behind after 30 mm.
    once = ((0.0, 0.0, 0.0, 0.0), (15.0 / 21.0, 15.0, 0.0, 0.0), (30.0 / 21.0, 0.0, 0.0, 0.0))
    assert said(way(*once)) is None
    assert said(way(*once).model_copy(update={"cycles": 3})) is not None


def along_x(t_s: float) -> tuple[Vector, Vector]:
    """Evenly, 40 mm in 2 s."""
    return np.array([20.0 * t_s, 0.0, 0.0]), np.array([20.0, 0.0, 0.0])


def drawn_aside(jacobian: Vector, velocity: Vector, u: Vector) -> Vector:
    """Whatever the way is, the second axis is drawn aside as fast as it goes."""
    return np.asarray(
        gantry().velocity(jacobian, velocity, u) + np.array([0.0, AXES.max_velocity[1], 0.0])
    )


def test_a_way_takes_so_long_that_no_axis_has_to_go_faster_than_half_of_what_it_can() -> None:
    fastest = 20.0 / 2.0 / AXES.max_velocity[0]
    assert unhurried_s(along_x, 2.0, gantry(), AXES) == pytest.approx(2.0 * fastest / 0.5)
    ten_times = replace(AXES, max_velocity=10.0 * AXES.max_velocity)
    assert unhurried_s(along_x, 2.0, gantry(), ten_times) == 2.0


def test_where_the_axes_are_drawn_to_makes_no_way_longer() -> None:
    drawn = replace(gantry(), velocity=drawn_aside)
    same = unhurried_s(along_x, 2.0, gantry(), AXES)
    assert unhurried_s(along_x, 2.0, drawn, AXES) == pytest.approx(same)


def test_a_way_of_which_nothing_is_known_takes_no_longer() -> None:
    nowhere = replace(gantry(), begin=lambda _: None)
    assert unhurried_s(along_x, 2.0, nowhere, AXES) == 2.0
    assert unhurried_s(along_x, 2.0, gantry(known=False), AXES) == 2.0


def test_where_nothing_is_known_nothing_is_said() -> None:
    assert said(circle(30.0), gantry(known=False)) is not None  # half of it is known
    nowhere = replace(gantry(), begin=lambda _: None)
    assert said(circle(300.0), nowhere) is None
    assert next(too_fast(make_trajectory(circle(300.0), Path()), Bounds(axes=AXES)), None) is None


def test_a_controller_that_knows_nothing_yet_foresees_nothing() -> None:
    assert not isinstance(make_controller(Broyden(kind="broyden"), ROBOT, 1), HasForesight)
    blank = make_controller(RewardWeighted(kind="reward_weighted"), ROBOT, 1)
    assert isinstance(blank, HasForesight)
    assert blank.foresight is None


@pytest.fixture(scope="module")
def learnt(tmp_path_factory: pytest.TempPathFactory) -> ForwardJacobianController:
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return led(str(path))


def led(model: str) -> ForwardJacobianController:
    options = ForwardJacobian(
        kind="forward_jacobian", model=model, lead=True, gain_per_s=6.0, max_tip_speed_mm_s=80.0
    )
    return ForwardJacobianController(options, ROBOT, 1)


def at_speed(options: Rectangle, mm_s: float) -> Rectangle:
    round_mm = 2.0 * (options.width_mm + options.height_mm)
    return options.model_copy(update={"cycle_s": round_mm / mm_s})


def mean_mm(options: Rectangle, learnt: ForwardJacobianController) -> float:
    return started(led(str(learnt._options.model)), START_MM).follow(options).mean_mm


START_MM = np.array([-12.5, -50.0, 185.0])
CIRCLE_START_MM = np.array([30.0, 0.0, 185.0])


@pytest.mark.parametrize("place_mm", [(5.0, -20.0, 185.0), (-12.5, -50.0, 185.0), (30, 0, 180)])
def test_a_path_is_foreseen_from_axes_that_bring_the_tip_there_and_are_near_the_posture(
    place_mm: tuple[float, float, float], learnt: ForwardJacobianController
) -> None:
    foresight, wanted_mm = learnt.foresight, np.array(place_mm)
    assert foresight is not None
    u = foresight.begin(wanted_mm)
    assert u is not None
    assert (np.abs(u - 25.0) < 18.0).all(), "in the middle of the travel"
    tip_mm = np.array(soft_arm().step(u, TipLoad(), 60.0).tip.position_mm)
    assert np.linalg.norm(tip_mm - wanted_mm) < 10.0


def test_what_is_said_of_the_arm_is_what_becomes_of_it(learnt: ForwardJacobianController) -> None:
    axes = AxisRanges.of(ROBOT)
    narrow = rectangle(60.0)
    text = said(at_speed(narrow, 80.0), learnt.foresight, axes)
    assert text is not None
    found = re.search(r"Up to ([\d.]+) mm/s", text)
    assert found is not None
    fastest = float(found[1])
    assert 20.0 < fastest < 60.0
    assert said(at_speed(narrow, fastest), learnt.foresight, axes) is None
    # A tip that is behind cuts corners: it is not as far from its reference as along the way.
    assert mean_mm(at_speed(narrow, 80.0), learnt) > 3.0
    assert mean_mm(at_speed(narrow, fastest), learnt) < 2.0


def test_a_circle_that_takes_all_axes_together_is_followed_and_not_refused(
    learnt: ForwardJacobianController,
) -> None:
    options = circle(40.0, cycles=4).model_copy(update={"center_mm": (0.0, 0.0, 185.0)})
    assert said(options, learnt.foresight, AxisRanges.of(ROBOT)) is None
    errors = started(led(str(learnt._options.model)), CIRCLE_START_MM).follow(options).errors_mm
    first, *_, last = (float(part.mean()) for part in np.array_split(errors, 4))
    assert first < 1.5
    assert last < 0.6


@pytest.mark.parametrize("speed_mm_s", [5.0, 10.0, 20.0])
def test_circles_that_the_arm_is_known_to_follow_are_not_refused(
    speed_mm_s: float, learnt: ForwardJacobianController
) -> None:
    options = circle(speed_mm_s, cycles=5).model_copy(update={"center_mm": (0.0, 0.0, 185.0)})
    assert said(options, learnt.foresight, AxisRanges.of(ROBOT)) is None


TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"


def test_a_learnt_pose_model_foresees_it_too() -> None:
    robot = load_robot(TUBES).robot
    options = LearnedKinematics(
        kind="learned_kinematics", model="builtin:concentric_tubes_pose.npz"
    )
    controller = make_controller(options, robot, 1)
    assert isinstance(controller, HasForesight)
    round_slowly = Circle(kind="circle", center_mm=(36.0, 0.0, 179.0), radius_mm=15.0, cycle_s=30.0)
    axes = AxisRanges.of(robot)
    assert said(round_slowly, controller.foresight, axes) is None
    text = said(round_slowly.model_copy(update={"cycle_s": 1.0}), controller.foresight, axes)
    assert text is not None
    assert any(name in text for name in axes.names)


EXPERIMENTS = SHIPPED_ROBOTS.parent / "experiments"
LEARNERS = sorted(
    path.stem
    for path in EXPERIMENTS.glob("*.yaml")
    if {"pretraining:", f"robot: builtin:{ROBOT.robot}"} <= set(path.read_text().splitlines())
)


@pytest.mark.parametrize("name", LEARNERS)
def test_no_shipped_experiment_of_a_learner_is_too_fast(
    name: str, learnt: ForwardJacobianController
) -> None:
    file = load_experiment(EXPERIMENTS / f"{name}.yaml")
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    bounds = Bounds(axes=AxisRanges.of(file.robot), foresight=learnt.foresight)
    assert next((why for why in too_fast(trajectory, bounds) if why), None) is None
