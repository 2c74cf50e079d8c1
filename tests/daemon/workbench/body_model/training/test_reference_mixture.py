"""The mixture of one cloud by itself: what EM finds where the answer is known."""

import numpy as np
import pytest

from daemon.workbench.body_model.training.reference_mixture import reference_mixture
from safety.risk.model.mixture import Mixture


def three() -> Mixture:
    means = [[0.0, 0.0, 0.0], [30.0, 0.0, 10.0], [0.0, 25.0, 60.0]]
    factors = [
        np.diag(1.0 / np.array(s)) for s in ((2.0, 3.0, 4.0), (5.0, 2.0, 2.0), (3.0, 3.0, 9.0))
    ]
    factors[1][0, 2] = 0.1
    return Mixture.checked([0.5, 0.2, 0.3], means, factors)


def test_it_finds_the_mixture_that_points_were_drawn_of() -> None:
    true = three()
    points = true.sample(4000, np.random.default_rng(3))
    found = reference_mixture(points, 3, seed=1)
    order = [int(np.linalg.norm(found.means_mm - mean, axis=1).argmin()) for mean in true.means_mm]
    assert sorted(order) == [0, 1, 2]
    np.testing.assert_allclose(found.weights[order], true.weights, atol=0.03)
    np.testing.assert_allclose(found.means_mm[order], true.means_mm, atol=0.6)
    better = found.log_density(points).mean() - true.log_density(points).mean()
    assert 0.0 <= better < 0.01


def test_one_component_is_mean_and_covariance() -> None:
    points = np.random.default_rng(1).normal(size=(500, 3)) * [1.0, 5.0, 9.0] + 100.0
    found = reference_mixture(points, 1, seed=1, thinnest_mm=1e-3)
    covariance = np.linalg.inv(found.factors_per_mm[0].T @ found.factors_per_mm[0])
    np.testing.assert_allclose(found.means_mm[0], points.mean(axis=0), rtol=1e-9)
    np.testing.assert_allclose(covariance, np.cov(points.T, bias=True), rtol=1e-3)


def test_nothing_gets_thinner_than_it_may() -> None:
    flat = np.random.default_rng(2).normal(size=(300, 3)) * [10.0, 10.0, 0.0]
    found = reference_mixture(flat, 2, seed=1, thinnest_mm=0.5)
    for factor in found.factors_per_mm:
        spread = np.sqrt(np.linalg.eigvalsh(np.linalg.inv(factor.T @ factor)))
        assert spread.min() >= 0.5 - 1e-9


def test_more_components_fit_no_worse_and_a_seed_is_a_fit() -> None:
    points = three().sample(1500, np.random.default_rng(5))
    nll = [-reference_mixture(points, k, seed=4).log_density(points).mean() for k in (1, 2, 3, 5)]
    assert nll == sorted(nll, reverse=True)
    one, same = (reference_mixture(points, 4, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.means_mm, same.means_mm)


def test_too_few_points_are_refused() -> None:
    with pytest.raises(ValueError, match="12 points are too few for 3 components"):
        reference_mixture(np.zeros((12, 3)), 3, seed=1)
