"""OMPL's RRT* looks for paths of the same body among the same things."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation import shapes
from daemon.workbench.planning.blocked import Blocked
from daemon.workbench.planning.body_in_place import BodyInPlace
from daemon.workbench.planning.goals import TipGoal
from daemon.workbench.planning.plan import Settings
from daemon.workbench.planning.planner import Planner
from safety.risk.model.mixture import FloatArray
from tests.daemon.workbench.planning.arms import (
    REST,
    among,
    bent_to,
    posture_at,
)

ompl = pytest.importorskip("ompl", reason="ompl is not installed: `make oracles` does it")
from ompl import base, geometric, util  # noqa: E402

ROUNDS = 700
SETTINGS = Settings(places=400, waypoints=10, iterations=8, samples=400)


def in_the_way() -> BodyInPlace:
    """A ball, between where the tip is at (55, −60) and at (55, 60)."""
    return among(shapes.ball(22.0, (66.0, 0.0, 172.0), 200), "outside")


def their_path(
    planner: Planner, start: FloatArray, end: FloatArray, rounds: int = ROUNDS
) -> FloatArray | None:
    """(n, m) of the axes, with all means free as the paper asks for; None: they found none."""
    body = planner.body
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(11)
    space = base.RealVectorStateSpace(len(start))
    bounds = base.RealVectorBounds(len(start))
    for axis, (low, high) in enumerate(zip(body.ranges.lowest, body.ranges.highest, strict=True)):
        bounds.setLow(axis, float(low))
        bounds.setHigh(axis, float(high))
    space.setBounds(bounds)

    def free(state: Any) -> bool:
        u = np.array([state[axis] for axis in range(len(start))])
        return body.allowed(u) and body.means_free(u)

    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(free)
    setup.setStartAndGoalStates(state_of(space, start), state_of(space, end))
    setup.getSpaceInformation().setStateValidityCheckingResolution(0.01)
    setup.setPlanner(geometric.RRTstar(setup.getSpaceInformation()))
    setup.solve(base.PlannerTerminationCondition(after(rounds)))
    if not setup.haveExactSolutionPath():
        return None
    path = setup.getSolutionPath()
    states = [path.getState(i) for i in range(path.getStateCount())]
    return np.array([[state[axis] for axis in range(len(start))] for state in states])


def state_of(space: Any, u: FloatArray) -> Any:
    state = space.allocState()
    for axis, place in enumerate(u):
        state[axis] = float(place)
    return state


def after(rounds: int) -> Callable[[], bool]:
    """True when it was asked so often: an end that no clock decides."""
    left = iter(range(rounds))
    return lambda: next(left, None) is None


WAYS = [
    ((55.0, -60.0), (55.0, 60.0)),
    ((55.0, 60.0), (55.0, -60.0)),
    ((55.0, -60.0), (0.0, 40.0)),
    ((-40.0, 0.0), (55.0, 60.0)),
]
"""Of the tip, from x and y to x and y, mm. On the first two the ball is in the way."""


@pytest.mark.parametrize("way", WAYS)
def test_where_they_find_a_path_we_do_and_ours_moves_the_body_no_farther(
    way: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    planner = Planner(in_the_way(), SETTINGS)
    start, end = (posture_at(planner, bent_to(*place)) for place in way)
    theirs = their_path(planner, start, end)
    ours = planner.nominal(start, [TipGoal(planner.body.tip(end)[:3])])
    assert theirs is not None
    assert not isinstance(ours, Blocked), ours.text
    assert all(planner.body.means_free(u) for u in planner.body.finely(ours.waypoints))
    assert planner.body.length_mm(planner.body.finely(theirs)) > 0.95 * ours.length_mm


def test_the_ball_is_in_the_way_of_the_straight_line() -> None:
    planner = Planner(in_the_way(), SETTINGS)
    start, end = (posture_at(planner, bent_to(*place)) for place in WAYS[0])
    straight = planner.body.finely(np.array([start, end]))
    assert not all(planner.body.means_free(u) for u in straight)


def test_out_of_a_closed_box_neither_finds_a_way() -> None:
    hollow = shapes.box((90.0, 90.0, 90.0), (0.0, 0.0, 190.0), 3)
    body = among(hollow, "inside", port=shapes.CHEST_PORT)
    planner = Planner(body, SETTINGS)
    outside = posture_at(planner, bent_to(75.0, 0.0))
    assert their_path(planner, REST, outside, 200) is None
    assert isinstance(planner.plan(REST, [TipGoal(bent_to(75.0, 0.0))]), Blocked)
