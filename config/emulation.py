"""What stands in for the hardware when there is none. A real rig ignores this part."""

from typing import Annotated

from pydantic import Field

from config.emulated_drives import EmulatedDrives
from config.emulated_plants import Plant
from config.emulated_tracker import EmulatedTracker
from config.model import ConfigModel, NotNegative, Positive


class Emulation(ConfigModel):
    """The emulated lab around this robot."""

    plant: Plant
    tracker: EmulatedTracker
    drives: EmulatedDrives = EmulatedDrives()
    seed: Annotated[int, Field(ge=0)] = 0
    plant_period_s: Positive = 0.025
    """Time between two solutions of the body's statics."""
    tip_load_g: NotNegative = 0.0
