"""Shapes that are looked at together: what is told of each is what it would be of it alone."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import ball, box
from safety.risk.contact import ContactModel
from safety.risk.contact_kernels import clearances, sweep
from safety.risk.shape_kernels import Shapes
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import InsertionPort, environment
from tests.safety.risk.arms import ARC_MM, Pose, shape_mixture

COUNT = 130
"""Two blocks that are whole, and one that is not."""
PORT = InsertionPort((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 15.0, 20.0)

Positions = NDArray[np.float32]


@cache
def grid(name: str) -> DistanceGrid:
    meshes = {
        "ball": ball(15.0, (30.0, 5.0, 0.75 * ARC_MM[-1]), 600),
        "wall": box((60.0, 300.0, 300.0), (52.0, 0.0, 100.0)),
        "room": box((120.0, 120.0, 400.0), (0.0, 0.0, 150.0)),
    }
    return distance_grid(environment(*meshes[name]), 3.0)


def model_in(name: str, port: InsertionPort | None = None) -> ContactModel:
    basis, _ = shape_mixture(Pose(0.004, 0.3, spread=6e-4))
    return ContactModel(basis, grid(name), port, samples=COUNT)


def positions_of(name: str, curvature: float = 0.004) -> Positions:
    _, mixture = shape_mixture(Pose(curvature, 0.3, spread=6e-4))
    drawn = model_in(name).centrelines(mixture).reshape(COUNT, -1)
    return np.ascontiguousarray(drawn[np.random.default_rng(3).permutation(COUNT)])


def shapes_at(positions: Positions) -> Shapes:
    count = len(positions)
    return Shapes(
        np.ascontiguousarray(positions),
        np.empty(count, np.float32),
        np.empty(count, np.int64),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
    )


def looked_at(model: ContactModel, positions: Positions) -> Shapes:
    found = shapes_at(positions)
    clearances(model.surroundings, model.skin, found, len(positions))
    return found


def one_by_one(model: ContactModel, positions: Positions) -> list[Shapes]:
    return [looked_at(model, positions[s : s + 1]) for s in range(len(positions))]


@pytest.mark.parametrize("port", [None, PORT])
@pytest.mark.parametrize("name", ["ball", "wall", "room"])
def test_each_has_the_clearance_that_it_has_alone(name: str, port: InsertionPort | None) -> None:
    model, positions = model_in(name, port), positions_of(name)
    together, alone = looked_at(model, positions), one_by_one(model, positions)
    clearance = np.array([one.clearance[0] for one in alone])
    surely = np.array([one.surely[0] for one in alone])
    np.testing.assert_allclose(together.clearance, clearance, atol=1e-4)
    np.testing.assert_allclose(together.surely, surely, atol=1e-4)
    assert (together.node == [one.node[0] for one in alone]).mean() > 0.95


@pytest.mark.parametrize("name", ["ball", "wall"])
def test_no_node_is_nearer_than_the_clearance_that_is_told(name: str) -> None:
    """By the grid's distances at all nodes, as another function reads them."""
    from daemon.workbench.planning.clearance_slopes import distance_at

    model, positions = model_in(name), positions_of(name)
    found, around = looked_at(model, positions), grid(name)
    places = positions.reshape(-1, 3).astype(np.float64)
    low = around.origin_mm
    high = low + around.spacing_mm * (np.array(around.values_mm.shape) - 1.0)
    inside = ((places > low) & (places < high)).all(axis=1)
    away = np.where(inside, distance_at(around, places)[0], np.inf).reshape(COUNT, -1)
    by_node = (away - model.skin.radius).min(axis=1)
    assert np.isfinite(by_node).sum() > 0.5 * COUNT
    assert (found.clearance <= by_node + 1e-3).all()
    # Between two nodes it may be nearer, by what they are apart at most.
    near = np.isfinite(by_node) & (found.clearance < 5.0)
    assert near.sum() > 10
    assert (by_node[near] - found.clearance[near] < 2.0).all()


def test_a_shape_that_is_no_number_is_solid_and_spoils_no_other() -> None:
    model, positions = model_in("ball"), positions_of("ball")
    sound = looked_at(model, positions)
    for value in (np.nan, np.inf):
        spoilt = positions.copy()
        spoilt[[4, 77], [7, 30]] = value
        found = looked_at(model, spoilt)
        others = np.delete(np.arange(COUNT), [4, 77])
        assert (found.clearance[[4, 77]] == -np.inf).all()
        assert (found.surely[[4, 77]] <= 0.0).all()
        np.testing.assert_allclose(found.clearance[others], sound.clearance[others], atol=1e-4)
        assert ((found.surely > 0.0) == (sound.surely > 0.0))[others].all()


def test_what_is_swept_together_is_swept_as_alone() -> None:
    """From shapes that are clear to others, some through what is solid and some not."""
    model, begin = model_in("ball"), positions_of("ball")
    aside = np.random.default_rng(5).uniform(-60.0, 60.0, (COUNT, 1, 1)) * [[[1.0, 0.2, 0.0]]]
    end = (begin.reshape(COUNT, -1, 3) + aside).reshape(COUNT, -1).astype(np.float32)
    start, stop = looked_at(model, begin), looked_at(model, end)
    swept, surely = start.clearance.copy(), start.surely.copy()
    sweep(model.surroundings, model.skin, start, stop, swept, surely)
    for s in range(COUNT):
        first, last = looked_at(model, begin[s : s + 1]), looked_at(model, end[s : s + 1])
        one, sure = first.clearance.copy(), first.surely.copy()
        sweep(model.surroundings, model.skin, first, last, one, sure)
        assert (surely[s] > 0.0) == (sure[0] > 0.0)
        if one[0] <= 0.0:
            assert swept[s] <= 0.0
    assert 0 < np.count_nonzero(surely > 0.0) < COUNT
    touches = (start.surely > 0.0) & (stop.surely > 0.0) & ~(surely > 0.0)
    assert (swept <= np.minimum(start.clearance, stop.clearance)).all()
    assert touches.any(), "some go through the ball"


def test_a_short_way_between_clear_shapes_is_clear_and_a_long_one_is_looked_at() -> None:
    model = model_in("wall")
    straight = np.zeros((1, positions_of("wall").shape[1]), np.float32)
    straight[0, 2::3] = ARC_MM
    straight[0, 0::3] = 22.0 - float(model.skin.radius.max()) - 8.0
    start = looked_at(model, straight)
    assert start.clearance[0] == pytest.approx(8.0, abs=0.5)
    for way_mm, clear in ((0.5, True), (7.0, True), (7.9, False), (40.0, False), (80.0, False)):
        moved = straight.copy()
        moved[0, 0::3] += way_mm
        stop = looked_at(model, moved)
        swept, surely = start.clearance.copy(), start.surely.copy()
        sweep(model.surroundings, model.skin, start, stop, swept, surely)
        assert (surely[0] > 0.0) == clear
        assert surely[0] <= swept[0]
