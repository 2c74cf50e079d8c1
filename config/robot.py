"""A robot: its axes, its tracker, the buses between, and what stands in when they are absent."""

from typing import Annotated

from pydantic import Field

from config.axis import Axis
from config.bus import Bus
from config.control import PoseFilterSettings, RiskSettings, Supervision, Workspace
from config.emulation import Emulation
from config.model import ConfigModel, Name
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
    workspace: Workspace | None = None
    """Trajectories outside it are refused; None: only the controller's own model is asked."""
    pose_filter: PoseFilterSettings = PoseFilterSettings()
    risk: RiskSettings = RiskSettings()
    supervision: Supervision = Supervision()
    remote: Remote = Remote()
    emulation: Emulation | None = None
