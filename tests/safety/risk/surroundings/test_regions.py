"""Regions: where each is, and that with them on the grid nothing is farther away than it is."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.workbench.body_model.evaluation.shapes import box, turned
from safety.risk.model.mixture import FloatArray
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import EnvironmentFaultError, environment
from safety.risk.surroundings.regions import (
    Ball,
    Box,
    Capsule,
    Cylinder,
    HalfSpace,
    Reach,
    Region,
    Shape,
    covered,
    with_regions,
)
from tests.safety.examples import examples
from tests.safety.risk.scenes import rotation

PLACES: st.SearchStrategy[tuple[float, float, float]] = st.tuples(
    *[st.floats(-60.0, 60.0, width=32)] * 3
)
LENGTHS = st.floats(0.5, 40.0, width=32)


@st.composite
def boxes(draw: st.DrawFn) -> Box:
    axes = rotation(np.random.default_rng(draw(st.integers(0, 1000)))).T.tolist()
    x, y, z = ((a, b, c) for a, b, c in axes)
    return Box(draw(PLACES), draw(st.tuples(LENGTHS, LENGTHS, LENGTHS)), (x, y, z))


@st.composite
def lines(draw: st.DrawFn, kind: type[Capsule] | type[Cylinder]) -> Shape:
    begin, length = draw(PLACES), draw(LENGTHS)
    return kind(begin, (begin[0] + length, begin[1], begin[2] - length), draw(LENGTHS))


SHAPES: st.SearchStrategy[Shape] = st.one_of(
    st.builds(Ball, PLACES, LENGTHS),
    boxes(),
    lines(Capsule),
    lines(Cylinder),
    st.builds(HalfSpace, PLACES, PLACES.filter(lambda normal: math.hypot(*normal) > 1.0)),
)
REGIONS = st.builds(Region, SHAPES, st.booleans())


@examples(300)
@given(SHAPES, st.lists(PLACES, min_size=2, max_size=8))
def test_distances_have_a_slope_of_one_at_most(
    shape: Shape, places: list[tuple[float, float, float]]
) -> None:
    points = np.array(places)
    distances = shape.distance(points)
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    assert (np.abs(distances[:, None] - distances) <= apart + 1e-6).all()


@examples(300)
@given(SHAPES, PLACES)
def test_what_is_inside_is_within_its_bounds_and_a_step_out_leads_out(
    shape: Shape, place: tuple[float, float, float]
) -> None:
    point = np.array(place)
    distance = float(shape.distance(point))
    bounds = shape.bounds()
    if bounds is not None and distance < 0.0:
        assert (bounds[0] <= point).all() and (point <= bounds[1]).all()
    if bounds is not None:
        nearest_out = np.maximum(np.maximum(bounds[0] - point, point - bounds[1]), 0.0)
        assert nearest_out.max() == 0.0 or distance >= np.linalg.norm(nearest_out) - 1e-6


@pytest.mark.parametrize(
    ("shape", "point", "expected"),
    [
        (Ball((1.0, 2.0, 3.0), 2.0), (1.0, 2.0, 8.0), 3.0),
        (Ball((1.0, 2.0, 3.0), 2.0), (1.0, 2.0, 3.0), -2.0),
        (Box((0.0, 0.0, 0.0), (2.0, 4.0, 6.0)), (4.0, 6.0, 3.0), 5.0),
        (Box((0.0, 0.0, 0.0), (2.0, 4.0, 6.0)), (0.5, 0.0, 0.0), -0.5),
        (Capsule((0.0, 0.0, 0.0), (0.0, 0.0, 10.0), 1.0), (3.0, 0.0, 14.0), 4.0),
        (Capsule((5.0, 0.0, 0.0), (5.0, 0.0, 0.0), 1.0), (5.0, 3.0, 0.0), 2.0),
        (Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 10.0), 1.0), (4.0, 0.0, 14.0), 5.0),
        (Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 10.0), 3.0), (0.0, 0.0, 9.0), -1.0),
        (HalfSpace((0.0, 0.0, 5.0), (0.0, 0.0, -4.0)), (70.0, 1.0, 3.0), 2.0),
    ],
)
def test_distances_of_places_that_can_be_told_by_hand(
    shape: Shape, point: tuple[float, ...], expected: float
) -> None:
    assert float(shape.distance(np.array(point))) == pytest.approx(expected)
    assert float(Region(shape).clearance(np.array(point))) == pytest.approx(expected)
    assert float(Region(shape, keep_in=True).clearance(np.array(point))) == pytest.approx(-expected)


def test_a_turned_box_is_turned() -> None:
    half = math.sqrt(0.5)
    edge = Box((0.0, 0.0, 0.0), (2.0, 2.0, 2.0), ((half, half, 0), (-half, half, 0), (0, 0, 1)))
    assert float(edge.distance(np.array([math.sqrt(2.0), 0.0, 0.0]))) == pytest.approx(0.0)
    assert edge.bounds()[1] == pytest.approx([math.sqrt(2.0), math.sqrt(2.0), 1.0])


@pytest.mark.parametrize(
    ("make", "told"),
    [
        (lambda: Ball((0.0, 0.0, math.nan), 1.0), "finite"),
        (lambda: Ball((0.0, 0.0, 0.0), math.inf), "finite"),
        (lambda: Ball((0.0, 0.0, 0.0), 0.0), "positive"),
        (
            lambda: Ball((0.0, 0.0), 1.0),  # type: ignore[arg-type]
            "three numbers",
        ),
        (lambda: Box((0.0, 0.0, 0.0), (1.0, -1.0, 1.0)), "positive"),
        (lambda: Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), ((1, 0, 0), (1, 0, 0), (0, 0, 1))), "right"),
        (lambda: Capsule((0.0, 0.0, 0.0), (2e4, 0.0, 0.0), 1.0), "below"),
        (lambda: Cylinder((1.0, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0), "positive"),
        (lambda: HalfSpace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), "positive"),
    ],
)
def test_what_is_no_region_is_refused(make: object, told: str) -> None:
    with pytest.raises(EnvironmentFaultError, match=told):
        make()  # type: ignore[operator]


# On the grid.

REACH = Reach(np.array([0.0, 0.0, 0.0]), 60.0)
AWAY = environment(*box((10.0, 10.0, 10.0), (100.0, 0.0, 0.0), 1))
"""A block that no part of the body reaches."""


def places_of(grid: DistanceGrid) -> FloatArray:
    return grid.origin_mm + grid.spacing_mm * np.moveaxis(np.indices(grid.values_mm.shape), 0, -1)


@examples(25)
@given(st.lists(REGIONS, min_size=1, max_size=3), st.integers(0, 2**31))
def test_wherever_the_body_is_the_grid_knows_the_regions(regions: list[Region], seed: int) -> None:
    wanted = covered(regions, REACH)
    made = with_regions(distance_grid(AWAY, 4.0, 8.0, wanted), regions)
    points = np.random.default_rng(seed).uniform(-40.0, 40.0, (400, 3))
    truth = np.min([region.clearance(points) for region in regions], axis=0)
    at = np.rint((points - made.origin_mm) / made.spacing_mm).astype(int)
    inside = ((at >= 0) & (at < made.values_mm.shape)).all(axis=1)
    known = made.values_mm[tuple(at[inside].T)]
    corners = made.origin_mm + made.spacing_mm * at[inside]
    expected = np.min([region.clearance(corners) for region in regions], axis=0)
    np.testing.assert_array_less(known, expected + 1e-3)
    near = np.abs(expected) < 8.0
    np.testing.assert_allclose(known[near], expected[near], atol=1e-3)
    # Where it ends, what is said of all beyond it holds as well.
    assert made.solid_around or (truth[~inside] > 0.0).all()


def test_a_region_without_an_end_is_solid_wherever_the_grid_ends() -> None:
    floor = [Region(HalfSpace((0.0, 0.0, -20.0), (0.0, 0.0, 1.0)))]
    made = with_regions(distance_grid(AWAY, 4.0, 8.0, covered(floor, REACH)), floor)
    assert made.solid_around
    low, high = places_of(made)[0, 0, 0], places_of(made)[-1, -1, -1]
    assert (low <= -60.0).all() and (high >= 60.0).all()


def test_what_nobody_reaches_makes_no_grid_larger() -> None:
    far = [Region(Ball((0.0, 0.0, 500.0), 20.0))]
    assert covered(far, REACH) is None
    plain = distance_grid(AWAY, 4.0, 8.0)
    assert not with_regions(plain, far).solid_around
    assert with_regions(plain, []) is plain


def test_in_a_cavity_the_walls_stay_what_they_are() -> None:
    room = environment(*turned(box((100.0, 100.0, 100.0), (0.0, 0.0, 0.0), 2)))
    plain = distance_grid(room, 4.0, 8.0)
    ball = Region(Ball((20.0, 0.0, 0.0), 8.0))
    made = with_regions(plain, [ball])
    away = ball.clearance(places_of(plain))
    np.testing.assert_allclose(made.values_mm, np.minimum(plain.values_mm, away), atol=1e-4)
    assert (plain.values_mm != made.values_mm).any(), "the plain one is not written into"
