"""Ways far from everything: what is proved of all draws at once, and what a few of them tell."""

from dataclasses import replace

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, box
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import upper_limit
from safety.risk.model.mixture import Mixture
from safety.risk.moving_obstacles import MovingBall, Swept
from safety.risk.surroundings.environment import InsertionPort
from safety.risk.way_contact import WayContact
from tests.safety.risk.arms import Pose, shape_mixture
from tests.safety.risk.test_contact import RADIUS_MM, at, cavity, grid_of, rod, wall

TOUCHES_MM = 40.0 - RADIUS_MM
"""Where the rod touches the wall."""


def ways(seed: int, components: int = 3) -> list[Mixture]:
    """Of a rod that goes about before a wall; its draws may fall to another component."""
    random = np.random.default_rng(seed)
    means = random.normal((random.uniform(0.0, 34.0), 0.0), 3.0, (components, 2))
    factors = np.triu(random.normal(0.0, 0.3, (components, 2, 2)))
    factors[:, [0, 1], [0, 1]] = random.uniform(0.4, 4.0, (components, 2))
    way = []
    for _ in range(random.integers(1, 4)):
        weights = random.dirichlet(np.full(components, 0.3))
        way.append(Mixture.checked(weights, means, factors))
        means = means + random.normal(0.0, 1.0, (components, 2))
    return way


@pytest.mark.parametrize("port", [None, InsertionPort((0, 0, 0), (0, 0, 1), 30.0, 60.0)])
def test_of_what_is_proved_to_be_far_no_draw_touches(port: InsertionPort | None) -> None:
    model, found = ContactModel(rod(), wall(), port, samples=200), []
    for seed in range(400):
        way = ways(seed)
        told, far = model.along(way), model.is_far(way)
        found.append((far, told.on_the_way.not_surely_clear > 0))
        if far:
            assert told.on_the_way.not_surely_clear == 0
            assert told.on_the_way.median_mm >= 0.6
    assert min(np.count_nonzero(found, axis=0)) > 40


def test_a_body_a_few_standard_deviations_away_is_far() -> None:
    model = ContactModel(rod(), wall(), None)
    for off_mm, far in ((2.0, False), (9.0, True)):
        assert model.is_far([at(TOUCHES_MM - off_mm, sigma_mm=1.0)]) is far


def test_only_draws_that_there_are_count() -> None:
    """One of two components is beside the wall: half of the draws fall to it, or none."""
    means, factors = [[0.0, 0.0], [33.0, 0.0]], [np.eye(2)] * 2
    few = ContactModel(rod(), wall(), None, samples=50)
    assert not few.is_far([Mixture.checked([0.5, 0.5], means, factors)])
    assert few.is_far([Mixture.checked([1.0 - 1e-6, 1e-6], means, factors)])


def test_a_way_through_what_is_solid_is_not_far_though_its_ends_are() -> None:
    plate = box((4.0, 300.0, 300.0), (0.0, 0.0, 50.0))
    model = ContactModel(rod(), grid_of(plate), None, samples=50)
    assert model.is_far([at(-40.0)]) and model.is_far([at(40.0)])
    assert not model.is_far([at(-40.0), at(40.0)])


def test_what_is_all_in_the_port_is_far_and_what_comes_out_of_it_at_a_wall_is_not() -> None:
    block = grid_of(box((80.0, 80.0, 120.0), (0.0, 0.0, 50.0)))
    deep, shallow = (
        ContactModel(rod(), block, InsertionPort((0, 0, 0), (0, 0, 1), 12.0, depth), samples=50)
        for depth in (150.0, 95.0)
    )
    assert deep.is_far([at(0.0)])
    assert not shallow.is_far([at(0.0)])
    assert not deep.is_far([at(0.0), at(13.0)])


@pytest.mark.parametrize("nodes", [6, 21])
def test_a_body_that_comes_out_of_a_port_into_the_open_is_far(nodes: int) -> None:
    """Beside its last node in the port there may be wall all round, and its next is far out."""
    plate, there = grid_of(box((200.0, 200.0, 50.0), (0.0, 0.0, 0.0))), [at(0.0), at(1.0)]
    for radius_mm, far in ((16.0, True), (9.0, True), (0.5, False)):
        port = InsertionPort((0, 0, 0), (0, 0, 1), radius_mm, 39.0)
        assert ContactModel(rod(nodes), plate, port, samples=50).is_far(there) is far


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("what", ["means_mm", "factors_per_mm"])
def test_what_is_no_number_is_not_far(bad: float, what: str) -> None:
    model, good = ContactModel(rod(), wall(), None, samples=50), at(-100.0)
    parts = {name: getattr(good, name) for name in ("weights", "means_mm", "factors_per_mm")}
    parts[what] = np.full_like(parts[what], bad)
    assert not model.is_far([good, Mixture(**parts)])
    assert not model.is_far([Mixture(**parts), good])


def test_beside_what_moves_all_draws_are_looked_at() -> None:
    contact, way = WayContact(rod(), wall(), None, 100, 0), [at(-100.0), at(-99.0)]
    assert contact.along(way).on_the_way.upper_limit == upper_limit(0, 100)
    contact.take_moving(Swept.of([(MovingBall((-105.0, 0.0, 50.0), 10.0), 0.0)]))
    assert contact.along(way).on_the_way.upper_limit == 1.0


def test_far_away_the_risk_is_that_of_all_draws_and_distances_are_nearly_theirs() -> None:
    (basis, there), (_, here) = (shape_mixture(Pose(bend, 0.5)) for bend in (0.002, 0.0019))
    way = [replace(one, factors_per_mm=4.0 * one.factors_per_mm) for one in (here, there)]
    _, grid = cavity()
    contact = WayContact(basis, grid, CHEST_PORT, 1000, 3)
    assert contact.all_draws.is_far(way)
    told, by_all = contact.along(way), ContactModel(basis, grid, CHEST_PORT, 1000, 3).along(way)
    few, many = told.on_the_way, by_all.on_the_way
    assert (few.upper_limit, few.samples) == (many.upper_limit, 1000)
    assert (few.touching, few.not_surely_clear, told.leaving) == (0, 0, None)
    assert told.touching.shape == (1000,) and not told.touching.any()
    assert told.at_waypoints == by_all.at_waypoints
    assert few.worst.arc_mm == pytest.approx(many.worst.arc_mm, abs=20.0)
    for name in ("lowest_1_percent_mm", "lowest_5_percent_mm", "mean_of_worst_mm", "median_mm"):
        assert getattr(few, name) == pytest.approx(getattr(many, name), abs=1.0)


def test_near_to_something_it_is_what_all_draws_say() -> None:
    contact, model = (
        WayContact(rod(), wall(), None, 400, 1),
        ContactModel(rod(), wall(), None, 400, 1),
    )
    way = [at(30.0, sigma_mm=2.0), at(31.0, sigma_mm=2.0)]
    told, by_all = contact.along(way).on_the_way, model.along(way).on_the_way
    assert told.not_surely_clear == by_all.not_surely_clear > 0
    assert told.mean_of_worst_mm == by_all.mean_of_worst_mm


def test_a_mixture_of_another_body_is_refused() -> None:
    with pytest.raises(ValueError, match="coefficients"):
        ContactModel(rod(), wall(), None, samples=10).is_far(
            [Mixture.checked([1.0], [[0.0] * 3], [np.eye(3)])]
        )
