"""A robot: its axes, its tracker, the buses between, and what stands in when they are absent."""

from typing import Annotated

from pydantic import Field

from config.axis import Axis
from config.bus import Bus
from config.emulation import Emulation
from config.model import ConfigModel, Name
from config.tracker import Tracker


class Robot(ConfigModel):
    """One robot file."""

    robot: Name
    """Its name: part of every remote key and of every recording."""
    description: str = ""
    tracker: Tracker
    buses: Annotated[dict[Name, Bus], Field(min_length=1)]
    axes: Annotated[list[Axis], Field(min_length=1)]
    """In the order of the actuation vector u."""
    emulation: Emulation | None = None
