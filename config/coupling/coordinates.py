"""Coordinates: as many numbers as there are axes, of which the axes' positions are sums.

Concentric tubes are turned and pushed against each other, while each motor turns or pushes one:
what shapes the body, and what a model of it sees, is a difference of axes. The map is constant,

    u = M (q − q₀),

with u the axes' positions, q the coordinates, and q₀ what they are where every axis is at its zero.
"""

from collections.abc import Iterator, Mapping, Sequence
from math import pi
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from config.documents.model import ConfigModel, Name
from config.documents.problems import did_you_mean
from config.documents.yaml_document import Location

Moves = Annotated[dict[Name, float], Field(min_length=1)]

_SMALLEST_PIVOT: Final = 1e-9
"""Of the largest number of its column: what rounding leaves of zero is far below it."""


class CoordinateBase(ConfigModel):
    """One number q, in mm or rad as `unit` says."""

    unit: ClassVar[Literal["mm", "rad"]]

    name: Name
    moves: Moves
    """How far each axis goes when this coordinate alone grows by one: `{rotation_2: 1.0}`. Axes
    that are not named stand still."""

    @property
    def at_zero(self) -> float:
        """Its value where every axis is at its zero, in its unit."""
        return 0.0

    @property
    def period(self) -> float | None:
        """After how much the body comes round to the same shape; None: it does not."""
        return None


class AngleCoordinate(CoordinateBase):
    """An angle."""

    unit = "rad"

    kind: Literal["angle"]
    at_zero_rad: float = 0.0
    """Its value where every axis is at its zero."""
    comes_round: bool = False
    """Whether the body has the same shape again after a whole turn. Only models of the body may
    take it modulo a turn: axes, velocities and following errors count on."""

    @property
    def at_zero(self) -> float:
        return self.at_zero_rad

    @property
    def period(self) -> float | None:
        return 2.0 * pi if self.comes_round else None


class LengthCoordinate(CoordinateBase):
    """A length."""

    unit = "mm"

    kind: Literal["length"]
    at_zero_mm: float = 0.0
    """Its value where every axis is at its zero."""

    @property
    def at_zero(self) -> float:
        return self.at_zero_mm


Coordinate = Annotated[AngleCoordinate | LengthCoordinate, Field(discriminator="kind")]


def coordinate_findings(
    coordinates: Sequence[CoordinateBase | None], units: Mapping[str, str] | None
) -> Iterator[tuple[Location, str]]:
    """What cannot be between coordinates and axes: where in the file, and a sentence about it.

    None stands for a coordinate that is unsound by itself. units: of the axes by their names, in
    the order of u; None while not all of them are sound.
    """
    seen: set[str] = set()
    sound = True
    for index, coordinate in enumerate(coordinates):
        if coordinate is None:
            sound = False
            continue
        at = ("coordinates", index)
        if coordinate.name in seen:
            yield (*at, "name"), f"there is already a coordinate '{coordinate.name}'"
        if units is not None and coordinate.name in units:
            yield (*at, "name"), f"there is already an axis '{coordinate.name}'"
        seen.add(coordinate.name)
        found = [] if units is None else list(_moves_findings(at, coordinate, units))
        sound = sound and not found
        yield from found
    if sound and coordinates and units is not None:
        yield from _map_findings([one for one in coordinates if one is not None], list(units))


def _moves_findings(
    at: Location, coordinate: CoordinateBase, units: Mapping[str, str]
) -> Iterator[tuple[Location, str]]:
    for name, factor in coordinate.moves.items():
        place = (*at, "moves", name)
        if name not in units:
            yield place, f"there is no axis '{name}'{did_you_mean(name, units)}"
        elif units[name] != coordinate.unit:
            yield (
                place,
                f"'{name}' is in {units[name]}, and '{coordinate.name}' in {coordinate.unit}: "
                f"{'an angle' if coordinate.unit == 'rad' else 'a length'} moves axes of its unit",
            )
        if factor == 0.0:
            yield place, "0 moves nothing: leave it out"


def _map_findings(
    coordinates: Sequence[CoordinateBase], names: Sequence[str]
) -> Iterator[tuple[Location, str]]:
    """Each position of the axes must be that of exactly one set of coordinates."""
    at: Location = ("coordinates",)
    if len(coordinates) != len(names):
        yield at, f"{len(coordinates)} coordinates cannot say where {len(names)} axes are"
        return
    rows = [[one.moves.get(name, 0.0) for one in coordinates] for name in names]
    for name, row in zip(names, rows, strict=True):
        if not any(row):
            yield at, f"none of them moves the axis '{name}'"
            return
    undetermined = _undetermined(rows)
    if undetermined is not None:
        text = f"'{coordinates[undetermined].name}' moves the axes as the others do together"
        yield (*at, undetermined, "moves"), f"{text}: nobody could tell them apart"


def _undetermined(rows: list[list[float]]) -> int | None:
    """The first column that is a sum of those before it (Gauss, with pivoting), or None."""
    rows = [row[:] for row in rows]
    for column in range(len(rows)):
        largest = max(abs(row[column]) for row in rows)
        pivot = max(range(column, len(rows)), key=lambda row: abs(rows[row][column]))
        if abs(rows[pivot][column]) <= _SMALLEST_PIVOT * largest:
            return column
        rows[column], rows[pivot] = rows[pivot], rows[column]
        for row in rows[column + 1 :]:
            share = row[column] / rows[column][column]
            for k in range(column, len(rows)):
                row[k] -= share * rows[column][k]
    return None
