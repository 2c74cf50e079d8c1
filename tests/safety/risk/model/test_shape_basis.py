"""A basis of shapes: what is refused, by name."""

import numpy as np
import pytest
from numpy.typing import NDArray

from safety.risk.model.shape_basis import ShapeBasis, ShapeBasisError

SOUND = {
    "base_mm": np.zeros((4, 3)),
    "modes": np.zeros((2, 4, 3)),
    "radius_mm": np.ones(4),
    "left_out_mm": np.zeros(4),
    "arc_mm": np.arange(4.0),
}


def test_a_sound_basis_says_its_sizes() -> None:
    basis = ShapeBasis.checked(**SOUND)
    assert (basis.coefficients, basis.nodes) == (2, 4)


def test_on_the_safe_side_it_is_as_thick_as_it_may_be() -> None:
    basis = ShapeBasis.checked(**(SOUND | {"left_out_mm": np.array([0.0, 0.5, 0.0, 2.0])}))
    safe = basis.on_the_safe_side()
    assert safe.radius_mm.tolist() == [1.0, 1.5, 1.0, 3.0]
    assert safe.left_out_mm.tolist() == [0.0] * 4
    assert basis.thickest_mm == safe.thickest_mm == 3.0


@pytest.mark.parametrize(
    ("name", "array", "told"),
    [
        ("base_mm", np.zeros((1, 3)), "base_mm: must be"),
        ("base_mm", np.zeros((4, 2)), "base_mm: must be"),
        ("modes", np.zeros((2, 5, 3)), r"modes: must be \(coefficients, 4, 3\)"),
        ("modes", np.zeros((0, 4, 3)), "modes: must be"),
        ("modes", np.full((2, 4, 3), np.inf), "modes: must be finite"),
        ("radius_mm", np.ones(3), "radius_mm: must be 4 numbers"),
        ("left_out_mm", np.zeros(3), "left_out_mm: must be 4 numbers"),
        ("left_out_mm", np.array([0.0, -1.0, 0.0, 0.0]), "left_out_mm must not be negative"),
        ("radius_mm", np.array([1.0, 1.0, 0.0, 1.0]), "radius_mm must be positive"),
        ("arc_mm", np.array([0.0, 1.0, 1.0, 2.0]), "arc_mm must grow"),
        ("arc_mm", np.array([0.0, 1.0, np.nan, 2.0]), "arc_mm: must be finite"),
    ],
)
def test_arrays_that_make_no_basis_are_refused(
    name: str, array: NDArray[np.float64], told: str
) -> None:
    with pytest.raises(ShapeBasisError, match=told):
        ShapeBasis.checked(**(SOUND | {name: array}))
