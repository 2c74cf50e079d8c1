"""A mixture's density, its samples, and what it refuses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from safety.risk.model.mixture import Mixture, MixtureError
from tests.safety.risk.scenes import random_mixture


@given(st.integers(0, 10_000))
def test_the_density_is_that_of_normal_distributions(seed: int) -> None:
    random = np.random.default_rng(seed)
    mixture = random_mixture(random)
    points = random.uniform(-100.0, 100.0, (7, 3))
    density = sum(
        weight * multivariate_normal(mean, np.linalg.inv(factor.T @ factor)).pdf(points)
        for weight, mean, factor in zip(
            mixture.weights, mixture.means_mm, mixture.factors_per_mm, strict=True
        )
    )
    seen = density > 1e-250
    np.testing.assert_allclose(np.exp(mixture.log_density(points))[seen], density[seen], rtol=1e-9)


def test_a_far_point_has_a_finite_density() -> None:
    mixture = Mixture.checked([0.5, 0.5], [[0.0], [1.0]], [[[1.0]], [[1.0]]])
    assert mixture.log_density(np.array([[1e4]]))[0] == pytest.approx(-0.5 * 9999.0**2, rel=1e-3)


def test_a_component_sees_its_own_samples_as_standard_normal() -> None:
    factor = [[0.5, 0.2, -0.1], [0.0, 0.1, 0.3], [0.0, 0.0, 2.0]]
    mixture = Mixture.checked([1.0], [[10.0, -5.0, 3.0]], [factor])
    white = mixture.whitened(0, mixture.sample(200_000, np.random.default_rng(0)))
    np.testing.assert_allclose(white.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(white.T), np.eye(3), atol=0.015)


def test_samples_come_from_the_components_by_their_weights() -> None:
    mixture = Mixture.checked([0.2, 0.0, 0.8], [[-9.0], [0.0], [9.0]], [[[1.0]]] * 3)
    samples = mixture.sample(100_000, np.random.default_rng(1))
    assert (samples < -4.0).mean() == pytest.approx(0.2, abs=0.005)
    assert not ((samples > -4.0) & (samples < 4.0)).any()


def test_the_same_draws_move_with_the_mixture() -> None:
    random = np.random.default_rng(2)
    uniform, normal = random.random(50), random.standard_normal((50, 3))
    mixture = random_mixture(random)
    moved = Mixture(mixture.weights, mixture.means_mm + 2.0, mixture.factors_per_mm)
    np.testing.assert_allclose(
        moved.placed(uniform, normal), mixture.placed(uniform, normal) + 2.0, atol=1e-9
    )


def test_weights_as_they_were_written_come_to_one() -> None:
    mixture = Mixture.checked([0.3333333, 0.3333333, 0.3333334], [[0.0]] * 3, [[[1.0]]] * 3)
    assert mixture.weights.sum() == pytest.approx(1.0, abs=1e-15)


EYE = np.eye(3).tolist()


@pytest.mark.parametrize(
    ("weights", "means", "factors", "told"),
    [
        ([], [], [], "weights: a list of 1 to 16"),
        ([1 / 17] * 17, [[0.0] * 3] * 17, [EYE] * 17, "weights: a list of 1 to 16"),
        ([1.0], [[0.0] * 3] * 2, [EYE], "means: 1 rows"),
        ([1.0], [[0.0] * 3], [[[1.0]]], r"factors: must be \(1, 3, 3\)"),
        ([1.0], [[0.0, np.nan, 0.0]], [EYE], r"means: the number at \(0, 1\) is not finite"),
        ([0.4, 0.4], [[0.0] * 3] * 2, [EYE] * 2, "together one; the sum is 0.8"),
        ([1.5, -0.5], [[0.0] * 3] * 2, [EYE] * 2, "none below zero"),
        ([1.0], [[0.0] * 3], [[[1, 0, 0], [1, 1, 0], [0, 0, 1]]], "not zero below its diagonal"),
        ([1.0], [[0.0] * 3], [[[1, 0, 0], [0, 0, 0], [0, 0, 1]]], "diagonal that is not positive"),
        ([1.0], [[0.0, "x", 0.0]], [EYE], "arrays of numbers"),
        ([1.0], [[0.0, 0.0], [0.0]], [EYE], "arrays of numbers"),
    ],
)
def test_what_is_no_mixture_is_refused_by_name(
    weights: list[float], means: list[list[float]], factors: list[list[list[float]]], told: str
) -> None:
    with pytest.raises(MixtureError, match=told):
        Mixture.checked(weights, means, factors)
