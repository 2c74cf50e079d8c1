"""What the peers share of the daemon's own way from a motion of the tip to one of the axes."""

from typing import TypeVar

import numpy as np

from config.tasks.controllers import AxisUse, TipFollowing
from drivers.pose import Vector

T = TypeVar("T", bound=TipFollowing)


def follower_options(options: AxisUse, of: type[T], **own: bool | float | None) -> T:
    """What a peer's options say that those `of` the daemon's own law know as well, with `own`."""
    common = type(options).model_fields.keys() & of.model_fields.keys()
    return of.model_validate({**{name: getattr(options, name) for name in common}, **own})


def within(vector: Vector, most: float) -> Vector:
    """The vector, as a whole no longer than `most`."""
    length = float(np.sqrt(vector @ vector))
    return vector if length <= most else np.asarray(vector * (most / length))
