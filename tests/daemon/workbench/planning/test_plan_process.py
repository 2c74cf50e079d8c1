"""The planner as a running daemon asks it: among what moves, too."""

from typing import Any

import msgspec
import numpy as np
import pytest
import yaml

from config.loader import RobotFile, load_robot
from config.tasks.planned_path import PlannedPath
from daemon.risk.body_risk_source import RiskFiles, read_risk_files
from daemon.risk.mesh_file import write_mesh
from daemon.service.operation.planning import PlanOutcome, PlanRequest
from daemon.workbench.body_model.evaluation import shapes
from daemon.workbench.planning.plan_process import answer, grid_among, reaching
from safety.risk.model.mixture import FloatArray
from tests.daemon.workbench.planning.arms import (
    TENDONS,
    bent_to,
    planner_beside_a_ball,
    posture_at,
    reachable,
)

pytestmark = pytest.mark.usefixtures("shared_grids")

BALL_MM = (78.0, 0.0, 172.0)
"""Where `planner_beside_a_ball` has its own."""
RADIUS_MM = 14.0
STANDING = [*BALL_MM, 0.0, 0.0, 0.0, RADIUS_MM]
THICK_MM = 15.0
"""Of the arm itself, all round its centreline."""


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> RobotFile:
    """The shipped arm with nothing near it: a grid that does not reach to where anything moves."""
    folder = tmp_path_factory.mktemp("open")
    write_mesh(folder / "far.stl", shapes.ball(10.0, (0.0, -220.0, 60.0), 200))
    robot: dict[str, Any] = yaml.safe_load(TENDONS.read_text())
    surface = {"mesh": "far.stl", "free": "outside", "grid_mm": 3.0}
    robot["risk"] = {"model": "builtin:tendon_arm.npz", "surface": surface}
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return load_robot(folder / "robot.yaml")


def asked(file: RobotFile, moving: list[list[float]], **other: Any) -> PlanOutcome:
    """From one side of the ball to the other."""
    planner, surface = planner_beside_a_ball(), file.robot.risk.surface
    assert surface is not None
    request = PlanRequest(
        robot_path=str(file.path),
        surface=surface.model_dump(mode="json"),
        moving=moving,
        u=posture_at(planner, bent_to(55.0, -60.0)).tolist(),
        to_mm=reachable(planner, 55.0, 60.0).tolist(),
        via_mm=[],
        pointing=None,
        tip_speed_mm_s=8.0,
        most_risk=0.05,
        seed=1,
    )
    request = msgspec.structs.replace(request, **other)
    return msgspec.json.decode(answer(msgspec.json.encode(request)), type=PlanOutcome)


def least_room_mm(outcome: PlanOutcome) -> float:
    """Of the mean body from the ball, over the whole path."""
    assert outcome.path is not None, outcome.text
    path = PlannedPath.model_validate_json(msgspec.json.encode(outcome.path))
    body = planner_beside_a_ball().body
    lines = np.array([body.centreline(np.array(u)) for u in path.u])
    return float(np.linalg.norm(lines - BALL_MM, axis=2).min() - RADIUS_MM - THICK_MM)


def test_a_path_goes_round_where_a_moving_ball_may_be(file: RobotFile) -> None:
    without = asked(file, [])
    assert least_room_mm(without) < 0.0, "it is in the way"
    found = asked(file, [STANDING])
    assert least_room_mm(found) > 1.0
    assert found.path is not None and without.path is not None
    assert found.path["figures"]["moving_obstacles"] == 1
    assert found.path["figures"]["contact_risk_upper_limit"] <= 0.05
    # What moves is no part of the surroundings that a path is planned in.
    assert found.path["surroundings_sha256"] == without.path["surroundings_sha256"]


def test_all_of_the_way_that_it_may_have_gone_counts(file: RobotFile) -> None:
    aside = np.array([60.0, 0.0, 40.0])
    swept = [*(np.array(BALL_MM) + aside).tolist(), *(-aside).tolist(), RADIUS_MM]
    assert least_room_mm(asked(file, [swept])) > 1.0


def test_a_goal_where_something_moves_is_told_as_that(file: RobotFile) -> None:
    outcome = asked(file, [STANDING], to_mm=[*BALL_MM])
    assert (outcome.none, outcome.path) == ("goal_in_solid", None)
    assert "with 1 moving obstacle where they may be" in outcome.text
    free = asked(file, [], to_mm=[*BALL_MM])
    assert "moving" not in free.text


def test_what_cannot_be_counted_with_is_told(file: RobotFile) -> None:
    outcome = asked(file, [[9.9e3, 0.0, 0.0, 500.0, 0.0, 0.0, 5.0]])
    assert outcome.none == "not_planned"
    assert "finite, and below" in outcome.text


def distances(files: RiskFiles, moving: list[list[float]], places: FloatArray) -> FloatArray:
    """(n,) as the grid has them at its corners next to (n, 3) places."""
    grid = grid_among(files, moving)
    at = np.rint((places - grid.origin_mm) / grid.spacing_mm).astype(int)
    assert (at >= 0).all() and (at < grid.values_mm.shape).all()
    i, j, k = at.T
    return np.asarray(grid.values_mm[i, j, k], np.float64)


def test_a_grid_reaches_as_far_as_what_moves_and_never_tells_too_much_room(
    file: RobotFile,
) -> None:
    files = read_risk_files(file)
    grid, spacing_mm = files.grid, files.grid.spacing_mm
    there = np.array([BALL_MM, (78.0, 30.0, 172.0), (0.0, 0.0, 150.0)])
    found = distances(files, [STANDING], there)
    assert found[:2] == pytest.approx([-RADIUS_MM, 30.0 - RADIUS_MM], abs=spacing_mm)
    wider = reaching(grid, np.array([[-50.0, -50.0, 0.0], [150.0, 50.0, 200.0]]))
    shift = np.rint((grid.origin_mm - wider.origin_mm) / spacing_mm).astype(int)
    i, j, k = (slice(a, a + n) for a, n in zip(shift, grid.values_mm.shape, strict=True))
    assert np.array_equal(wider.values_mm[i, j, k], grid.values_mm)
    corners = np.stack(np.meshgrid(*(np.arange(n) for n in wider.values_mm.shape), indexing="ij"))
    places = wider.origin_mm + spacing_mm * corners.reshape(3, -1).T
    true = np.linalg.norm(places - [0.0, -220.0, 60.0], axis=1) - 10.0
    # As near as a grid is exact, and where places were added nowhere more than there is.
    added = np.ones(wider.values_mm.shape, np.bool_)
    added[i, j, k] = False
    assert (wider.values_mm.ravel() <= true + 2.0 * grid.error_mm).all()
    assert (wider.values_mm.ravel() <= true + 0.5)[added.ravel()].all(), "a ball of 200 triangles"
    within = np.array([grid.origin_mm + 30.0, grid.origin_mm + 31.0])
    assert reaching(grid, within) is grid


def test_what_moves_out_of_reach_changes_nothing(file: RobotFile) -> None:
    files = read_risk_files(file)
    assert grid_among(files, [[900.0, 0.0, 0.0, 10.0, 0.0, 0.0, 5.0]]) is files.grid
