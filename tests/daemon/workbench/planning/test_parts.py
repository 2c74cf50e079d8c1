"""The parts of a planner: slopes, risks along a path, times, the paper's method."""

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from daemon.host.progress import Unheard
from daemon.workbench.planning.body_in_place import BodyInPlace
from daemon.workbench.planning.clearance_slopes import ClearanceLack, distance_at
from daemon.workbench.planning.gaussian_process import lowered
from daemon.workbench.planning.goals import TipGoal, places_for
from daemon.workbench.planning.path_risk import (
    PathRisks,
    interval,
    printed_path_risk,
    resampled,
)
from daemon.workbench.planning.timing import Speeds, timed
from tests.daemon.workbench.planning.arms import REST, before_a_wall, planner_beside_a_ball

NEAR = np.array([5.0, -2.4, -2.6, 0.4])
"""The arm bent to +x."""


def test_slopes_through_the_model_are_those_of_differences() -> None:
    body = before_a_wall()
    lack = ClearanceLack(body.model, body.contact, body.grid)
    checked = 0
    for share in (0.9, 1.0, 1.1):
        u = share * NEAR
        found, wanted = lack.at(u), np.empty(4)
        for axis in range(4):
            step = np.zeros(4)
            step[axis] = 2e-3
            wanted[axis] = (lack.at(u + step).mm - lack.at(u - step).mm) / 4e-3
        if found.mm > 0.05:
            checked += 1
            assert np.linalg.norm(found.by_u - wanted) < 0.01 * np.linalg.norm(wanted)
    assert checked >= 2


def test_distances_and_their_slopes_are_those_of_the_grid() -> None:
    grid = planner_beside_a_ball().body.grid
    places = np.random.default_rng(0).uniform(-20.0, 20.0, (50, 3)) + np.array([78.0, 0.0, 172.0])
    values, slopes = distance_at(grid, places)
    truth = np.linalg.norm(places - np.array([78.0, 0.0, 172.0]), axis=1) - 14.0
    assert np.abs(values - truth).max() < grid.error_mm
    step = np.array([1e-3, 0.0, 0.0])
    ends = distance_at(grid, places + step)[0] - distance_at(grid, places - step)[0]
    agree = np.isclose(ends / 2e-3, slopes[:, 0], atol=1e-3)
    assert agree.mean() > 0.95  # but for places beside a face between two cubes


def test_twice_the_waypoints_change_the_risk_by_less_than_its_error() -> None:
    body = before_a_wall()
    risks = PathRisks(body, 1000, 3)
    path = np.array([REST, 0.5 * NEAR, 1.066 * NEAR])
    twice = resampled(body, path, 40)
    four_times = resampled(body, path, 80)
    found = [risks.of(one) for one in (path, twice, four_times)]
    assert 0.02 < found[0].probability < 0.98  # or nothing would be shown
    for one in found[1:]:
        assert found[0].lowest <= one.probability <= found[0].highest
    printed = [printed_path_risk(body, resampled(body, path, count)) for count in (20, 40)]
    assert printed[1] > 1.5 * printed[0]  # which equation 10 does not do


def test_more_of_a_path_never_risks_less() -> None:
    body = planner_beside_a_ball().body
    risks = PathRisks(body, 400, 3)
    part, whole = np.array([REST, 0.8 * NEAR]), np.array([REST, 0.8 * NEAR, NEAR])
    assert risks.of(part).probability <= risks.of(whole).probability


def test_an_interval_holds_what_it_says() -> None:
    none, most = interval(0, 1000)
    assert none == 0.0
    assert most == pytest.approx(1.0 - 0.025**0.001)
    low, high = interval(50, 1000)
    assert low == pytest.approx(0.0373, abs=2e-4)
    assert high == pytest.approx(0.0654, abs=2e-4)
    assert interval(7, 7)[1] == 1.0


