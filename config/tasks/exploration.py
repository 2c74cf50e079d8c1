"""What can be set on motions that are made to learn from."""

from typing import Annotated, Final, Literal

from pydantic import Field

from config.documents.kinds import KindOptions
from config.documents.model import ConfigModel, NotNegative, Positive

Share = Annotated[float, Field(gt=0.0, le=1.0)]

_SHORTEST_S: Final = 16.0
"""With six axes: an arm is then followed as well as after minutes. One of seven, explored for that
long, was 2.7 mm off in its first round, and one of ten 1.1 mm; for 21 and 39 s, 0.3 and 0.4 mm."""


class RandomMotion(ConfigModel):
    """Straight lines between random places of the axes, and a dither on top."""

    speed_share: Share = 0.9
    """Of the axes' highest speed, for the fastest axis of a line. Its dither may add to it, up to
    what the axis can do."""

    dither_share: Annotated[float, Field(ge=0.0, le=0.25)] = 0.03
    """Amplitude of each axis' dither, as a share of its travel. Without it all steps of a line go
    the same way, and a receptive field sees few directions."""

    together_share: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05
    """How much is left of what all tendons would do together: they pull against each other, and
    would tear or go slack. Of other axes all is left."""

    dither_period_s: Positive = 2.0
    """Of the first axis; the others' are up to twice as long, and no two are the same."""


class Exploration(RandomMotion):
    """What explorations have in common: lines between places of the axes, and walls."""

    travel_share: Share = 1.0
    """Places are from this share of each axis' travel, in its middle."""

    wall_mm: NotNegative = 5.0
    """So near to a wall of the workspace the tip turns back."""


class WaypointExploration(Exploration, KindOptions):
    """Goes through the whole of the axes' travel, as far as the tip stays in its workspace."""

    kind: Literal["waypoint_exploration"]

    waypoints: Annotated[int, Field(ge=1, le=100_000)] = 80

    home_every: Annotated[int, Field(ge=0)] = 8
    """Every so many lines one leads home, to where the first began: often a corner of the travel,
    which random places are hardly ever near, and where whoever goes by the model begins. 0: none
    does, as in Ho 2018. With one line of 80 that touches home a cubic's Jacobian makes there of a
    wanted motion one of 120 % of it beside it; with ten ways there and back one of 40 %, and
    elsewhere it is as it was."""


class DesignedExploration(Exploration, KindOptions):
    """Goes from wherever it is to where most is learnt on the way, in ever more of the travel."""

    kind: Literal["designed_exploration"]

    duration_s: Annotated[float, Field(ge=2.0, le=3600.0)] | None = None
    """How long it moves. Pauses do not count. None: 16 s with up to six axes, and longer with more:
    21 s with seven, 39 s with ten."""

    travel_share: Share = 0.4

    speed_share: Share = 0.95

    dither_share: Annotated[float, Field(ge=0.0, le=0.25)] = 0.0
    """Lines go in ever new directions by themselves."""

    def lasts_s(self, axes: int) -> float:
        """How long so many axes move: as long as said, or as what is to be found is much."""
        if self.duration_s is not None:
            return self.duration_s
        return _SHORTEST_S * max(1.0, _of_quadratic(axes) / _of_quadratic(6))


def _of_quadratic(axes: int) -> float:
    """How many coefficients the tip's place has along each coordinate."""
    return 0.5 * axes * (axes + 3)


class MotorBabbling(RandomMotion):
    """Small random motions, from which a controller that knows nothing learns its first model."""

    reach_share: Annotated[float, Field(gt=0.0, le=0.25)] = 0.05
    """How far each axis goes from where it was, as a share of its travel. Where the tip goes too
    little to be learnt from, and visibly by the axes, twice as far, up to 0.25; where it goes far
    or fast, half as far and half as fast."""

    duration_s: Positive = 20.0
