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
    patience_s: NotNegative = 0.4
    """In real time the daemon and the emulated drives wait at least this long for each other before
    one takes the other for lost: on a busy computer a program may stand still for tenths of a
    second. It holds for buses whose channel is one of the lab; 0: the times of a rig hold there
    too."""
    plant_period_s: Positive = 0.025
    """Time between two solutions of the body's statics."""
    tip_load_g: NotNegative = 0.0
