"""What is proved of a shape and its way, against distances that are known in closed form.

What is solid are balls, at random places: the distance of any place from them is known, so a body
is tried at thousands of places along it, and a way at many of its moments. Nothing that is proved
may be more than what is found there.
"""

from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.random import Generator
from numpy.typing import NDArray

from safety.risk.contact import surroundings_of
from safety.risk.contact_kernels import CAP_MM, clearances, least_square, sweep
from safety.risk.model.mixture import FloatArray
from safety.risk.shape_kernels import Shapes, Skin, SolidArrays
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import InsertionPort

_fewer = settings(max_examples=settings().max_examples * 2 // 5)
"""Each example is sixty bodies."""
SEEDS = st.integers(0, 2**32 - 1)
PLACES = st.sampled_from(["in the open", "round a port", "through the port"])
NODES, COUNT = 5, 60
"""Shapes beside each other are bounded together, and the last block is not whole."""
_END_MM = 35.0
"""Of the grid, along each axis to either side: 12 mm from all balls."""
ROUNDED_MM = 2e-3
STUB_MM = 0.3
"""A piece that is cut no more counts as in the port where its middle is."""


class Balls(NamedTuple):
    """centres: (b, 3), radii: (b,)."""

    centres: FloatArray
    radii: FloatArray

    def distance(self, places: FloatArray) -> FloatArray:
        """(…,) from (…, 3), mm; negative within a ball."""
        away = np.linalg.norm(places[..., None, :] - self.centres, axis=-1) - self.radii
        return np.asarray(away.min(axis=-1))


class Scene(NamedTuple):
    """Balls, what the compiled code knows of them, a body's skin, and the port."""

    balls: Balls
    solid: SolidArrays
    skin: Skin
    port: InsertionPort | None

    def is_in_port(self, places: FloatArray) -> NDArray[np.bool_]:
        """(…,) of (…, 3) places, or so near that it is left open."""
        if self.port is None:
            return np.zeros(places.shape[:-1], np.bool_)
        inwards = np.array(self.port.inwards)
        away = places - np.array(self.port.centre_mm)
        along = away @ inwards
        aside = np.linalg.norm(away - along[..., None] * inwards, axis=-1)
        return np.asarray(
            (along <= self.port.depth_mm + STUB_MM) & (aside <= self.port.radius_mm + STUB_MM)
        )

    def clearance(self, lines: FloatArray) -> FloatArray:
        """(S,) of (S, n, 3) centrelines: what their thick skin has, tried every 0.2 mm."""
        least = np.full(len(lines), np.inf)
        share = np.linspace(0.0, 1.0, 60)[:, None]
        for i in range(NODES - 1):
            places = lines[:, None, i] + share * (lines[:, None, i + 1] - lines[:, None, i])
            thick = max(self.skin.safe[i], self.skin.safe[i + 1])
            away = np.where(self.is_in_port(places), np.inf, self.balls.distance(places) - thick)
            least = np.minimum(least, away.min(axis=1))
        return least


def scene(random: Generator, with_port: bool = False) -> Scene:
    """A coarse or fine grid, a thick or thin body. What is far away is only roughly known, as where
    a grid is made from one that is coarser."""
    spacing = float(random.uniform(1.0, 3.0))
    radius = random.uniform(1.0, 8.0, NODES).astype(np.float32)
    off = random.uniform(0.0, 2.0, NODES).astype(np.float32)
    balls = Balls(random.uniform(-15.0, 15.0, (5, 3)), random.uniform(0.0, 8.0, 5))
    exact_to = float((radius + off).max()) + 3.0 * spacing + 2.0
    edge = np.arange(-_END_MM, _END_MM + spacing, spacing)
    places = np.stack(np.meshgrid(edge, edge, edge, indexing="ij"), axis=-1)
    values = balls.distance(places)
    coarse_mm = 4.0 * spacing * 0.5 * 3.0**0.5
    far = values > exact_to + 2.0 * coarse_mm
    values[far] += random.uniform(-coarse_mm, coarse_mm, int(far.sum()))
    grid = DistanceGrid(edge[[0, 0, 0]], spacing, values.astype(np.float32), exact_to, 12.0, False)
    port = None
    if with_port:
        inwards = random.normal(size=3)
        inwards /= np.linalg.norm(inwards)
        centre = tuple(random.uniform(-20.0, 20.0, 3).tolist())
        size = float(random.uniform(3.0, 20.0)), float(random.uniform(0.0, 20.0))
        port = InsertionPort(centre, tuple(inwards.tolist()), *size)
    skin = Skin(radius, radius + off, off.max())
    return Scene(balls, surroundings_of(grid, port), skin, port)


def bodies(random: Generator, count: int = COUNT) -> FloatArray:
    """(S, n, 3) centrelines, near to each other in groups of five."""
    first = np.repeat(random.uniform(-25.0, 25.0, (count // 5, 3)), 5, axis=0)
    steps = np.repeat(random.normal(scale=5.0, size=(count // 5, NODES - 1, 3)), 5, axis=0)
    lines = np.concatenate([first[:, None], first[:, None] + np.cumsum(steps, axis=1)], axis=1)
    lines += random.normal(scale=0.7, size=lines.shape)
    return np.asarray(lines.astype(np.float32), np.float64)


def bodies_through(random: Generator, port: InsertionPort) -> FloatArray:
    """The same number, all of which begin in the port and come out of it on its inner side."""
    along = np.array([-0.4, 0.0, 0.4, 0.9, 1.3]) * port.depth_mm + np.array([0.0, 0, 0, 1.0, 6.0])
    lines = np.array(port.centre_mm) + along[:, None] * np.array(port.inwards)
    aside = random.normal(scale=0.05 * port.radius_mm, size=(COUNT, NODES, 3))
    lines = lines + aside * np.array([0.2, 0.5, 1.0, 4.0, 10.0])[:, None]
    return np.asarray(lines.astype(np.float32), np.float64)


def drawn(seed: int, where: str) -> tuple[Generator, Scene, FloatArray]:
    random = np.random.default_rng(seed)
    one = scene(random, with_port=where != "in the open")
    through = one.port if where == "through the port" else None
    return random, one, bodies(random) if through is None else bodies_through(random, through)


def looked_at(one: Scene, lines: FloatArray, exact: int = COUNT) -> Shapes:
    count = len(lines)
    mm = [np.empty(count, np.float32) for _ in range(3)]
    flat = lines.reshape(count, -1).astype(np.float32)
    shapes = Shapes(flat, mm[0], np.empty(count, np.int64), mm[1], mm[2])
    clearances(one.solid, one.skin, shapes, exact)
    return shapes


@_fewer
@given(seed=SEEDS, where=PLACES)
@example(seed=508404123, where="through the port")  # one long piece leads out of it
def test_no_place_of_a_body_has_less_than_what_is_proved(seed: int, where: str) -> None:
    _, one, lines = drawn(seed, where)
    found, truth = looked_at(one, lines), one.clearance(lines)
    proved = found.surely > 0.0
    assert (found.surely[proved] <= truth[proved] + ROUNDED_MM).all()


@pytest.mark.parametrize("seed", range(5))
def test_of_what_is_far_away_more_is_proved_than_is_needed(seed: int) -> None:
    """So that a longer way, beside a port, is clear without a look at what is on it."""
    _, one, lines = drawn(seed, "round a port")
    lines *= 0.2
    balls = one.balls._replace(centres=one.balls.centres + 500.0)
    far = one._replace(
        balls=balls, solid=one.solid._replace(values=np.full_like(one.solid.values, 30.0))
    )
    found = looked_at(far, lines)
    assert (found.surely > 1.5 * CAP_MM).all()
    assert (found.surely <= far.clearance(lines)).all()


@pytest.mark.parametrize("seed", range(8))
def test_nearly_all_that_is_clear_is_proved_to_be(seed: int) -> None:
    """All but what the grid's cubes may hide, three quarters of a square, and a cut's 0.1 mm."""
    random = np.random.default_rng(seed)
    one, lines = scene(random), bodies(random)
    found, truth = looked_at(one, lines), one.clearance(lines)
    thinnest, spacing = float(one.skin.safe.min()), 1.0 / float(one.solid.frame[3])
    hidden_mm = np.sqrt(thinnest**2 + 0.75 * spacing**2) - thinnest + 0.15
    clear = truth > 2.0 * hidden_mm
    assert clear.sum() > 5
    assert (found.surely[clear] > 0.0).all()


@_fewer
@given(seed=SEEDS, where=PLACES, far_mm=st.floats(0.1, 12.0))
def test_nothing_is_touched_on_a_way_that_is_proved(seed: int, where: str, far_mm: float) -> None:
    random, one, begin = drawn(seed, where)
    way = random.normal(scale=far_mm, size=(COUNT, 1, 3)) + random.normal(
        scale=0.2 * far_mm, size=begin.shape
    )
    end = (begin + way).astype(np.float32).astype(np.float64)
    start, stop = looked_at(one, begin), looked_at(one, end)
    swept, surely = start.clearance.copy(), start.surely.copy()
    sweep(one.solid, one.skin, start, stop, swept, surely)
    proved = surely > 0.0
    begin, way = begin[proved], end[proved] - begin[proved]
    for share in np.linspace(0.0, 1.0, 13):
        assert (surely[proved] <= one.clearance(begin + share * way) + ROUNDED_MM).all()
    assert (np.minimum(start.surely, stop.surely)[proved] > 0.0).all()


@pytest.mark.parametrize("seed", range(8))
def test_a_short_way_beside_something_is_proved_without_loss(seed: int) -> None:
    """From where 0.2 mm are proved to where as much is, by ways that are longer than that."""
    random = np.random.default_rng(seed)
    one, begin = scene(random), bodies(random)
    end = begin + random.normal(scale=0.3, size=(COUNT, 1, 3))
    start, stop = looked_at(one, begin), looked_at(one, end)
    swept, surely = start.clearance.copy(), start.surely.copy()
    sweep(one.solid, one.skin, start, stop, swept, surely)
    clear = np.minimum(start.surely, stop.surely) > 0.2
    assert clear.sum() > 5
    assert (surely[clear] > 0.0).all()


@_fewer
@given(seed=SEEDS, exact=st.integers(1, COUNT), where=PLACES)
def test_the_lowest_are_as_exact_as_if_all_were_and_whoever_touches_is_found(
    seed: int, exact: int, where: str
) -> None:
    _, one, lines = drawn(seed, where)
    few, all_of_them = looked_at(one, lines, exact), looked_at(one, lines)
    np.testing.assert_array_equal(few.clearance <= 0.0, all_of_them.clearance <= 0.0)
    np.testing.assert_array_equal(few.surely > 0.0, all_of_them.surely > 0.0)
    lowest = np.sort(all_of_them.clearance)[:exact]
    free = lowest > 0.0
    # Beyond what has to be proved, it is not looked for between nodes.
    near = free & (lowest < one.solid.frame[6] + CAP_MM)
    np.testing.assert_allclose(np.sort(few.clearance)[:exact][near], lowest[near], atol=0.6)
    assert (few.clearance >= all_of_them.clearance - 0.6)[all_of_them.clearance > 0.0].all()
    assert (few.surely <= np.maximum(few.clearance, 0.0) + 1e-6).all()


@given(seed=SEEDS, points=st.integers(1, 6))
def test_a_pieces_bound_is_no_more_than_its_distance_from_any_points(
    seed: int, points: int
) -> None:
    random = np.random.default_rng(seed)
    solid = Balls(random.normal(scale=10.0, size=(points, 3)), np.zeros(points))
    begin, end = random.normal(scale=10.0, size=(2, 3))
    places = begin + np.linspace(0.0, 1.0, 4001)[:, None] * (end - begin)
    ends = [np.float32(solid.distance(place)) for place in (begin, end)]
    bound = least_square(*ends, np.float32(np.linalg.norm(end - begin)))
    truth = float(solid.distance(places).min()) ** 2
    assert bound <= truth + 1e-2
    if points == 1:
        assert bound == pytest.approx(truth, abs=2e-2), "of one point it is the distance"


@pytest.mark.parametrize(
    ("here", "there", "length"),
    [(0.0, 5.0, 1.0), (5.0, -1.0, 1.0), (np.nan, 5.0, 1.0), (5.0, 5.0, np.inf), (5.0, 5.0, 1e25)],
)
def test_of_what_is_solid_or_no_number_nothing_is_proved(
    here: float, there: float, length: float
) -> None:
    assert not least_square(np.float32(here), np.float32(there), np.float32(length)) >= 0.0
