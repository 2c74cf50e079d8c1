"""Turns a step aside that would bring the body too near to something: then it goes along it.

The clearance that is left, h, may only get less as fast as it is large: Δh ≥ −γ (h − h₀). Of all
steps that keep to it the one nearest to the wanted is taken, each axis counted by its speed (a
control barrier function). It decides nothing: what comes out is a proposal, which the gate judges
as any.
"""

from typing import Final

import numpy as np

from drivers.pose import Vector
from safety.risk_source import Clearance

_RESERVE_MM: Final = 0.5
"""h₀: the gate counts the way there too, and braking."""
_CLOSER_PER_S: Final = 4.0
"""γ."""
_LEAST_SLOPE_MM_S: Final = 1.0
"""With all axes at full speed. Where less clearance is gained by that, there is no way along."""


def avoid(
    delta_u: Vector, targets: Vector, clearance: Clearance, max_velocity: Vector, dt_s: float
) -> Vector | None:
    """The step to take in place of (m,) delta_u from (m,) targets; None: it may stay as it is."""
    slope = np.array(clearance.slope)
    here_mm = clearance.clearance_mm + float(slope @ (targets - np.array(clearance.u)))
    change_mm = float(slope @ delta_u)
    allowed_mm = -min(1.0, _CLOSER_PER_S * dt_s) * (here_mm - _RESERVE_MM)
    steepest = slope * max_velocity
    square = float(steepest @ steepest)
    if change_mm >= allowed_mm or square < _LEAST_SLOPE_MM_S**2:
        return None
    aside: Vector = delta_u + (allowed_mm - change_mm) / square * steepest * max_velocity
    return aside
