"""What the tip can be asked to follow, in the base sensor's frame."""

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from config.model import ConfigModel, NotNegative, Positive, Vector3
from config.options import checked_options

Cycles = Annotated[int, Field(ge=1)]
Plane = Literal["xy", "xz", "yz"]
Frequencies = Annotated[
    tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]],
    Field(strict=False),
]
Lengths = Annotated[tuple[NotNegative, NotNegative, NotNegative], Field(strict=False)]


class Periodic(ConfigModel):
    """What is repeated."""

    cycle_s: Positive
    """Time of one cycle."""
    cycles: Cycles = 1


class Rectangle(Periodic):
    """Round a rectangle at constant speed, its corners sharp. Begins at its lowest corner."""

    kind: Literal["rectangle"]
    center_mm: Vector3
    plane: Plane = "xy"
    """Width goes along the first of these axes and is gone along first, height along the second."""
    width_mm: Positive
    height_mm: Positive


class Circle(Periodic):
    """Round a circle at constant speed, from the first axis of its plane to the second."""

    kind: Literal["circle"]
    center_mm: Vector3
    plane: Plane = "xy"
    radius_mm: Positive


class Lissajous(Periodic):
    """Sines along x, y and z with whole numbers of periods per cycle."""

    kind: Literal["lissajous"]
    center_mm: Vector3
    amplitude_mm: Lengths
    frequencies: Frequencies = (1, 2, 0)
    phases_rad: Vector3 = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _moves(self) -> "Lissajous":
        pairs = zip(self.amplitude_mm, self.frequencies, strict=True)
        if not any(amplitude > 0 and frequency > 0 for amplitude, frequency in pairs):
            raise ValueError("nothing moves: no axis has both an amplitude and a frequency")
        return self


class Helix(Periodic):
    """Round a rising circle at constant speed in half a cycle, and back the same way."""

    kind: Literal["helix"]
    center_mm: Vector3
    """Middle of the lowest turn."""
    plane: Plane = "xy"
    radius_mm: Positive
    turns: Positive = 2.0
    rise_mm: float
    """Along the plane's normal, from one end to the other."""


class Waypoints(ConfigModel):
    """Straight lines between points, each with its time."""

    kind: Literal["waypoints"]
    file: Annotated[str, Field(min_length=1)]
    """CSV with the header `t, x, y, z` (s and mm), relative to the file that names it."""
    cycles: Cycles = 1
    """More than one: the last point must be the first."""


class Hold(ConfigModel):
    """Stay at a point."""

    kind: Literal["hold"]
    position_mm: Vector3
    duration_s: Positive


TrajectoryOptions = Annotated[
    Rectangle | Circle | Lissajous | Helix | Waypoints | Hold, Field(discriminator="kind")
]


class _Asked(ConfigModel):
    trajectory: TrajectoryOptions


def load_trajectory_options(mapping: dict[str, Any]) -> TrajectoryOptions:
    """The options in a message. Raises OptionsError with all problems."""
    return checked_options(_Asked, "trajectory", mapping).trajectory
