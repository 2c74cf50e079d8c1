"""From a few coefficients to the body's centreline: a base and modes, as a fit has found them."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safety.risk.model.mixture import FloatArray

SingleArray = NDArray[np.float32]


class ShapeBasisError(ValueError):
    """Arrays that are no basis of shapes. Says which, and what is wrong."""


@dataclass(frozen=True, slots=True, eq=False)
class ShapeBasis:
    """A centreline is base + Σ coefficient · mode; round it the body has its radius at each node.

    Made by `checked`. Coefficients are in mm, so that a mixture over them is like one over places.
    """

    base_mm: SingleArray
    """(n, 3) from base to tip."""
    modes: SingleArray
    """(d, n, 3) mm per mm."""
    radius_mm: SingleArray
    """(n,) of the body."""
    left_out_mm: SingleArray
    """(n,) how far the centreline of a true body may be off."""
    arc_mm: FloatArray
    """(n,) along the body, from its base."""

    @classmethod
    def checked(
        cls,
        base_mm: NDArray[Any],
        modes: NDArray[Any],
        radius_mm: NDArray[Any],
        left_out_mm: NDArray[Any],
        arc_mm: NDArray[Any],
    ) -> "ShapeBasis":
        """A basis of arrays from anywhere. Raises ShapeBasisError."""
        base = np.ascontiguousarray(base_mm, np.float32)
        basis = cls(
            base,
            np.ascontiguousarray(modes, np.float32),
            np.ascontiguousarray(radius_mm, np.float32),
            np.ascontiguousarray(left_out_mm, np.float32),
            np.ascontiguousarray(arc_mm, np.float64),
        )
        if base.ndim != 2 or len(base) < 2 or base.shape[1] != 3:
            raise ShapeBasisError(f"base_mm: must be (nodes, 3), two or more; it is {base.shape}")
        if basis.modes.ndim != 3 or not len(basis.modes) or basis.modes.shape[1:] != base.shape:
            raise ShapeBasisError(f"modes: must be (coefficients, {len(base)}, 3), as base_mm")
        for name in ("radius_mm", "left_out_mm", "arc_mm"):
            if getattr(basis, name).shape != (len(base),):
                raise ShapeBasisError(f"{name}: must be {len(base)} numbers, one per node")
        for name in ("base_mm", "modes", "radius_mm", "left_out_mm", "arc_mm"):
            if not np.isfinite(getattr(basis, name)).all():
                raise ShapeBasisError(f"{name}: must be finite")
        if not (basis.radius_mm > 0.0).all() or not (np.diff(basis.arc_mm) > 0.0).all():
            raise ShapeBasisError("radius_mm must be positive, and arc_mm must grow to the tip")
        if not (basis.left_out_mm >= 0.0).all():
            raise ShapeBasisError("left_out_mm must not be negative")
        return basis

    @property
    def coefficients(self) -> int:
        """d."""
        return len(self.modes)

    @property
    def thickest_mm(self) -> float:
        """The largest radius, with the most that is left out."""
        return float(self.radius_mm.max() + self.left_out_mm.max())

    def on_the_safe_side(self) -> "ShapeBasis":
        """The same as thick as it may be taken to be."""
        thicker = self.radius_mm + self.left_out_mm
        return replace(self, radius_mm=thicker, left_out_mm=np.zeros_like(thicker))

    def leaving_out(self, share: float) -> "ShapeBasis":
        """The same with so much of what a true body may be off by."""
        return replace(self, left_out_mm=(share * self.left_out_mm).astype(np.float32))

    @property
    def nodes(self) -> int:
        """n."""
        return len(self.base_mm)
