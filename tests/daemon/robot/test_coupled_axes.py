"""Coupled limits in axes, and in the drives' counts."""

import numpy as np
import pytest

from config.loader import load_robot
from daemon.robot.coupled_axes import CoupledAxes, beyond_alone, count_coupling
from drivers.axis_scale import axis_scale
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS, SOFT_ARM

ROBOT = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
TUBES = CoupledAxes.of(ROBOT)


def at(
    alpha_21: float, alpha_31: float, d_31: float, roll: float = 0.0, ins: float = 0.0
) -> Vector:
    return np.array([roll, roll + alpha_21, roll + alpha_31, ins, ins + d_31 - 53.5])


@pytest.mark.parametrize(
    ("u", "inside"),
    [
        (at(0.0, 0.0, 0.5), True),
        (at(0.0, 0.0, 0.49), False),
        (at(0.0, 0.0, 86.5), True),
        (at(0.0, 0.0, 86.51), False),
        (at(0.0, np.pi, 25.0), True),
        (at(0.0, np.pi, 24.9), False),
        (at(0.0, -np.pi, 24.9), False),
        (at(0.0, 3 * np.pi, 24.9), False),
        (at(2 * np.pi, np.pi, 24.9), False),
        (at(0.0, np.pi - 1.25, 24.9), True),
        (at(0.0, np.pi - 1.15, 24.9), False),
        (at(1.0, np.pi + 0.5, 24.9), False),
        (at(2.5, np.pi + 1.25, 24.9), True),
        (at(0.0, np.pi, 24.9, roll=2.0), False),
        (at(0.0, np.pi, 25.1, ins=9.0), True),
    ],
)
def test_where_the_tubes_may_be(u: Vector, inside: bool) -> None:
    assert bool(TUBES.inside(u)) is inside
    assert (TUBES.first_broken(u) is None) is inside
    # And the same in counts, by what the gate is told.
    counts = [axis_scale(axis).counts(p) for axis, p in zip(ROBOT.axes, u, strict=True)]
    kept = []
    for limit in count_coupling(ROBOT):
        met = all(one.beside(one.sum.at(counts)) is None for one in limit.only_while)
        value = limit.sum.at(counts)
        kept.append(limit.lowest - 0.002 <= value <= limit.highest + 0.002 or not met)
    assert all(kept) is inside


def test_a_robot_without_coupled_limits_may_be_anywhere() -> None:
    robot = load_robot(SOFT_ARM).robot
    free = CoupledAxes.of(robot)
    assert count_coupling(robot) == ()
    far = np.full((4, len(robot.axes)), 1e9)
    assert free.inside(far).all()
    assert free.way_inside(far[0], -far[0])
    np.testing.assert_array_equal(free.way(far[0], -far[0]), [-far[0]])


def test_a_straight_way_is_looked_at_in_between() -> None:
    out, back = at(0.0, np.pi - 1.5, 5.0), at(0.0, np.pi + 1.5, 5.0)
    assert TUBES.inside(np.array([out, back])).all()
    assert not TUBES.way_inside(out, back)
    assert TUBES.way_inside(out, at(0.0, np.pi - 1.5, 60.0))
    assert TUBES.way_inside(at(0.0, np.pi, 5.0), at(0.0, np.pi, 60.0)) is False
    # From where it is not inside, it may be led back in.
    assert TUBES.way_inside(at(0.0, np.pi, 24.9), at(0.0, np.pi, 60.0))


def test_a_way_round_leads_by_where_the_guarded_sum_is_as_at_zero() -> None:
    out, back = at(0.0, np.pi - 1.5, 5.0), at(0.0, np.pi + 1.5, 5.0)
    way = TUBES.way(out, back)
    assert way is not None
    np.testing.assert_allclose(way, [at(0.0, np.pi - 1.5, 53.5), at(0.0, np.pi + 1.5, 53.5), back])
    assert TUBES.way(out, at(0.0, np.pi, 5.0)) is None


def test_what_the_travels_alone_do_not_keep() -> None:
    assert beyond_alone(ROBOT) == pytest.approx([0.5, 25.0])
    inner = ROBOT.axes[4].model_copy(update={"travel_mm": (-43.0, 23.0)})
    kept = ROBOT.model_copy(update={"axes": [*ROBOT.axes[:4], inner]})
    assert beyond_alone(kept) == pytest.approx([0.0, 24.5])
    assert beyond_alone(load_robot(SOFT_ARM).robot) == []
