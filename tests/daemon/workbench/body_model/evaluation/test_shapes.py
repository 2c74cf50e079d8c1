"""The surroundings to try things in: closed, as many triangles as asked for, and the same again."""

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.shapes import (
    CHEST_PORT,
    ball,
    balls,
    box,
    chest,
    quartered,
    slot,
    sphere,
    turned,
)
from safety.risk.surroundings.environment import Mesh, environment


@pytest.mark.parametrize(
    ("mesh", "triangles", "solid_around"),
    [
        (box((30.0, 20.0, 10.0), (5.0, 0.0, 0.0), 3), 108, False),
        (turned(box((30.0, 20.0, 10.0), (5.0, 0.0, 0.0), 1)), 12, True),
        (ball(15.0, (0.0, 0.0, 9.0), 300), 300, False),
        (balls(5, 1000, seed=3), 1000, False),
        (slot(24.0, 2), 96, False),
        (chest(3000, seed=1), 3000, True),
        (quartered(ball(15.0, (0.0, 0.0, 9.0), 300)), 1200, False),
    ],
    ids=["box", "room", "ball", "balls", "slot", "chest", "quartered"],
)
def test_every_shape_is_closed_and_faces_free_space(
    mesh: Mesh, triangles: int, solid_around: bool
) -> None:
    assert len(mesh.triangles) == triangles
    assert environment(*mesh).solid_around == solid_around


def test_a_box_is_where_it_was_asked_for() -> None:
    mesh = environment(*box((30.0, 20.0, 10.0), (5.0, 1.0, -2.0), 4))
    np.testing.assert_allclose(mesh.vertices_mm.min(axis=0), [-10.0, -9.0, -7.0])
    np.testing.assert_allclose(mesh.vertices_mm.max(axis=0), [20.0, 11.0, 3.0])


@pytest.mark.parametrize("triangles", [8, 10, 500, 5000])
def test_a_sphere_has_its_corners_on_it_and_as_many_triangles_as_asked_for(triangles: int) -> None:
    mesh = sphere(triangles)
    assert len(mesh.triangles) == triangles
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices_mm, axis=1), 1.0)


@pytest.mark.parametrize("triangles", [6, 501])
def test_a_sphere_that_cannot_be_is_refused(triangles: int) -> None:
    with pytest.raises(ValueError, match="even number of triangles"):
        sphere(triangles)


def test_the_chest_has_room_for_an_arm_that_comes_in_at_its_port() -> None:
    cavity = environment(*chest(5000, seed=0), port=CHEST_PORT)
    along = np.linspace(5.0, 200.0, 40)
    points = np.column_stack([np.zeros((40, 2)), along])
    assert not cavity.solid(points).any()
    assert cavity.solid(np.array([[0.0, 0.0, -10.0]]))[0]


def test_the_same_seed_gives_the_same_chest_and_another_one_another() -> None:
    one, again, other = chest(1000, 4), chest(1000, 4), chest(1000, 5)
    np.testing.assert_array_equal(one.vertices_mm, again.vertices_mm)
    np.testing.assert_array_equal(one.triangles, again.triangles)
    apart = np.linalg.norm(one.vertices_mm - other.vertices_mm, axis=1)
    assert 0.5 < apart.max() < 20.0


def test_balls_leave_the_way_of_a_straight_arm_free_and_do_not_touch() -> None:
    for seed in range(5):
        mesh = environment(*balls(8, 800, seed))
        points = np.column_stack([np.zeros((40, 2)), np.linspace(0.0, 200.0, 40)])
        assert not mesh.solid(points).any()
        assert np.linalg.norm(mesh.vertices_mm[:, :2], axis=1).min() > 10.0
