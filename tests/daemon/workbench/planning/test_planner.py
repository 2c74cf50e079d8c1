"""Paths round things, and the named reasons where there is none."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from config.loader import load_robot
from daemon.risk.mesh_file import read_environment
from daemon.workbench.body_model.evaluation import shapes
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import CLOSE_SHARE, BodyInPlace
from daemon.workbench.planning.goals import TOLERANCE_MM, TipGoal
from daemon.workbench.planning.plan import Plan, Settings
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import distance_grid
from safety.risk.surroundings.environment import environment
from tests import SHIPPED_ROBOTS
from tests.daemon.workbench.planning.arms import (
    MODEL,
    REST,
    SMALL,
    among,
    before_a_slot,
    bent_to,
    model_file,
    planner_beside_a_ball,
    posture_at,
    reachable,
    tendon_arm,
)


@cache
def round_the_ball(again: bool = False) -> tuple[Plan, FloatArray, TipGoal]:
    """again: by a planner that has planned nothing before."""
    planner = planner_beside_a_ball()
    planner = Planner(planner.body, SMALL) if again else planner
    start, goal = posture_at(planner, bent_to(55.0, -60.0)), TipGoal(reachable(planner, 55.0, 60.0))
    found = planner.plan(start, [goal])
    assert isinstance(found, Plan), found.text
    return found, start, goal


def test_a_path_goes_round_what_the_shortest_one_runs_into() -> None:
    planner = planner_beside_a_ball()
    plan, start, goal = round_the_ball()
    shortest = planner.figured(np.array([start, plan.u[-1]]), planner_nominal(planner, start, goal))
    assert shortest.risk.probability > 0.5
    assert plan.risk.upper_limit <= SMALL.most_risk
    assert np.array_equal(plan.u[0], start)
    assert np.linalg.norm(plan.tip_mm[-1] - goal.place_mm) <= TOLERANCE_MM
    assert all(planner.body.allowed(u) for u in plan.u[1:])


def test_where_few_places_lead_nowhere_more_of_them_are_looked_at() -> None:
    """Twelve places of the arm's do not lead there in one piece, and what it knows does."""
    few = Planner(planner_beside_a_ball().body, replace(SMALL, places=12, iterations=1))
    start = posture_at(few, bent_to(-60.0, -60.0))
    found = few.plan(start, [TipGoal(reachable(few, 70.0, 40.0))])
    assert isinstance(found, Plan), found.text
    assert found.risk.upper_limit <= SMALL.most_risk


def planner_nominal(planner: Planner, start: FloatArray, goal: TipGoal):  # type: ignore[no-untyped-def]
    nominal = planner.nominal(start, [goal])
    assert not isinstance(nominal, Blocked)
    return nominal


def test_refining_raises_neither_risk() -> None:
    plan, _, _ = round_the_ball()
    assert plan.risk.upper_limit <= plan.before.upper_limit
    assert plan.risk.probability <= plan.before.probability
    assert plan.printed <= plan.printed_before + 1e-9


def test_a_path_is_slow_enough_for_its_axes_and_its_tip() -> None:
    plan, _, _ = round_the_ball()
    axes = tendon_arm().robot.axes
    dt_s = np.diff(plan.t_s)
    speeds = np.abs(np.diff(plan.u, axis=0)) / dt_s[:, None]
    assert (speeds <= [axis.max_velocity for axis in axes]).all()
    tip_mm_s = np.linalg.norm(np.diff(plan.tip_mm, axis=0), axis=1) / dt_s
    assert tip_mm_s.max() <= SMALL.tip_mm_s * (1.0 + 1e-9)
    assert plan.t_s[0] == 0.0
    assert (dt_s > 0.0).all()


def test_the_same_seed_gives_the_same_bits() -> None:
    one, other = round_the_ball()[0], round_the_ball(again=True)[0]
    assert one.u.tobytes() == other.u.tobytes()
    assert one.t_s.tobytes() == other.t_s.tobytes()
    assert one.risk.by_place == other.risk.by_place


def test_by_way_of_a_place_the_tip_passes_there() -> None:
    planner = planner_beside_a_ball()
    via, goal = reachable(planner, -40.0, 0.0), reachable(planner, 0.0, 40.0)
    plan = planner.plan(REST, [TipGoal(via), TipGoal(goal)])
    assert isinstance(plan, Plan)
    passed = np.linalg.norm(plan.tip_mm - via, axis=1).min()
    assert passed <= TOLERANCE_MM
    assert np.linalg.norm(plan.tip_mm[-1] - goal) <= TOLERANCE_MM


def test_what_preferences_give_is_never_worse_in_both() -> None:
    planner = planner_beside_a_ball()
    start, goal = posture_at(planner, bent_to(55.0, -60.0)), TipGoal(reachable(planner, 55.0, 60.0))
    front = planner.pareto(start, [goal])
    assert not isinstance(front, Blocked)
    lengths = [one.length_mm for one in front]
    limits = [one.risk.upper_limit for one in front]
    assert lengths == sorted(lengths)
    assert limits == sorted(limits, reverse=True)


def blocked(planner: Planner, goal_mm: FloatArray, start: FloatArray = REST) -> Blocked:
    found = planner.plan(start, [TipGoal(goal_mm)])
    assert isinstance(found, Blocked)
    return found


