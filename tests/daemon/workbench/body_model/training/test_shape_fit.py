"""Centrelines and the few coefficients that say which of them it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from daemon.workbench.body_model.training.shape_fit import ShapeFit, coefficients_of, fit_shapes
from safety.risk.model.shape_basis import ShapeBasis

RADIUS_MM = 12.0
FloatArray = NDArray[np.float64]


STARTS = 4


def fitted(shapes_mm: FloatArray, coefficients: int) -> ShapeFit:
    """In groups that have nothing in common."""
    groups = shapes_mm.reshape(-1, STARTS, *shapes_mm.shape[1:])
    return fit_shapes(groups, RADIUS_MM, coefficients)


def lines(count: int, seed: int = 1, noise_mm: float = 0.0) -> FloatArray:
    """(count, 21, 3) arcs of 200 mm, bent by up to 1 rad in any direction."""
    random = np.random.default_rng(seed)
    angle = random.uniform(0.05, 1.0, count)[:, None] * np.linspace(0.0, 1.0, 21)
    way = random.uniform(0.0, 2.0 * np.pi, (count, 1))
    radius = 200.0 / angle[:, -1:]
    out = radius * (1.0 - np.cos(angle))
    made = np.stack([out * np.cos(way), out * np.sin(way), radius * np.sin(angle)], axis=2)
    return np.asarray(made + noise_mm * random.standard_normal(made.shape))


def shapes_of(basis: ShapeBasis, coefficients: FloatArray) -> FloatArray:
    return np.asarray(basis.base_mm + np.tensordot(coefficients, basis.modes, axes=1), np.float64)


def test_few_coefficients_are_all_of_a_smooth_body() -> None:
    arcs = lines(400)
    fit = fitted(arcs, 6)
    again = shapes_of(fit.basis, fit.coefficients_mm.reshape(len(arcs), -1))
    assert np.linalg.norm(again - arcs, axis=2).max() < 0.3
    assert fit.left_out_mm.max() < 0.8
    np.testing.assert_allclose(fit.basis.arc_mm[-1], 200.0, rtol=1e-3)


def alike(groups: int, spread_mm: float) -> FloatArray:
    """(groups, 6, 21, 3) bent further and further to one side; in each group, a little aside."""
    random = np.random.default_rng(3)
    arc = np.linspace(0.0, 1.0, 21)
    far = np.linspace(0.0, 50.0, groups)[:, None] + spread_mm * random.normal(size=(groups, 6))
    aside = spread_mm * random.normal(size=(groups, 6))
    made = np.zeros((groups, 6, 21, 3))
    made[..., 0], made[..., 1] = far[..., None] * arc**2, aside[..., None] * arc**3
    made[..., 2] = 200.0 * arc
    return made


def test_coefficients_spread_evenly_where_the_actuation_is_the_same() -> None:
    fit = fit_shapes(alike(300, 1.0), RADIUS_MM, 2)
    apart = fit.coefficients_mm - fit.coefficients_mm.mean(axis=1, keepdims=True)
    within = np.einsum("nsi,nsj->ij", apart, apart) / (300 * 5)
    np.testing.assert_allclose(within, np.eye(2), atol=0.05)
    over_all = np.cov(fit.coefficients_mm.reshape(-1, 2).T)
    np.testing.assert_allclose(over_all[0, 1], 0.0, atol=1e-6)
    assert over_all[0, 0] > 100.0 * over_all[1, 1]


@pytest.mark.parametrize("starts", [1, 6])
def test_what_is_always_the_same_does_not_make_coefficients_endless(starts: int) -> None:
    same = np.repeat(alike(300, 1.0)[:, :1], starts, axis=1)
    fit = fit_shapes(same, RADIUS_MM, 2)
    np.testing.assert_allclose(fit.coefficients_mm.std(axis=(0, 1)), 100.0, rtol=0.01)


def test_what_the_modes_leave_out_makes_the_body_thicker() -> None:
    arcs = lines(600, noise_mm=0.5)
    fits = [fitted(arcs, count) for count in (2, 6)]
    assert (fits[0].left_out_mm[10:] > 1.5 * fits[1].left_out_mm[10:]).all()
    for fit in fits:
        again = shapes_of(fit.basis, fit.coefficients_mm.reshape(len(arcs), -1))
        outside = np.linalg.norm(again - arcs, axis=2) > fit.basis.left_out_mm
        assert outside.mean() <= 0.001


def test_what_the_centrelines_are_off_makes_the_body_thicker() -> None:
    arcs = lines(600, noise_mm=0.5)
    error_mm = np.linspace(0.0, 0.4, arcs.shape[1])
    fits = [fit_shapes(arcs[:, None], RADIUS_MM, 6, each) for each in (None, error_mm)]
    thicker = fits[1].left_out_mm - fits[0].left_out_mm
    # A miss both ways alike, of this root mean square, is larger one time in twenty.
    off = np.linalg.norm(np.random.default_rng(3).normal(size=(100_000, 2)), axis=1) / np.sqrt(2.0)
    np.testing.assert_allclose(thicker, np.quantile(off, 0.95) * error_mm, rtol=0.02)


def test_an_arc_stands_out_from_its_chords_no_further_than_the_radius_says() -> None:
    angle = np.linspace(0.0, 2.0, 11)
    arc = np.stack([100.0 * (1 - np.cos(angle)), 0 * angle, 100.0 * np.sin(angle)], axis=1)
    bent = np.stack([arc * (1 + 1e-6 * k) for k in range(8)])
    fit = fitted(bent, 1)
    height = 100.0 * (1.0 - np.cos(0.1))
    assert (fit.left_out_mm >= 0.99 * height).all()
    assert (fit.left_out_mm < 1.2 * height + 1e-3).all()


def test_coefficients_of_other_shapes_are_found() -> None:
    fit, others = fitted(lines(400), 6), lines(50, seed=7)
    found = coefficients_of(fit.basis, others)
    again = shapes_of(fit.basis, found)
    assert np.linalg.norm(again - others, axis=2).max() < 0.5
    np.testing.assert_allclose(
        coefficients_of(fit.basis, lines(400))[:8].reshape(2, 4, 6),
        fit.coefficients_mm[:2],
        atol=1e-2,
    )


def test_shapes_that_are_all_alike_have_no_coefficients() -> None:
    with pytest.raises(ValueError, match="less than 2 coefficients"):
        fitted(np.ones((8, 21, 1)) * np.arange(3.0), 2)
    with pytest.raises(ValueError, match="4 shapes of 21 nodes do not make 4 coefficients"):
        fitted(lines(4), 4)
