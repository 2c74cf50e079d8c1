"""A mixture given a linear observation: against the closed form, and against drawn samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.random import Generator
from scipy.stats import multivariate_normal

from safety.risk.model.conditioning import (
    LinearObservation,
    bending_covariance,
    conditioned,
    tip_direction,
    tip_place,
)
from safety.risk.model.conditioning_kernels import spread
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.shape_basis import ShapeBasis

ARC_MM = np.linspace(0.0, 200.0, 11)


def mixture_of(random: Generator, components: int = 4, d: int = 5) -> Mixture:
    factors = np.triu(random.normal(size=(components, d, d)), 1) * 0.3
    factors += np.exp(random.uniform(-1.0, 1.0, (components, 1, d))) * np.eye(d)
    weights = random.dirichlet(np.ones(components))
    return Mixture.checked(weights, random.normal(scale=2.0, size=(components, d)), factors)


def observation_of(random: Generator, q: int = 3, d: int = 5) -> LinearObservation:
    matrix, value = random.normal(size=(q, d)), random.normal(scale=2.0, size=q)
    return LinearObservation(matrix, value, random.uniform(0.05, 2.0, q))


def covariance(mixture: Mixture, component: int) -> FloatArray:
    factor = mixture.factors_per_mm[component]
    return np.asarray(np.linalg.inv(factor.T @ factor))


def spread_out(random: Generator, d: int = 5) -> FloatArray:
    root = random.normal(scale=0.5, size=(d, 2))
    return np.asarray(root @ root.T)


@given(st.integers(0, 10_000))
def test_each_component_is_conditioned_as_the_closed_form_has_it(seed: int) -> None:
    """By the gain K = Σ Hᵀ (H Σ Hᵀ + R)⁻¹, which the kernel never forms."""
    random = np.random.default_rng(seed)
    mixture, seen, beside = mixture_of(random), observation_of(random), spread_out(random)
    found = conditioned(mixture, seen, beside)
    assert found is not None
    densities = []
    for k in range(mixture.components):
        before = covariance(mixture, k) + beside
        of_value = seen.matrix @ before @ seen.matrix.T + np.diag(seen.variance)
        gain = before @ seen.matrix.T @ np.linalg.inv(of_value)
        expected = seen.matrix @ mixture.means_mm[k]
        mean = mixture.means_mm[k] + gain @ (seen.value - expected)
        np.testing.assert_allclose(found.mixture.means_mm[k], mean, rtol=1e-8, atol=1e-9)
        after = before - gain @ seen.matrix @ before
        np.testing.assert_allclose(covariance(found.mixture, k), after, rtol=1e-7, atol=1e-9)
        densities.append(multivariate_normal(expected, of_value).pdf(seen.value))
    density = mixture.weights @ densities
    np.testing.assert_allclose(found.log_density, np.log(density), rtol=1e-9)
    weights = mixture.weights * densities / density
    np.testing.assert_allclose(found.mixture.weights, weights, rtol=1e-8)


@given(st.integers(0, 10_000))
def test_what_comes_out_is_a_mixture(seed: int) -> None:
    random = np.random.default_rng(seed)
    found = conditioned(mixture_of(random), observation_of(random), spread_out(random))
    assert found is not None
    one = found.mixture
    Mixture.checked(one.weights, one.means_mm, one.factors_per_mm)


@pytest.mark.parametrize("seed", range(1, 5))
def test_it_is_what_samples_that_agree_with_the_value_are(seed: int) -> None:
    """Of 400 000 samples of the mixture, each weighed by how likely it makes the value."""
    random = np.random.default_rng(seed)
    mixture, seen = mixture_of(random, 3, 3), observation_of(random, 2, 3)
    samples = mixture.sample(400_000, random)
    away = (seen.value - samples @ seen.matrix.T) ** 2 / seen.variance
    weights = np.exp(-0.5 * away.sum(axis=1))
    weights /= weights.sum()
    assert 1.0 / (weights**2).sum() > 2000.0, "enough of them agree"
    found = conditioned(mixture, seen, np.zeros((3, 3)))
    assert found is not None
    after = found.mixture.sample(400_000, random)
    mean = weights @ samples
    np.testing.assert_allclose(after.mean(axis=0), mean, atol=0.06)
    second = np.einsum("n,ni,nj->ij", weights, samples - mean, samples - mean)
    np.testing.assert_allclose(np.cov(after.T), second, atol=0.1, rtol=0.1)


def test_both_parts_of_a_value_at_once_are_one_after_the_other() -> None:
    random = np.random.default_rng(3)
    mixture, seen, none = mixture_of(random), observation_of(random, 4), np.zeros((5, 5))
    parts = [
        LinearObservation(seen.matrix[rows], seen.value[rows], seen.variance[rows])
        for rows in (slice(0, 1), slice(1, 4))
    ]
    first = conditioned(mixture, parts[0], none)
    assert first is not None
    second, both = conditioned(first.mixture, parts[1], none), conditioned(mixture, seen, none)
    assert second is not None
    assert both is not None
    np.testing.assert_allclose(second.mixture.means_mm, both.mixture.means_mm, rtol=1e-8)
    np.testing.assert_allclose(second.mixture.weights, both.mixture.weights, rtol=1e-8)
    assert first.log_density + second.log_density == pytest.approx(both.log_density)


def test_a_value_that_says_nothing_changes_nothing() -> None:
    random = np.random.default_rng(4)
    mixture, seen = mixture_of(random), observation_of(random)
    vague = LinearObservation(seen.matrix, seen.value, np.full(3, 1e12))
    found = conditioned(mixture, vague, np.zeros((5, 5)))
    assert found is not None
    np.testing.assert_allclose(found.mixture.weights, mixture.weights, atol=1e-9)
    np.testing.assert_allclose(found.mixture.means_mm, mixture.means_mm, atol=1e-6)
    np.testing.assert_allclose(found.mixture.factors_per_mm, mixture.factors_per_mm, atol=1e-6)


def test_an_exact_value_is_had_by_every_component() -> None:
    random = np.random.default_rng(5)
    mixture, seen = mixture_of(random), observation_of(random)
    exact = LinearObservation(seen.matrix, seen.value, np.full(3, 1e-10))
    found = conditioned(mixture, exact, np.zeros((5, 5)))
    assert found is not None
    values = found.mixture.means_mm @ seen.matrix.T
    np.testing.assert_allclose(values, np.tile(seen.value, (4, 1)), atol=1e-6)


def test_a_component_without_weight_gets_none() -> None:
    random = np.random.default_rng(6)
    mixture = mixture_of(random)
    only = Mixture(np.array([0.0, 1.0, 0.0, 0.0]), mixture.means_mm, mixture.factors_per_mm)
    found = conditioned(only, observation_of(random), np.zeros((5, 5)))
    assert found is not None
    assert found.mixture.weights.tolist() == [0.0, 1.0, 0.0, 0.0]


@pytest.mark.parametrize("where", ["value", "matrix", "variance", "mean", "factor", "beside"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_what_is_no_number_gives_no_mixture(where: str, wrong: float) -> None:
    random = np.random.default_rng(7)
    mixture, seen, beside = mixture_of(random), observation_of(random), np.zeros((5, 5))
    if where == "variance":
        wrong = np.nan  # one that knows nothing is no mistake
    target = {
        "value": seen.value,
        "matrix": seen.matrix[0],
        "variance": seen.variance,
        "mean": mixture.means_mm[2],
        "factor": mixture.factors_per_mm[3, 0],
        "beside": beside[0],
    }[where]
    target[0] = wrong
    assert conditioned(mixture, seen, beside) is None


def test_what_no_mixture_can_be_gives_none() -> None:
    """A covariance that is none, and a value so far away that its density is no number."""
    random = np.random.default_rng(8)
    mixture, seen = mixture_of(random), observation_of(random)
    assert conditioned(mixture, seen, -1e6 * np.eye(5)) is None
    far = LinearObservation(seen.matrix, np.full(3, 1e200), seen.variance)
    assert conditioned(mixture, far, np.zeros((5, 5))) is None


@given(st.integers(0, 10_000))
def test_the_spread_is_that_of_the_whole_mixture(seed: int) -> None:
    random = np.random.default_rng(seed)
    mixture, matrix = mixture_of(random), random.normal(size=(3, 5))
    mean = mixture.weights @ mixture.means_mm
    whole = sum(
        weight * (covariance(mixture, k) + np.outer(one - mean, one - mean))
        for k, (weight, one) in enumerate(zip(mixture.weights, mixture.means_mm, strict=True))
    )
    found = spread(mixture.weights, mixture.means_mm, mixture.factors_per_mm, matrix)
    assert found == pytest.approx(np.trace(matrix @ whole @ matrix.T))


# What a tip is of a body's coefficients.


def basis_of(modes: FloatArray, base: FloatArray | None = None) -> ShapeBasis:
    nodes = modes.shape[1]
    straight = np.column_stack([np.zeros((nodes, 2)), ARC_MM[:nodes]])
    ones = np.ones(nodes)
    return ShapeBasis.checked(straight if base is None else base, modes, ones, ones, ARC_MM[:nodes])


def test_the_tip_is_the_last_node_and_points_along_the_body() -> None:
    """On a parabola the direction is exact, where a chord is off by half a piece."""
    mode = np.zeros((1, 11, 3))
    mode[0, :, 0] = (ARC_MM / 200.0) ** 2
    basis = basis_of(mode)
    matrix, offset = tip_place(basis)
    np.testing.assert_allclose(matrix @ [7.0] + offset, [7.0, 0.0, 200.0], rtol=1e-6)
    matrix, offset = tip_direction(basis)
    np.testing.assert_allclose(matrix @ [7.0] + offset, [7.0 * 2.0 / 200.0, 0.0, 1.0], atol=1e-6)


def test_a_body_of_two_nodes_points_along_its_chord() -> None:
    mode = np.zeros((1, 2, 3))
    mode[0, 1, 1] = 1.0
    matrix, offset = tip_direction(basis_of(mode))
    np.testing.assert_allclose(matrix @ [2.0] + offset, [0.0, 0.1, 1.0], atol=1e-6)


def test_a_body_bent_a_little_everywhere_spreads_with_the_three_halves_power() -> None:
    """∫₀ˢ (s − t)² dt = s³/3: what random curvature does to a rod."""
    modes = np.eye(33).reshape(33, 11, 3)
    covariance_mm2 = bending_covariance(basis_of(modes))
    variances = np.diag(covariance_mm2).reshape(11, 3)
    np.testing.assert_allclose(variances[-1], 1.0, rtol=1e-3)
    np.testing.assert_allclose(variances[1:] / (ARC_MM[1:, None] / 200.0) ** 3, 1.0, atol=0.12)
    assert variances[0].max() < 1e-12


def test_bends_are_told_in_the_modes_that_there_are_with_a_tip_of_one_mm() -> None:
    random = np.random.default_rng(9)
    modes = random.normal(size=(4, 11, 3)) * (ARC_MM / 200.0)[None, :, None]
    basis = basis_of(modes)
    bends, (matrix, _) = bending_covariance(basis), tip_place(basis)
    assert np.trace(matrix @ bends @ matrix.T) / 3.0 == pytest.approx(1.0, rel=1e-6)
    np.testing.assert_allclose(bends, bends.T, atol=1e-12)
    assert np.linalg.eigvalsh(bends).min() > -1e-9
