"""Where a body is asked to go: evenly, and nowhere that it cannot be."""

import numpy as np
import pytest

from config.loader import load_robot
from daemon.robot.axes import AxisRanges
from daemon.robot.coupled_axes import CoupledAxes
from daemon.workbench.body_model.clouds.configurations import (
    BoxManifold,
    Candidates,
    TendonManifold,
    manifold_of,
)
from daemon.workbench.body_model.clouds.emulated_body import EmulatedBody, UnreachableError
from tests import SHIPPED_ROBOTS
from tests.daemon.workbench.body_model.small_clouds import SOFT_ARM, TENDON_ARM

ARM, SOFT = load_robot(TENDON_ARM).robot, load_robot(SOFT_ARM).robot


def test_straight_tendons_bend_the_arm_and_do_not_tear_at_it() -> None:
    candidates = Candidates(ARM, seed=1)
    u = candidates.actuation(candidates.parameters(0, 300))
    together = u[:, :3].mean(axis=1)
    assert together.min() >= -0.4 - 1e-9
    assert together.max() <= 1.0 + 1e-9
    bend = np.abs(u[:, :3] - together[:, None]).max(axis=1)
    assert 12.0 < bend.max() <= 15.0 + 1e-9
    assert u[:, 3].min() < -13.0
    assert u[:, 3].max() > 13.0


def test_other_bodies_move_each_axis_by_itself() -> None:
    manifold = manifold_of(SOFT)
    assert isinstance(manifold, BoxManifold)
    assert isinstance(manifold_of(ARM), TendonManifold)
    assert (manifold.parameters, manifold_of(ARM).parameters) == (6, 4)
    ranges = AxisRanges.of(SOFT)
    np.testing.assert_array_equal(manifold.actuation(np.zeros(6)), ranges.lowest)
    np.testing.assert_array_equal(manifold.actuation(np.ones(6)), ranges.highest)


@pytest.mark.parametrize("robot", [ARM, SOFT], ids=["tendon_arm", "soft_arm"])
def test_the_sequence_fills_the_cube_evenly_wherever_it_is_begun(robot: object) -> None:
    candidates = Candidates(robot, seed=3)  # type: ignore[arg-type]
    whole = candidates.parameters(0, 1000)
    np.testing.assert_allclose(candidates.parameters(400, 50), whole[400:450])
    for values in whole.T:
        counts, _ = np.histogram(values, 10, (0.0, 1.0))
        assert counts.min() > 75
        assert counts.max() < 140
    assert not np.allclose(Candidates(robot, seed=4).parameters(0, 9), whole[:9])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("u", "held"),
    [
        ([0.0, 0.0, 0.0, 0.0], True),
        ([3.0, -1.2, -1.2, 1.0], True),
        ([-2.0, -2.0, -2.0, 0.0], False),  # loose
        ([4.0, 4.0, 4.0, 0.0], False),  # torn
        ([0.0, 0.0, 0.0, -12.0], False),  # the helical tendon hangs loose
        ([15.5, -7.5, -7.5, 0.0], False),  # beyond the travel
    ],
)
def test_only_what_the_tendons_can_hold_is_possible(u: list[float], held: bool) -> None:
    assert Candidates(ARM, seed=1).possible(np.array(u)) == held


def test_only_what_is_in_the_workspace_is_possible() -> None:
    candidates = Candidates(SOFT, seed=1)
    assert candidates.possible(np.full(6, 20.0))
    assert not candidates.possible(np.array([50.0, 0.0, 0.0, 50.0, 0.0, 0.0]))


def test_no_body_is_asked_to_break_a_coupled_limit() -> None:
    """Against the pair's bend and drawn in, tubes are not where a model would be asked for them."""
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    candidates, coupled = Candidates(robot, seed=1), CoupledAxes.of(robot)
    u = candidates.actuation(candidates.parameters(0, 1000))
    inside = coupled.inside(u)
    assert 10 < (~inside).sum() < 200
    outside = u[~inside]
    assert not any(candidates.possible(one) for one in outside)
    assert sum(candidates.possible(one) for one in u[inside][:20]) > 15


def test_an_emulated_body_goes_round_what_the_limits_forbid() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    body = EmulatedBody(robot)
    start, end = (np.array([0.0, 0.0, turned, 9.0, -38.0]) for turned in (1.6, 4.7))
    assert not CoupledAxes.of(robot).way_inside(start, end)
    body.go(start)
    assert body.go(end).snaps == 0
    np.testing.assert_array_equal(body.at, end)
    with pytest.raises(UnreachableError, match="no way there keeps to the coupled limits"):
        body.go(np.array([0.0, 0.0, np.pi, 9.0, -38.0]))
