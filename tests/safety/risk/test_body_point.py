"""body_point_risk: bounds that hold, a value that is exact, and its derivatives."""

from collections.abc import Callable
from math import erf, sqrt

import numpy as np
import pytest
from scipy.stats import binom

from daemon.workbench.body_model.evaluation.shapes import (
    ball,
    box,
    chest,
    joined,
    quartered,
    turned,
)
from safety.risk.body_point import BodyPointRisk, along_path
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.mixture_network import MixtureNetwork
from safety.risk.surroundings.environment import Environment, environment
from tests.safety.risk.networks import random_arrays
from tests.safety.risk.scenes import (
    factor_of,
    mixture_of,
    random_mixture,
    random_scene,
    rotation,
    solid_share,
)

ROOM_MM = (200.0, 160.0, 120.0)
ROOM = turned(box(ROOM_MM, (0.0, 0.0, 0.0)))


def phi(x: float) -> float:
    return 0.5 * (1.0 + erf(x / sqrt(2.0)))


def outside_room(mean_mm: list[float], sigma_mm: list[float]) -> float:
    """The share of a component along the axes that is in the walls."""
    inside = 1.0
    for size, mean, sigma in zip(ROOM_MM, mean_mm, sigma_mm, strict=True):
        inside *= phi((size / 2 - mean) / sigma) - phi((-size / 2 - mean) / sigma)
    return 1.0 - inside


@pytest.mark.parametrize("times", range(4))
def test_a_flat_wall_gives_exactly_the_tail_however_it_is_cut(times: int) -> None:
    wall = box((10.0, 4000.0, 4000.0), (5.0, 0.0, 0.0), cuts=3)
    for _ in range(times):
        wall = quartered(wall)
    risk = BodyPointRisk(environment(*wall))
    for distance_mm, sigma_mm in ((24.0, 12.0), (2.0, 1.5), (30.0, 10.0)):
        mixture = mixture_of([1.0], [[-distance_mm, 13.0, -7.0]], [[sigma_mm, 20.0, 11.0]])
        bounds = risk.bounds(mixture)
        tail = phi(-distance_mm / sigma_mm)
        assert bounds.planes.tolist() == [1]
        assert bounds.printed == pytest.approx(tail, rel=1e-7)
        assert bounds.distances[0] == pytest.approx(distance_mm / sigma_mm, rel=1e-6)
        np.testing.assert_allclose(bounds.nearest_mm, [[0.0, 13.0, -7.0]], atol=1e-6)
    thin = BodyPointRisk(environment(*box((2000.0, 2000.0, 2000.0), (1000.0, 0.0, 0.0), 3)))
    value = thin.near_exact(mixture_of([1.0], [[-24.0, 3.0, 2.0]], [[12.0, 9.0, 14.0]]))
    assert value.value == pytest.approx(phi(-2.0), rel=1e-3)


def test_a_wall_of_two_triangles_is_seen_although_its_corners_are_far_away() -> None:
    """The corners of this room are six standard deviations away, its wall less than two."""
    mixture = mixture_of([1.0], [[80.0, 0.0, 0.0]], [[12.0, 12.0, 12.0]])
    truth = outside_room([80.0, 0.0, 0.0], [12.0] * 3)
    assert truth == pytest.approx(0.0478, abs=1e-4)
    corners = mixture.whitened(0, ROOM.vertices_mm)
    assert phi(-float(np.linalg.norm(corners, axis=1).min())) < 1e-8
    mesh = ROOM
    for _ in range(4):
        bounds = BodyPointRisk(environment(*mesh)).bounds(mixture)
        assert bounds.printed == pytest.approx(truth, rel=1e-4)
        assert bounds.printed >= truth
        mesh = quartered(mesh)


