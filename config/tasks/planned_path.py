"""A planned path, as its file holds it: places of the axes with their times, and for what body.

It is JSON: `tentacled plan` writes it, experiments and `tentacled load` read it. What it was
planned with stands in it, since for another body, or among other things, it is no plan.
"""

from math import isfinite
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from config.documents.model import ConfigModel, Name

MOST_PLACES: Final = 20_000
_FARTHEST: Final = 1e4
"""mm and rad; as trajectories have it."""
_LONGEST_S: Final = 2_592_000.0

Number = Annotated[float, Field(ge=-_FARTHEST, le=_FARTHEST)]
Place = Annotated[tuple[Number, Number, Number], Field(strict=False)]
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Times = Annotated[
    tuple[Annotated[float, Field(ge=0.0, le=_LONGEST_S)], ...],
    Field(strict=False, min_length=2, max_length=MOST_PLACES, fail_fast=True),
]
Rows = Annotated[
    tuple[Annotated[tuple[Number, ...], Field(strict=False, min_length=1, fail_fast=True)], ...],
    Field(strict=False, fail_fast=True),
]
Places = Annotated[tuple[Place, ...], Field(strict=False, fail_fast=True)]
"""Of so many rows the first wrong one is told: to tell of all takes seconds."""


class PlannedPath(ConfigModel):
    """One path. Axes in mm or rad, places in mm in the base sensor's frame, times in s from 0."""

    tentacled_path: Literal[1]
    """The format."""
    robot: Name
    axes: Annotated[tuple[str, ...], Field(strict=False, min_length=1)]
    model_sha256: Digest
    """Of the file of the body's model."""
    surroundings_sha256: Digest
    """Of triangles, their free side and the port."""
    t_s: Times
    u: Rows
    """The axes at each time, in the order of `axes`."""
    tip_mm: Places
    """Where the model has the tip at each time."""
    direction: Places | None = None
    """Where its end points, where it was asked to point somewhere. None: it may point anywhere."""
    figures: dict[str, Any] = Field(default_factory=dict)
    """For people: risk, clearance, length."""

    @model_validator(mode="after")
    def _of_one_length(self) -> "PlannedPath":
        count = len(self.t_s)
        for name in ("u", "tip_mm", "direction"):
            rows = getattr(self, name)
            if rows is not None and len(rows) != count:
                raise ValueError(f"{name} has {len(rows)} rows, and t_s has {count}")
        for row in self.u:
            if len(row) != len(self.axes):
                raise ValueError(f"u has a row of {len(row)}, and there are {len(self.axes)} axes")
        if self.t_s[0] != 0.0 or any(b <= a for a, b in zip(self.t_s, self.t_s[1:], strict=False)):
            raise ValueError("t_s must rise from 0")
        for row in self.direction or ():
            if not isfinite(length := sum(x * x for x in row)) or not length > 1e-12:
                raise ValueError("a direction must be a vector that is not zero")
        return self
