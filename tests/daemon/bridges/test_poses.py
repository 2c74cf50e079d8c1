"""Turns as other programs want them: a direction becomes a turn that has it as its z."""

import numpy as np
from hypothesis import given

from daemon.bridges.poses import is_place, quaternion_along, rotation, unit_quaternion
from tests.daemon.bridges.telling import PLACES, QUATERNIONS


@given(QUATERNIONS)
def test_a_rotation_is_one(quaternion: list[float]) -> None:
    unit = unit_quaternion(quaternion)
    assert unit is not None
    turned = rotation(unit)
    assert np.allclose(turned @ turned.T, np.eye(3)) and np.isclose(np.linalg.det(turned), 1.0)


@given(PLACES.filter(lambda place: np.linalg.norm(place) > 1e-3))
def test_the_turn_along_a_direction_has_it_as_its_z(direction: list[float]) -> None:
    turned = rotation(quaternion_along(direction))
    wanted = np.array(direction) / np.linalg.norm(direction)
    assert np.allclose(turned[:, 2], wanted, atol=1e-4)


def test_against_z_there_is_a_turn_too() -> None:
    assert np.allclose(rotation(quaternion_along([0.0, 0.0, -2.0]))[:, 2], [0.0, 0.0, -1.0])


def test_no_direction_is_no_turn() -> None:
    for nothing in (None, [], [0.0, 0.0, 0.0], [float("nan"), 0.0, 1.0]):
        assert quaternion_along(nothing) == (1.0, 0.0, 0.0, 0.0)


def test_what_is_no_quaternion_and_no_place_is_none() -> None:
    assert unit_quaternion(None) is None
    assert unit_quaternion([0.0, 0.0, 0.0, 0.0]) is None
    assert unit_quaternion([float("nan"), 0.0, 0.0, 1.0]) is None
    assert not is_place([1.0, 2.0]) and not is_place([1.0, 2.0, float("inf")])
