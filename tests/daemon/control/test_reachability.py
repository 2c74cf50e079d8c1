"""What is refused before anything moves, and the sentence that says why."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from config.control import Workspace
from config.loader import load_robot
from config.tasks.controllers import (
    Broyden,
    ConstantCurvature,
    load_controller_options,
    position_only,
)
from config.tasks.planned_path import PlannedPath
from config.tasks.trajectory import (
    Circle,
    Hold,
    Planned,
    PointPointing,
    TrajectoryOptions,
    Waypoints,
)
from daemon.control.axis_speeds import HasForesight
from daemon.control.reachability import (
    Bounds,
    HasKinematics,
    KinematicModel,
    looks,
    too_fast,
    unreachable,
)
from daemon.controllers.make_controller import make_controller
from daemon.reference.trajectories import Trajectory, make_trajectory
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.experiment_file import load_experiment
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.daemon.control.closed_loop import ROBOT, rectangle

EXPERIMENTS = SOFT_ARM.parent.parent / "experiments"

BOX = Workspace(x_mm=(-40.0, 40.0), y_mm=(-60.0, 60.0), z_mm=(150.0, 210.0))


def model() -> KinematicModel:
    controller = make_controller(ConstantCurvature(kind="constant_curvature"), ROBOT, seed=1)
    assert isinstance(controller, HasKinematics)
    return controller.kinematics


def asked(
    options: TrajectoryOptions, box: Workspace | None, kinematics: KinematicModel | None = None
) -> str | None:
    return unreachable(make_trajectory(options, Path()), Bounds(box, kinematics))


def test_what_is_within_the_workspace_and_the_travel_is_reachable() -> None:
    assert asked(rectangle(60.0), BOX, model()) is None
    assert asked(rectangle(60.0), None) is None


def test_the_first_place_outside_the_workspace_is_named() -> None:
    narrow = BOX.model_copy(update={"y_mm": (-60.0, 40.0)})
    text = asked(rectangle(60.0), narrow)
    assert text is not None
    assert text == (
        "at 27.6 s the rectangle trajectory is at (12, 40, 185) mm, 0.1 mm beyond the workspace's "
        "y_mm [-60, 40]"
    )


def test_the_axis_that_is_farthest_out_is_named() -> None:
    text = asked(Hold(kind="hold", position_mm=(41.0, 65.0, 220.0), duration_s=1.0), BOX)
    assert text == (
        "at 0.0 s the hold trajectory is at (41, 65, 220) mm, 10.0 mm beyond the workspace's "
        "z_mm [150, 210]"
    )


def test_a_little_beyond_is_beyond() -> None:
    circle = Circle(kind="circle", center_mm=(0.0, 0.0, 185.0), radius_mm=39.99, cycle_s=1000.0)
    assert asked(circle, BOX) is None
    assert asked(circle.model_copy(update={"radius_mm": 40.01}), BOX) is not None


def test_every_waypoint_is_looked_at(tmp_path: Path) -> None:
    lines = [f"{k * 0.01:.2f}, 0, {61 if k == 5001 else 0}, 185" for k in range(10_000)]
    (tmp_path / "way.csv").write_text("\n".join(["t, x, y, z", *lines]))
    trajectory = make_trajectory(Waypoints(kind="waypoints", file="way.csv"), tmp_path)
    text = unreachable(trajectory, Bounds(BOX))
    assert text is not None
    assert text.startswith(
        "at 50.0 s the waypoints trajectory is at (0, 61, 185) mm, 1.0 mm beyond"
    )


def test_the_looks_can_be_spread_over_time() -> None:
    trajectory = make_trajectory(rectangle(60.0), Path())
    answers = list(looks(trajectory, Bounds(BOX, model())))
    assert len(answers) > 100
    assert not any(answers)


def test_what_the_axes_cannot_reach_is_told_with_the_miss() -> None:
    text = asked(rectangle(60.0, z_mm=290.0), None, model())
    assert text is not None
    assert text.startswith(
        "at 0.0 s the rectangle trajectory is at (-12, -50, 290) mm, and the axes' travel"
    )
    assert text.endswith("by the controller's model")


def test_a_controller_without_a_model_is_not_asked() -> None:
    controller = make_controller(Broyden(kind="broyden"), ROBOT, seed=1)
    assert not isinstance(controller, HasKinematics)


@pytest.mark.parametrize("z_mm", [170.0, 200.0])
def test_what_the_arm_is_known_to_follow_is_not_refused(z_mm: float) -> None:
    assert asked(rectangle(60.0, z_mm), None, model()) is None


def test_what_is_faster_than_the_tip_may_go_is_told_with_both_speeds() -> None:
    circle = Circle(kind="circle", center_mm=(0.0, 0.0, 185.0), radius_mm=20.0, cycle_s=1.0)
    trajectory = make_trajectory(circle, Path())
    text = unreachable(trajectory, Bounds(tip_speed_mm_s=25.0))
    assert text is not None
    assert "at 125.7 mm/s, and the tip may go 25 mm/s" in text
    assert unreachable(trajectory, Bounds(tip_speed_mm_s=126.0)) is None


def test_a_single_leg_that_is_too_fast_is_found(tmp_path: Path) -> None:
    lines = [f"{k * 0.01:.2f}, 0, {k // 5001 * 0.3}, 185" for k in range(10_000)]
    (tmp_path / "way.csv").write_text("\n".join(["t, x, y, z", *lines]))
    trajectory = make_trajectory(Waypoints(kind="waypoints", file="way.csv"), tmp_path)
    text = unreachable(trajectory, Bounds(tip_speed_mm_s=25.0))
    assert text is not None
    assert text.startswith("at 50.0 s the waypoints trajectory")
    assert "at 30.0 mm/s" in text


def test_an_axis_that_would_have_to_be_too_fast_is_named() -> None:
    axes = AxisRanges.of(ROBOT)
    controller = make_controller(ConstantCurvature(kind="constant_curvature"), ROBOT, seed=1)
    assert isinstance(controller, HasForesight)
    trajectory = make_trajectory(rectangle(60.0), Path())
    bounds = Bounds(BOX, model(), 25.0, axes, controller.foresight)
    assert not any(too_fast(trajectory, bounds))
    slow = replace(axes, max_velocity=axes.max_velocity * 0.01)
    text = next(filter(None, too_fast(trajectory, replace(bounds, axes=slow))))
    assert text.startswith("at ")
    assert any(f"and {name} would have to go" in text for name in axes.names)


@pytest.mark.parametrize("name", sorted(path.stem for path in EXPERIMENTS.glob("*.yaml")))
def test_shipped_experiments_keep_to_all_bounds(name: str) -> None:
    file = load_experiment(EXPERIMENTS / f"{name}.yaml")
    trajectory = make_trajectory(file.experiment.trajectory, file.path.parent)
    speed = getattr(file.experiment.controller, "max_tip_speed_mm_s", None)
    assert unreachable(trajectory, Bounds(file.robot.workspace, None, speed)) is None


class BeyondAtTheEnd:
    """A model whose axes would have to be where they may not be together."""

    tolerance_mm = 1.0

    def reach(self, position_mm: Vector, near_u: Vector | None) -> tuple[Vector, float]:
        drawn_in = position_mm[0] > 5.0
        return np.array([0.0, 0.0, np.pi if drawn_in else 1.0, 9.0, -40.0]), 0.0


def test_a_coupled_limit_on_the_way_is_named_with_its_reason() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    circle = Circle(kind="circle", center_mm=(0.0, 0.0, 185.0), radius_mm=8.0, cycle_s=1000.0)
    bounds = Bounds(None, BeyondAtTheEnd(), None, AxisRanges.of(robot))
    text = unreachable(make_trajectory(circle, Path()), bounds)
    assert text is not None
    assert "the circle trajectory is at" in text
    assert text.endswith(
        "by the controller's model the axes would have to be beyond the coupled limit snap_guard: "
        "tube 3 bends against the pair and would snap"
    )
    near = circle.model_copy(update={"radius_mm": 4.0})
    assert unreachable(make_trajectory(near, Path()), bounds) is None


POSITION_ONLY = (
    "constant_curvature",
    "iterative_learning",
    "model_predictive",
    "pid_constant_curvature",
)
POINTING = PointPointing(kind="away_from", point_mm=(-8.0, -12.0, 136.0))
CIRCLE = Circle(kind="circle", center_mm=(36.0, 0.0, 179.0), radius_mm=15.0, cycle_s=30.0)


def only_by_position(kind: str, trajectory: Trajectory) -> str | None:
    options = load_controller_options({"kind": kind})
    return unreachable(trajectory, Bounds(position_only=position_only(options)))


@pytest.mark.parametrize("kind", POSITION_ONLY)
def test_who_leads_positions_alone_is_told_who_points(kind: str, tmp_path: Path) -> None:
    assert only_by_position(kind, make_trajectory(CIRCLE, Path())) is None
    circle = make_trajectory(CIRCLE.model_copy(update={"pointing": POINTING}), Path())
    (tmp_path / "way.csv").write_text("t,x,y,z,dx,dy,dz\n0,0,0,180,0,0,1\n2,4,0,180,1,0,1\n")
    way = make_trajectory(Waypoints(kind="waypoints", file="way.csv"), tmp_path)
    for trajectory in (circle, way):
        text = only_by_position(kind, trajectory)
        assert text is not None
        assert text.startswith(f"{kind} leads the tip by its position alone")
        assert "such as broyden or gaussian_process" in text


@pytest.mark.parametrize("kind", ["broyden", "gaussian_process"])
def test_who_points_may_be_told_where(kind: str) -> None:
    circle = CIRCLE.model_copy(update={"pointing": POINTING})
    assert only_by_position(kind, make_trajectory(circle, Path())) is None


@pytest.mark.parametrize("kind", POSITION_ONLY)
def test_where_a_planned_path_points_nobody_has_asked_for(kind: str) -> None:
    path = PlannedPath(
        tentacled_path=1,
        robot="soft_arm",
        axes=("one",),
        model_sha256="0" * 64,
        surroundings_sha256="0" * 64,
        t_s=(0.0, 3.0),
        u=((0.0,), (2.0,)),
        tip_mm=((0.0, 0.0, 198.0), (10.0, 0.0, 197.0)),
        direction=((0.0, 0.0, 1.0), (1.0, 0.0, 0.0)),
    )
    trajectory = make_trajectory(Planned(kind="planned", path=path), Path())
    assert trajectory.points
    assert only_by_position(kind, trajectory) is None
