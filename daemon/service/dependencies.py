"""What the service depends on, and who receives its messages.

The same robot lives in real and in virtual time: nothing of this is made by the service.
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from config.control import Surface
from daemon.host.real_time import RealTime
from daemon.messages import Message
from daemon.recording.flight_recorder import Recorder
from daemon.risk.preparation import prepare_here
from daemon.risk.surroundings import BodySize, RiskSurroundings
from daemon.robot.hardware import Connections
from drivers.clock import WallClock
from safety.risk_source import RiskSource

PrepareSurroundings = Callable[[Surface, BodySize, Path], Awaitable[RiskSurroundings]]
"""Of a robot file at a path. Raises EnvironmentFaultError, ApartError, OSError, TimeoutError."""


async def prepare_at_once(surface: Surface, size: BodySize, robot_path: Path) -> RiskSurroundings:
    """In virtual time nothing takes long."""
    return prepare_here(surface, size, robot_path)


_Kind = TypeVar("_Kind", bound=Message)


class Subscribers:
    """Receivers, each of one kind of message or of all. They are called in the order of joining.

    They are called in the loop: they must be quick and must not fail.
    """

    def __init__(self) -> None:
        self._receivers: list[tuple[type[Message], Callable[[Any], None]]] = []
        self._of: dict[type[Message], list[Callable[[Any], None]]] = {}
        """By kind of message, as far as there were any: found once, not with every message."""

    def add(self, receiver: Callable[[Message], None]) -> None:
        """`receiver` gets every message."""
        self.add_for(Message, receiver)

    def add_for(self, kind: type[_Kind], receiver: Callable[[_Kind], None]) -> None:
        """`receiver` gets messages of this kind."""
        self._receivers.append((kind, receiver))
        self._of.clear()

    def publish(self, message: Message) -> None:
        """Hand `message` to every receiver of its kind."""
        receivers = self._of.get(type(message))
        if receivers is None:
            receivers = self._of[type(message)] = self._those_of(type(message))
        for receiver in receivers:
            receiver(message)

    def _those_of(self, kind: type[Message]) -> list[Callable[[Any], None]]:
        return [receiver for wanted, receiver in self._receivers if issubclass(kind, wanted)]


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
    body_failing: Callable[[], str] = lambda: ""
    """What the package that an emulated body comes from does wrong; empty: nothing. Never waits."""
    prepare_surroundings: PrepareSurroundings = prepare_at_once
    """How others are made of what a client says of them."""
    good_cycle: Callable[[int], None] = lambda _: None
    """Called with the time after every bus cycle that was supervised and found sound. Never waits.
    """
