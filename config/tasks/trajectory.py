"""What the tip can be asked to follow, in the base sensor's frame."""

from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from config.documents.kinds import TRAJECTORIES, Kind, KindOptions, Named
from config.documents.model import ConfigModel, checked_options
from config.tasks.planned_path import PlannedPath

FARTHEST_MM: Final = 10_000.0
"""From the base sensor's origin: no tracker sees ten metres."""
LONGEST_S: Final = 2_592_000.0
"""A month. What lasts longer was meant otherwise."""
_SHORTEST_MM: Final = 0.01
"""Less than any tracker resolves."""
_MOST_TURNS: Final = 1000
_MOST_POINTS: Final = 100
_MOST_HARMONICS: Final = 50

Place = Annotated[float, Field(ge=-FARTHEST_MM, le=FARTHEST_MM)]
Point = Annotated[tuple[Place, Place, Place], Field(strict=False)]
Length = Annotated[float, Field(ge=_SHORTEST_MM, le=FARTHEST_MM)]
Amplitude = Annotated[float, Field(ge=0.0, le=FARTHEST_MM)]
Duration = Annotated[float, Field(ge=0.01, le=LONGEST_S)]
Turns = Annotated[int, Field(ge=0, le=_MOST_TURNS)]
Cycles = Annotated[int, Field(ge=1, le=1_000_000)]
Plane = Literal["xy", "xz", "yz"]
Frequencies = Annotated[tuple[Turns, Turns, Turns], Field(strict=False)]
Lengths = Annotated[tuple[Amplitude, Amplitude, Amplitude], Field(strict=False)]
Phases = Annotated[tuple[float, float, float], Field(strict=False)]
Row = (
    Annotated[tuple[float, float, float, float], Field(strict=False)]
    | Annotated[tuple[float, float, float, float, float, float, float], Field(strict=False)]
)


class FixedPointing(ConfigModel):
    """Always the same way."""

    kind: Literal["fixed"]
    direction: Point
    """Base sensor's frame; its length does not matter."""

    @model_validator(mode="after")
    def _goes_somewhere(self) -> "FixedPointing":
        if not any(self.direction):
            raise ValueError("the direction is a vector that is not zero")
        return self


class PointPointing(ConfigModel):
    """Towards a point, or away from it: as a tool that turns about an entry, or looks."""

    kind: Literal["towards", "away_from"]
    point_mm: Point
    """Not on the path."""


Pointing = Annotated[FixedPointing | PointPointing, Field(discriminator="kind")]


class Pointed(KindOptions):
    """A path, along which the tip may have to point somewhere."""

    pointing: Pointing | None = None
    """Where the tip's axis goes. None: anywhere."""


class Periodic(Pointed):
    """What is repeated."""

    cycle_s: Duration
    """Time of one cycle."""
    cycles: Cycles = 1


class Rectangle(Periodic):
    """Round a rectangle at constant speed, its corners sharp. Begins at its lowest corner."""

    kind: Literal["rectangle"]
    center_mm: Point
    plane: Plane = "xy"
    """Width goes along the first of these axes and is gone along first, height along the second."""
    width_mm: Length
    height_mm: Length


class Circle(Periodic):
    """Round a circle at constant speed, from the first axis of its plane to the second."""

    kind: Literal["circle"]
    center_mm: Point
    plane: Plane = "xy"
    radius_mm: Length


class Lissajous(Periodic):
    """Sines along x, y and z with whole numbers of periods per cycle."""

    kind: Literal["lissajous"]
    center_mm: Point
    amplitude_mm: Lengths
    frequencies: Frequencies = (1, 2, 0)
    phases_rad: Phases = (0.0, 0.0, 0.0)

    @model_validator(mode="after")
    def _moves(self) -> "Lissajous":
        pairs = zip(self.amplitude_mm, self.frequencies, strict=True)
        if not any(amplitude > 0 and frequency > 0 for amplitude, frequency in pairs):
            raise ValueError("nothing moves: no axis has both an amplitude and a frequency")
        return self


class Helix(Periodic):
    """Round a rising circle at constant speed in half a cycle, and back the same way."""

    kind: Literal["helix"]
    center_mm: Point
    """Middle of the lowest turn."""
    plane: Plane = "xy"
    radius_mm: Length
    turns: Annotated[float, Field(gt=0.0, le=_MOST_TURNS)] = 2.0
    rise_mm: Place
    """Along the plane's normal, from one end to the other."""


