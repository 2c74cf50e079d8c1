"""Position and direction as one task: angles on the sphere, and steps that make both."""

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import Broyden
from daemon.control import jacobian_kernels as kernels
from daemon.control.controller import ControllerError, Observation
from daemon.control.redundancy import damped_solution
from daemon.control.task import (
    POSE,
    POSITION,
    angle_between,
    rank_of,
    task_of,
    tip_axis,
    turn_between,
)
from daemon.control.tip_following import TipFollower
from tests import SHIPPED_ROBOTS

TUBES = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
X, Y, Z = np.eye(3)


def seen(
    direction: np.ndarray | None = None, wanted: np.ndarray | None = None, turn: float = 0.0
) -> Observation:
    at = np.array([10.0, 0.0, 180.0])
    still = np.zeros(5)
    return Observation(
        0, 0.025, still, still, at, np.zeros(3), at, np.zeros(3), True, None,
        direction, wanted, None if wanted is None else turn * Y,
    )  # fmt: skip


def test_the_way_between_directions_is_as_long_as_the_angle_and_leads_there() -> None:
    random = np.random.default_rng(1)
    for _ in range(50):
        one, other = random.normal(size=(2, 3))
        one, other = one / np.linalg.norm(one), other / np.linalg.norm(other)
        way = turn_between(one, other)
        angle = float(np.linalg.norm(way))
        assert angle == pytest.approx(np.arccos(one @ other))
        assert way @ one == pytest.approx(0.0, abs=1e-12)
        there = np.cos(angle) * one + np.sin(angle) * way / angle
        np.testing.assert_allclose(there, other, atol=1e-12)
        assert angle_between(3.0 * one, other) == pytest.approx(angle)
    assert turn_between(Z, Z).tolist() == [0.0, 0.0, 0.0]


def test_the_tip_s_axis_is_the_z_axis_of_its_frame() -> None:
    np.testing.assert_allclose(tip_axis(np.array([1.0, 0.0, 0.0, 0.0])), Z)
    half = np.sqrt(0.5)
    np.testing.assert_allclose(tip_axis(np.array([half, 0.0, half, 0.0])), X, atol=1e-12)
    np.testing.assert_allclose(tip_axis(np.array([half, -half, 0.0, 0.0])), Y, atol=1e-12)


def test_a_task_has_three_coordinates_or_six_and_three_or_five_freedoms() -> None:
    assert task_of(seen(), POSITION, 25.0).tolist() == [10.0, 0.0, 180.0]  # type: ignore[union-attr]
    assert task_of(seen(), POSE, 25.0) is None
    assert task_of(seen(Z), POSE, 25.0).tolist() == [10.0, 0.0, 180.0, 0.0, 0.0, 25.0]  # type: ignore[union-attr]
    assert (rank_of(POSITION), rank_of(POSE)) == (3, 5)


def test_the_follower_turns_the_tip_only_where_the_reference_says_where_to_point() -> None:
    options = Broyden(kind="broyden", gain_per_s=4.0, pointing_mm_per_rad=50.0)
    follower = TipFollower(options, TUBES)
    assert follower.task_step(seen(Z)).tolist() == [0.0, 0.0, 0.0]
    tilted = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    step = follower.task_step(seen(Z, tilted, turn=0.2))
    np.testing.assert_allclose(step[:3], 0.0)
    np.testing.assert_allclose(step[3:], 50.0 * np.array([0.1 * 0.1, 0.2 * 0.025, 0.0]))
    fast = follower.task_step(seen(Z, X))
    assert np.linalg.norm(fast[3:]) == pytest.approx(50.0 * 0.5 * 0.025), "no faster than it may"
    with pytest.raises(ControllerError, match="points"):
        follower.task_step(seen(Z, np.array([np.nan, 0.0, 1.0])))


@pytest.mark.parametrize("rows", [3, 6])
def test_damped_least_squares_of_any_rows_are_the_pseudo_inverse_where_nothing_is_damped(
    rows: int,
) -> None:
    random = np.random.default_rng(rows)
    for _ in range(20):
        jacobian = 40.0 * random.normal(size=(rows, 5))
        wanted = jacobian @ random.normal(size=5)
        np.testing.assert_allclose(
            damped_solution(jacobian, wanted, 1e-6),
            np.linalg.pinv(jacobian) @ wanted,
            rtol=1e-6,
            atol=1e-8,
        )
        singular = np.linalg.svd(jacobian, compute_uv=False)
        rank = min(rank_of(rows), 5)
        assert kernels.condition(jacobian, rank) == pytest.approx(singular[0] / singular[rank - 1])


def test_a_direction_along_itself_is_nothing_that_axes_could_do() -> None:
    """Six rows of rank five: what is asked along the tip's own axis moves nothing, and no less of
    the rest is done for it."""
    random = np.random.default_rng(3)
    jacobian = 40.0 * random.normal(size=(6, 5))
    along = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    jacobian[5] = 0.0
    wanted = jacobian @ random.normal(size=5)
    plain, more = (damped_solution(jacobian, one, 5.0) for one in (wanted, wanted + 9.0 * along))
    np.testing.assert_allclose(plain, more, atol=1e-9)