def test_a_sealed_port_is_named() -> None:
    chest = shapes.chest(600, 9)
    body = among(chest, "inside", port=None)
    found = blocked(Planner(body, SMALL), bent_to(20.0, 0.0))
    assert found.why == "entrance_sealed"
    assert found.arc_mm is not None
    assert found.arc_mm < 50.0
    assert "risk.surface.port" in found.text
    opened = among(chest, "inside", port=shapes.CHEST_PORT)
    assert isinstance(Planner(opened, SMALL).plan(REST, [TipGoal(bent_to(20.0, 0.0))]), Plan)


def test_a_goal_inside_a_wall_is_named() -> None:
    wall = shapes.box((20.0, 120.0, 120.0), (75.0, 0.0, 170.0), 3)
    found = blocked(Planner(among(wall, "outside"), SMALL), bent_to(70.0, 0.0))
    assert found.why == "goal_in_solid"
    assert "5.0 mm within" in found.text
    assert found.place_mm == pytest.approx(tuple(bent_to(70.0, 0.0)))


def test_a_goal_nearer_to_a_wall_than_the_body_is_thick_is_named() -> None:
    wall = shapes.box((20.0, 120.0, 120.0), (75.0, 0.0, 170.0), 3)
    found = blocked(Planner(among(wall, "outside"), SMALL), bent_to(57.0, 0.0))
    assert found.why == "goal_too_near"


def test_a_slot_narrower_than_the_body_is_named_with_its_width() -> None:
    found = blocked(Planner(before_a_slot(24.0), SMALL), bent_to(90.0, 0.0))
    assert found.why == "too_narrow"
    assert found.gap_mm == pytest.approx(24.0, abs=4.0)
    assert found.place_mm is not None
    assert abs(found.place_mm[1]) == pytest.approx(12.0, abs=4.0)
    wide = Planner(before_a_slot(110.0), SMALL).plan(REST, [TipGoal(bent_to(90.0, 0.0))])
    assert isinstance(wide, Plan)


def test_what_no_posture_reaches_is_named_with_the_nearest() -> None:
    found = blocked(planner_beside_a_ball(), np.array([0.0, 0.0, 208.0]))
    assert found.why == "goal_out_of_reach"
    assert found.place_mm is not None
    assert found.place_mm[2] == pytest.approx(200.0, abs=2.0)


def test_what_the_robot_file_keeps_the_tip_from_is_named() -> None:
    found = blocked(planner_beside_a_ball(), np.array([0.0, 0.0, 260.0]))
    assert found.why == "goal_outside_workspace"


def test_a_body_that_touches_where_it_stands_does_not_go() -> None:
    ball = shapes.ball(12.0, (24.0, 0.0, 185.0), 200)
    found = blocked(Planner(among(ball, "outside"), SMALL), bent_to(-40.0, 0.0))
    assert found.why == "start_touches"
    assert found.arc_mm is not None
    assert found.arc_mm > 100.0


def test_beyond_what_is_allowed_nothing_starts() -> None:
    found = blocked(planner_beside_a_ball(), bent_to(20.0, 0.0), np.full(4, 14.0))
    assert found.why == "start_not_allowed"


def test_where_the_model_hardly_knows_the_start_what_blocks_beside_it_is_told() -> None:
    soft = load_robot(SHIPPED_ROBOTS / "soft_arm.yaml").robot
    model = model_file(MODEL.with_name("soft_arm.npz")).model
    angles = np.linspace(0.0, 2.0 * np.pi, 11, endpoint=False)
    ring = [
        shapes.ball(8.0, (29.0 * np.cos(angle), 29.0 * np.sin(angle), 178.0), 100)
        for angle in angles
    ]
    around = environment(*shapes.joined(ring), free="outside")
    grid = distance_grid(around, 3.0, model.basis.thickest_mm + 10.0)
    body, rest = BodyInPlace(soft, model, around, grid, samples=50), np.zeros(model.inputs)
    assert body.closeness(rest) > CLOSE_SHARE and body.standing(rest, 1.0).risk < 0.025
    found = Planner(body, Settings(places=300)).plan(
        rest, [TipGoal(np.array([57.0, -65.0, 153.0]))]
    )
    assert isinstance(found, Blocked)
    assert found.why == "no_way"
    assert found.place_mm is not None and found.place_mm[2] > 160.0, "the ring"


def test_a_risk_that_is_too_high_is_no_path() -> None:
    first = planner_beside_a_ball()
    strict = Planner(first.body, replace(SMALL, most_risk=0.004))
    found = blocked(strict, bent_to(40.0, 10.0))
    assert found.why == "too_risky"  # 400 bodies without a touch leave 0.75 %
    assert "--most-risk" in found.text


def test_among_shipped_things_a_mesh_is_read_as_it_is_planned_in() -> None:
    """Nothing but the digest tells other surroundings apart: it must not depend on the reading."""
    from daemon.risk.mesh_file import environment_sha256
    from tests import SHIPPED_ROBOTS

    path = SHIPPED_ROBOTS.parent / "surfaces" / "chest.stl"
    first, again = (environment_sha256(read_environment(path, "inside")) for _ in range(2))
    with_port = environment_sha256(read_environment(path, "inside", shapes.CHEST_PORT))
    assert first == again != with_port
