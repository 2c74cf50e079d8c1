"""What hangs on a tip, as a force; and numbers as error messages show them."""

from collections.abc import Sequence

import numpy as np

from sim_backends.plants.plant import FloatArray, PlantError, TipLoad

GRAVITY_N_G = 9.80665e-3
"""Weight in N of one gram."""


def tip_force(load: TipLoad, down: FloatArray, most_n: float) -> FloatArray:
    """(3,) N of a load, with gravity along the unit vector `down`.

    most_n: what the body's axial stiffness bears. Raises PlantError for more, and for a load that
    makes no sense.
    """
    force = np.array(load.force_n, dtype=np.float64)
    if not 0.0 <= load.mass_g < np.inf or force.shape != (3,) or not np.isfinite(force).all():
        raise PlantError(f"there is no load of {load.mass_g} g and {load.force_n} N")
    weight_n = GRAVITY_N_G * load.mass_g
    if max(weight_n, float(np.abs(force).max())) > most_n:
        raise PlantError(
            f"{load.mass_g:g} g and {listed(load.force_n)} N at the tip are more than the arm can "
            f"bear ({most_n:g} N)"
        )
    return np.asarray(force + weight_n * down)


def listed(values: Sequence[float] | FloatArray) -> str:
    """As `[1, 2.5]`."""
    return "[" + ", ".join(f"{value:g}" for value in np.asarray(values)) + "]"
