"""What every way into the bus from outside has in common."""

from collections.abc import Iterable
from typing import Protocol

from sim_backends.devices.can.port import Port


class Adapter(Protocol):
    """An adapter: what can be set up and down, and pulled out."""

    def ports(self) -> Iterable[Port]:
        """The controllers behind it."""
        ...

    def set_up(self, up: bool) -> None:
        """The interface has been set up or down."""
        ...

    def set_plugged(self, plugged: bool) -> None:
        """The adapter has been plugged in or pulled out."""
        ...
