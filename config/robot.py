"""A robot: its axes, its tracker, the buses between, and what stands in when they are absent."""

from typing import Annotated

from pydantic import Field

from config.axis import Axis
from config.bus import Bus
from config.control import PoseFilterSettings, RiskSettings, Supervision, Workspace
from config.coupling.coordinates import Coordinate
from config.coupling.limits import CoupledLimit
from config.documents.model import ConfigModel, Name
from config.emulation.lab import Emulation
from config.remote import Remote
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
    coordinates: list[Coordinate] = Field(default_factory=list)
    """What controllers and models may see instead of the axes, as many of them: sums of axes such
    as an angle between two tubes. None: the axes themselves."""
    coupled_limits: list[CoupledLimit] = Field(default_factory=list)
    """What several axes may not do together, each a bound on a sum of axes or coordinates: the gate
    keeps them."""
    homing_order: list[Annotated[list[Name], Field(min_length=1)]] | None = None
    """Which axes look for their zeros together, and which groups of them after which:
    `[[rotation_1, rotation_2], [carriage_1]]`. None: one after the other, in the order of u."""
    workspace: Workspace | None = None
    """Trajectories outside it are refused; None: only the controller's own model is asked."""
    pose_filter: PoseFilterSettings = PoseFilterSettings()
    risk: RiskSettings = RiskSettings()
    supervision: Supervision = Supervision()
    remote: Remote = Remote()
    emulation: Emulation | None = None

    @property
    def homing_groups(self) -> list[list[str]]:
        """The names of the axes that are homed together, group after group."""
        return self.homing_order or [[axis.name] for axis in self.axes]
