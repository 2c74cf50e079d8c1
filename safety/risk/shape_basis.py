"""From a few coefficients to the body's centreline: a base and modes, as a fit has found them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from safety.risk.mixture import FloatArray

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
    """(n,) with what the fit leaves out, if that is to be on the safe side."""
    arc_mm: FloatArray
    """(n,) along the body, from its base."""

    @classmethod
    def checked(
        cls,
        base_mm: NDArray[Any],
        modes: NDArray[Any],
        radius_mm: NDArray[Any],
        arc_mm: NDArray[Any],
    ) -> "ShapeBasis":
        """A basis of arrays from anywhere. Raises ShapeBasisError."""
        base = np.ascontiguousarray(base_mm, np.float32)
        basis = cls(
            base,
            np.ascontiguousarray(modes, np.float32),
            np.ascontiguousarray(radius_mm, np.float32),
            np.ascontiguousarray(arc_mm, np.float64),
        )
        if base.ndim != 2 or len(base) < 2 or base.shape[1] != 3:
            raise ShapeBasisError(f"base_mm: must be (nodes, 3), two or more; it is {base.shape}")
        if basis.modes.ndim != 3 or not len(basis.modes) or basis.modes.shape[1:] != base.shape:
            raise ShapeBasisError(f"modes: must be (coefficients, {len(base)}, 3), as base_mm")
        for name in ("radius_mm", "arc_mm"):
            if getattr(basis, name).shape != (len(base),):
                raise ShapeBasisError(f"{name}: must be {len(base)} numbers, one per node")
        for name in ("base_mm", "modes", "radius_mm", "arc_mm"):
            if not np.isfinite(getattr(basis, name)).all():
                raise ShapeBasisError(f"{name}: must be finite")
        if not (basis.radius_mm > 0.0).all() or not (np.diff(basis.arc_mm) > 0.0).all():
            raise ShapeBasisError("radius_mm must be positive, and arc_mm must grow to the tip")
        return basis

    @property
    def coefficients(self) -> int:
        """d."""
        return len(self.modes)

    @property
    def nodes(self) -> int:
        """n."""
        return len(self.base_mm)