class Star(Periodic):
    """Round a star at constant speed, its corners sharp. Begins at the point on the first axis of
    its plane."""

    kind: Literal["star"]
    center_mm: Point
    plane: Plane = "xy"
    points: Annotated[int, Field(ge=3, le=_MOST_POINTS)] = 5
    radius_mm: Length
    """Of the circle through its points."""
    inner_radius_mm: Length
    """Of the circle through the corners between them."""

    @model_validator(mode="after")
    def _has_points(self) -> "Star":
        if self.inner_radius_mm >= self.radius_mm:
            raise ValueError("inner_radius_mm is smaller than radius_mm, or it is no star")
        return self


class RandomSmooth(Periodic):
    """A closed random curve without corners, at a speed that varies. The same seed gives the same
    curve."""

    kind: Literal["random_smooth"]
    center_mm: Point
    size_mm: Lengths
    """Of the box round it, along x, y and z."""
    harmonics: Annotated[int, Field(ge=1, le=_MOST_HARMONICS)] = 4
    """Sines along each coordinate: more make more bends."""
    seed: Annotated[int, Field(ge=0)] = 1

    @model_validator(mode="after")
    def _moves(self) -> "RandomSmooth":
        if not any(self.size_mm):
            raise ValueError("nothing moves: its size is 0 along all axes")
        return self


class Waypoints(Pointed):
    """Straight lines between points, each with its time."""

    kind: Literal["waypoints"]
    file: Annotated[str, Field(min_length=1)] | None = None
    """CSV with the header `t, x, y, z` (s and mm), relative to the file that names it. With
    `dx, dy, dz` behind it says where the tip points as well."""
    points: Annotated[tuple[Row, ...], Field(strict=False, fail_fast=True)] | None = None
    """The same rows here, instead of a file."""
    cycles: Cycles = 1
    """More than one: the last point must be the first."""

    @model_validator(mode="after")
    def _from_one_place(self) -> "Waypoints":
        if (self.file is None) == (self.points is None):
            raise ValueError("say either file or points")
        return self


class Hold(Pointed):
    """Stay at a point."""

    kind: Literal["hold"]
    position_mm: Point
    duration_s: Duration


class Planned(Pointed):
    """What `tentacled plan` has made: where the tip goes, and the axes with it."""

    kind: Literal["planned"]
    file: Annotated[str, Field(min_length=1)] | None = None
    """A path file, relative to the file that names it."""
    path: PlannedPath | None = None
    """What such a file holds, instead of it."""

    @model_validator(mode="after")
    def _from_one_place(self) -> "Planned":
        if (self.file is None) == (self.path is None):
            raise ValueError("say either file or path")
        if self.pointing is not None:
            raise ValueError("where the tip points stands in the path: plan it with --pointing")
        return self


# Each with the function that makes it: (options, base folder, cycles) → a cycle of
# daemon/reference/trajectories.py. Ours are in daemon/reference/shapes.py.

RECTANGLE: Final = Kind(Rectangle, "daemon.reference.shapes:rectangle")
CIRCLE: Final = Kind(Circle, "daemon.reference.shapes:circle")
LISSAJOUS: Final = Kind(Lissajous, "daemon.reference.shapes:lissajous")
HELIX: Final = Kind(Helix, "daemon.reference.shapes:helix")
STAR: Final = Kind(Star, "daemon.reference.shapes:star")
RANDOM_SMOOTH: Final = Kind(RandomSmooth, "daemon.reference.shapes:random_smooth")
WAYPOINTS: Final = Kind(Waypoints, "daemon.reference.shapes:waypoints")
HOLD: Final = Kind(Hold, "daemon.reference.shapes:hold")
PLANNED: Final = Kind(Planned, "daemon.reference.shapes:planned")

TrajectoryOptions = Annotated[Pointed, Named(TRAJECTORIES)]


class _Asked(ConfigModel):
    trajectory: TrajectoryOptions


def load_trajectory_options(mapping: dict[str, Any]) -> TrajectoryOptions:
    """The options in a message. Raises OptionsError with all problems."""
    return checked_options(_Asked, "trajectory", mapping).trajectory
