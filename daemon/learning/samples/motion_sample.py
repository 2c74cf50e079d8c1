"""What one motion did: the thing that all learnt models of the robot are made from."""

from typing import NamedTuple

from drivers.pose import Vector


class MotionSample(NamedTuple):
    """From (p, u) the axes moved by Δu, and the tip by Δp (Ho 2018, §2.2). All observed."""

    tip_mm: Vector
    """(3,) p: where the tip was when the motion began."""
    u: Vector
    """(m,) u: where the axes were, mm or rad."""
    delta_u: Vector
    """(m,) Δu."""
    delta_tip_mm: Vector
    """(3,) Δp."""