def test_a_mean_in_something_solid_counts_in_full() -> None:
    block = BodyPointRisk(environment(*box((60.0, 60.0, 60.0), (0.0, 0.0, 0.0), 2)))
    deep = mixture_of([0.3, 0.7], [[0.0, 0.0, 0.0], [90.0, 0.0, 0.0]], [[2.0] * 3, [12.0] * 3])
    bounds = block.bounds(deep)
    assert bounds.mean_in_solid.tolist() == [True, False]
    assert bounds.printed == pytest.approx(0.3 + 0.7 * phi(-5.0), rel=1e-8)
    assert bounds.certified is not None
    assert 0.3 < bounds.certified <= bounds.printed
    assert block.near_exact(deep).value == pytest.approx(0.3, rel=1e-5)
    np.testing.assert_allclose(bounds.nearest_mm[1], [30.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("mean_x", [29.999999999, 30.0, 30.000000001])
def test_a_mean_on_a_surface_is_no_less_than_half_in_it(mean_x: float) -> None:
    block = BodyPointRisk(environment(*box((60.0, 60.0, 60.0), (0.0, 0.0, 0.0), 2)))
    on_it = mixture_of([1.0], [[mean_x, 0.3, 0.2]], [[1.0] * 3])
    bounds = block.bounds(on_it)
    assert bounds.printed >= 0.5 - 1e-6
    assert bounds.certified is not None
    assert bounds.certified >= 0.5 - 1e-6
    assert block.near_exact(on_it).value == pytest.approx(0.5, abs=1e-6)


def test_where_nothing_is_near_nothing_is_at_risk() -> None:
    bounds = BodyPointRisk(environment(*ROOM)).bounds(
        mixture_of([1.0], [[0.0, 0.0, 0.0]], [[5.0] * 3])
    )
    assert 0.0 <= bounds.printed < 4e-9
    assert bounds.planes.tolist() == [0]
    assert np.isnan(bounds.nearest_mm).all()


@pytest.mark.parametrize(
    ("mean", "sigma"),
    [
        ([80.0, 0.0, 0.0], [12.0, 12.0, 12.0]),
        ([80.0, 60.0, 0.0], [12.0, 20.0, 5.0]),
        ([99.999, 79.0, 59.9], [12.0, 12.0, 12.0]),
        ([105.0, 0.0, 0.0], [12.0, 5.0, 12.0]),
        ([130.0, 0.0, 0.0], [10.0, 5.0, 10.0]),
        ([0.0, 0.0, 0.0], [100.0, 100.0, 100.0]),
        ([80.0, 0.0, 0.0], [40.0, 0.3, 0.3]),
        ([0.0, 0.0, 59.0], [300.0, 0.5, 0.5]),
    ],
)
def test_the_near_exact_value_is_that_of_a_room_in_closed_form(
    mean: list[float], sigma: list[float]
) -> None:
    value = BodyPointRisk(environment(*ROOM)).near_exact(mixture_of([1.0], [mean], [sigma]))
    assert value.value == pytest.approx(outside_room(mean, sigma), rel=5e-4)


def test_the_value_does_not_depend_on_how_the_surface_is_cut() -> None:
    random = np.random.default_rng(5)
    mesh = chest(600, seed=2)
    mixture = Mixture.checked(
        [0.5, 0.5],
        [[20.0, 10.0, 150.0], [-10.0, 40.0, 90.0]],
        [factor_of(np.array([25.0, 8.0, 4.0]), rotation(random)) for _ in range(2)],
    )
    values = []
    for _ in range(4):
        values.append(BodyPointRisk(environment(*mesh)).near_exact(mixture).value)
        mesh = quartered(mesh)
    np.testing.assert_allclose(values, values[-1], rtol=1e-3)


def test_more_obstacles_are_more_risk() -> None:
    near, far = ball(12.0, (30.0, 0.0, 0.0), 80), ball(9.0, (-5.0, 35.0, 0.0), 60)
    mixture = mixture_of([1.0], [[0.0, 0.0, 0.0]], [[15.0, 12.0, 9.0]])
    one, both = (
        BodyPointRisk(environment(*joined(list(bodies)))).near_exact(mixture).value
        for bodies in ((near,), (near, far))
    )
    alone = BodyPointRisk(environment(*far)).near_exact(mixture).value
    assert both == pytest.approx(one + alone, rel=1e-3)
    assert both > one


@pytest.mark.parametrize("seed", range(60))
def test_against_sampling_no_bound_is_below_and_the_value_is_right(seed: int) -> None:
    """The same with a million samples, over a thousand scenes: tests.experiments.body_point."""
    random = np.random.default_rng(seed)
    scene, mixture = random_scene(random), random_mixture(random)
    samples = 40_000
    hits = round(solid_share(scene, mixture.sample(samples, random)) * samples)
    risk = BodyPointRisk(scene.environment)
    bounds, value = risk.bounds(mixture), risk.near_exact(mixture)
    assert bounds.certified is not None
    assert binom.sf(hits - 1, samples, bounds.certified) > 1e-5
    assert value.value <= bounds.certified * (1.0 + 1e-3) + 1e-9
    assert bounds.certified <= bounds.printed <= 1.0
    assert binom.sf(hits - 1, samples, value.value) > 1e-5
    assert binom.cdf(hits, samples, value.value) > 1e-5
    for k, mean in enumerate(mixture.means_mm):
        assert bounds.mean_in_solid[k] == (solid_share(scene, mean[None]) == 1.0)


def test_the_printed_bound_alone_is_the_same_number() -> None:
    random = np.random.default_rng(3)
    risk = BodyPointRisk(random_scene(random).environment)
    for _ in range(10):
        mixture = random_mixture(random)
        quick = risk.bounds(mixture, certified=False)
        assert quick.certified is None
        assert risk.printed(mixture) == quick.printed == risk.bounds(mixture).printed


def test_the_planes_are_the_free_regions_own() -> None:
    """Slowly, in plain numpy: the nearest triangle, a plane there, what is beyond it is done."""
    random = np.random.default_rng(11)
    cavity = environment(*chest(300, seed=0))
    for _ in range(10):
        factor = factor_of(np.exp(random.uniform(1.0, 3.2, 3)), rotation(random))
        mean = np.array([0.0, 0.0, 110.0]) + random.uniform(-30.0, 30.0, 3)
        bounds = BodyPointRisk(cavity).bounds(Mixture.checked([1.0], [mean], [factor]))
        union, planes = slow_union(cavity, mean, factor)
        assert bounds.planes[0] == planes
        assert bounds.unions[0] == pytest.approx(union, rel=1e-6, abs=4e-9)


def slow_union(cavity: Environment, mean: FloatArray, factor: FloatArray) -> tuple[float, int]:
    corners = (cavity.vertices_mm[cavity.triangles] - mean) @ factor.T
    nearest = np.array([nearest_point(triangle) for triangle in corners])
    distance = np.linalg.norm(nearest, axis=1)
    left, union, planes = distance < 6.5, 0.0, 0
    while left.any():
        closest = int(np.argmin(np.where(left, distance, np.inf)))
        b = distance[closest]
        beyond = (corners @ (nearest[closest] / b) >= b * (1.0 - 1e-9)).all(axis=1)
        left &= ~beyond
        union, planes = union + phi(-b), planes + 1
    return union, planes


def nearest_point(triangle: FloatArray) -> FloatArray:
    """To the origin: the projection on the plane if it is within, else the best on the edges."""
    a, b, c = triangle
    normal = np.cross(b - a, c - a)
    foot: FloatArray = normal * (a @ normal) / (normal @ normal)
    within = [np.cross(q - p, foot - p) @ normal >= 0.0 for p, q in ((a, b), (b, c), (c, a))]
    if all(within):
        return foot
    best = []
    for p, q in ((a, b), (b, c), (c, a)):
        share = np.clip(-p @ (q - p) / ((q - p) @ (q - p)), 0.0, 1.0)
        best.append(p + share * (q - p))
    nearest: FloatArray = min(best, key=lambda point: float(point @ point))
    return nearest


def differences(function: Callable[[FloatArray], float], x: FloatArray, step: float) -> FloatArray:
    result = np.empty_like(x)
    for place in np.ndindex(x.shape):
        ends = []
        for side in (1.0, -1.0):
            moved = x.copy()
            moved[place] += side * step
            ends.append(function(moved))
        result[place] = (ends[0] - ends[1]) / (2.0 * step)
    return result


@pytest.mark.parametrize("seed", [1, 2, 6, 11])
def test_the_derivatives_are_those_of_finite_differences(seed: int) -> None:
    random = np.random.default_rng(seed)
    risk = BodyPointRisk(random_scene(random).environment)
    mixture = random_mixture(random)
    value = risk.near_exact(mixture)
    assert value.value > 1e-3
    weights, means, factors = mixture.weights, mixture.means_mm, mixture.factors_per_mm

    def by_means(x: FloatArray) -> float:
        return risk.near_exact(Mixture(weights, x, factors)).value

    def by_factors(x: FloatArray) -> float:
        return risk.near_exact(Mixture(weights, means, x)).value

    scale = np.abs(value.by_means).max()
    np.testing.assert_allclose(
        value.by_means, differences(by_means, means, 0.02), rtol=0.02, atol=0.01 * scale
    )
    upper = np.triu(differences(by_factors, factors, 2e-4))
    scale = np.abs(value.by_factors).max()
    np.testing.assert_allclose(value.by_factors, upper, rtol=0.02, atol=0.01 * scale)


def test_the_gradient_by_the_actuation_goes_through_the_network() -> None:
    arrays = random_arrays(4, (32, 32), (), 5, 3, seed=1, dtype=np.float64)
    arrays["log_diagonal_limits"] = np.array([-1.0, 2.0])
    network = MixtureNetwork(arrays, "tanh")
    risk = BodyPointRisk(environment(*turned(ball(90.0, (0.0, 0.0, 0.0), 400))))
    u = np.array([0.4, -0.7, 1.2, 0.1])

    def at(u: FloatArray) -> float:
        mixture = network.mixture(u)
        assert mixture is not None
        return risk.near_exact(mixture).value

    mixture = network.mixture(u)
    assert mixture is not None
    value = risk.near_exact(mixture)
    assert 1e-3 < value.value < 0.9
    gradient = network.gradient(u, value.by_component, value.by_means, value.by_factors)
    slopes = differences(at, u, 1e-3)
    np.testing.assert_allclose(gradient, slopes, rtol=5e-3, atol=2e-3 * np.abs(slopes).max())


def test_the_product_along_a_path_grows_with_its_waypoints_and_stays_below_the_sum() -> None:
    coarse, fine = along_path([0.05, 0.1, 0.02]), along_path([0.05, 0.05, 0.1, 0.1, 0.02, 0.02])
    assert coarse.product == pytest.approx(1.0 - 0.95 * 0.9 * 0.98)
    assert fine.product > coarse.product
    assert coarse.total == pytest.approx(0.17)
    assert coarse.largest == fine.largest == 0.1
    for path in (coarse, fine):
        assert path.largest <= path.product <= path.total
    assert along_path([]).product == along_path([]).largest == 0.0


def test_a_mixture_over_coefficients_is_not_taken_for_one_over_places() -> None:
    mixture = Mixture.checked([1.0], [[0.0] * 4], [np.eye(4)])
    with pytest.raises(ValueError, match="3 coordinates, not 4"):
        BodyPointRisk(environment(*ROOM)).printed(mixture)
