"""Centrelines and the few coefficients that say which of them it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from safety.risk.shape_basis import ShapeBasis
from safety.risk.shape_fit import SPREAD_MM, coefficients_of, fit_shapes

RADIUS_MM = 12.0
FloatArray = NDArray[np.float64]


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
    fit = fit_shapes(arcs, RADIUS_MM, 6)
    again = shapes_of(fit.basis, fit.coefficients_mm)
    assert np.linalg.norm(again - arcs, axis=2).max() < 0.3
    assert fit.left_out_mm.max() < 0.8
    np.testing.assert_allclose(fit.basis.arc_mm[-1], 200.0, rtol=1e-3)


def test_every_coefficient_spreads_as_much() -> None:
    fit = fit_shapes(lines(400), RADIUS_MM, 5)
    np.testing.assert_allclose(fit.coefficients_mm.std(axis=0), SPREAD_MM, rtol=1e-6)


def test_what_the_modes_leave_out_makes_the_body_thicker() -> None:
    arcs = lines(600, noise_mm=0.5)
    fits = [fit_shapes(arcs, RADIUS_MM, count) for count in (2, 6)]
    assert (fits[0].left_out_mm[10:] > 1.5 * fits[1].left_out_mm[10:]).all()
    for fit in fits:
        again = shapes_of(fit.basis, fit.coefficients_mm)
        outside = np.linalg.norm(again - arcs, axis=2) > fit.basis.left_out_mm
        assert outside.mean() <= 0.001


def test_an_arc_stands_out_from_its_chords_no_further_than_the_radius_says() -> None:
    angle = np.linspace(0.0, 2.0, 11)
    arc = np.stack([100.0 * (1 - np.cos(angle)), 0 * angle, 100.0 * np.sin(angle)], axis=1)
    bent = np.stack([arc * (1 + 1e-6 * k) for k in range(8)])
    fit = fit_shapes(bent, RADIUS_MM, 1)
    height = 100.0 * (1.0 - np.cos(0.1))
    assert (fit.left_out_mm >= 0.99 * height).all()
    assert (fit.left_out_mm < 1.2 * height + 1e-3).all()


def test_coefficients_of_other_shapes_are_found() -> None:
    fit, others = fit_shapes(lines(400), RADIUS_MM, 6), lines(50, seed=7)
    found = coefficients_of(fit.basis, others)
    again = shapes_of(fit.basis, found)
    assert np.linalg.norm(again - others, axis=2).max() < 0.5
    np.testing.assert_allclose(
        coefficients_of(fit.basis, lines(400))[:9], fit.coefficients_mm[:9], atol=1e-2
    )


def test_shapes_that_are_all_alike_have_no_coefficients() -> None:
    with pytest.raises(ValueError, match="less than 2 coefficients"):
        fit_shapes(np.ones((9, 21, 1)) * np.arange(3.0), RADIUS_MM, 2)
    with pytest.raises(ValueError, match="3 shapes of 21 nodes do not make 4 coefficients"):
        fit_shapes(lines(3), RADIUS_MM, 4)
