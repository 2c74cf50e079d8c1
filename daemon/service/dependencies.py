"""What the service depends on: the same robot lives in real and in virtual time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from daemon.host.real_time import RealTime
from daemon.recording.flight_recorder import Recorder
from daemon.robot.hardware import Connections
from daemon.service.subscribers import Subscribers
from drivers.clock import WallClock
from safety.risk_source import RiskSource


@dataclass
class Dependencies:
    """Given from outside; nothing of it is made by the service."""

    connections: Connections
    clock: WallClock
    recorder: Recorder
    risk: RiskSource
    simulated: bool
    real_time: RealTime | None = None
    """None: nothing is asked of the operating system."""
    new_token: Callable[[], str] | None = None
    """For leases; None: as unguessable as can be."""
    runs: Path | None = None
    """Where recordings will go; None: nobody minds how much room there is."""
    subscribers: Subscribers = field(default_factory=Subscribers)