def test_times_keep_to_velocity_and_acceleration_from_rest_to_rest() -> None:
    places = np.linspace(0.0, 10.0, 201)[:, None] * np.array([[1.0, 0.3]])
    tips = np.column_stack([np.zeros((201, 2)), np.linspace(0.0, 40.0, 201)])
    speeds = Speeds(1e3, np.array([2.0, 2.0]), np.array([4.0, 4.0]))
    t_s = timed(places, tips, np.full(201, 50.0), speeds)
    velocity = np.diff(places, axis=0) / np.diff(t_s)[:, None]
    assert velocity.max() <= 2.0 + 1e-9
    middle = 0.5 * (t_s[1:] + t_s[:-1])
    acceleration = np.diff(velocity, axis=0) / np.diff(middle)[:, None]
    assert np.abs(acceleration[2:-2]).max() <= 4.0
    # 10 mm at 2 mm/s, and 1 s more to get there and to a stop with half of 4 mm/s².
    assert t_s[-1] == pytest.approx(6.0, rel=0.05)


def test_a_way_of_one_piece_takes_as_long_as_its_axes_need() -> None:
    """It is at rest at both of its places, and moves between them all the same."""
    speeds = Speeds(1e3, np.array([5.0]), np.array([50.0]))
    places = np.array([[0.0], [0.5]])
    t_s = timed(places, np.zeros((2, 3)), np.full(2, 50.0), speeds)
    assert t_s[0] == 0.0
    # Half of the acceleration there, half of it back: at least this, and not much more.
    least_s = 2.0 * np.sqrt(0.5 / 50.0)
    assert least_s < t_s[1] < 2.0 * least_s


def test_where_there_is_little_room_it_goes_slower() -> None:
    places = np.linspace(0.0, 10.0, 101)[:, None]
    tips = np.column_stack([np.zeros((101, 2)), np.linspace(0.0, 40.0, 101)])
    speeds = Speeds(8.0, np.array([50.0]), np.array([1e4]))
    free = timed(places, tips, np.full(101, 50.0), speeds)
    tight = timed(places, tips, np.full(101, 5.0), speeds)
    assert tight[-1] == pytest.approx(2.0 * free[-1], rel=0.02)
    assert free[-1] == pytest.approx(5.0, rel=0.05)


def test_a_body_with_axes_that_do_the_same_is_led_as_far_as_any() -> None:
    """Nothing but damping says how two such axes share a step, however long the way is."""
    axes, twice = 6, 500.0 * np.hstack([np.eye(3), np.eye(3)])
    made_up = SimpleNamespace(
        model=SimpleNamespace(scale=np.ones(axes)),
        ranges=SimpleNamespace(lowest=np.full(axes, -50.0), highest=np.full(axes, 50.0)),
        closeness=lambda u: 0.0,
        allowed=lambda u: True,
        tip=lambda u: np.concatenate([twice @ u, [0.0, 0.0, 1.0]]),
    )
    goal = TipGoal(np.array([6900.0, 0.0, 0.0]))
    found = places_for(cast(BodyInPlace, made_up), goal, [np.zeros(axes)], 1)
    assert found.nearest_mm < 1.0
    assert found.places[0][[0, 3]] == pytest.approx([6.9, 6.9], abs=0.01)


def test_the_papers_method_lowers_equation_10_and_nothing_else_decides() -> None:
    body = planner_beside_a_ball().body
    path = resampled(body, np.array([REST, 1.3 * NEAR]), 8)
    found = lowered(body, path, 12, 4, Unheard())
    assert len(found.course) == 13
    assert list(found.course) == sorted(found.course, reverse=True)
    assert found.course[-1] < found.course[0]
    assert np.array_equal(found.waypoints[[0, -1]], path[[0, -1]])
    assert found.course[-1] == pytest.approx(printed_path_risk(body, found.waypoints))
    again = lowered(body, path, 12, 4, Unheard())
    assert again.waypoints.tobytes() == found.waypoints.tobytes()
