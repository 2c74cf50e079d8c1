"""Nodes for tests of the bus."""

from dataclasses import dataclass, field

from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.port import ControllerState, Port

MS = 1_000_000


@dataclass
class Node:
    """Hears everything and keeps it."""

    port: Port
    heard: list[tuple[int, bytes, int]] = field(default_factory=list)
    states: list[ControllerState] = field(default_factory=list)

    @classmethod
    def on(cls, bus: CanBus, capacity: int = 16, *, mailboxes: bool = False) -> "Node":
        node = cls(bus.attach("node", capacity, mailboxes=mailboxes))
        node.port.listen({}, lambda can_id, data, t_ns: node.heard.append((can_id, data, t_ns)))
        node.port.on_state = lambda state, _: node.states.append(state)
        return node

    @property
    def ids(self) -> list[int]:
        return [can_id for can_id, _, _ in self.heard]
