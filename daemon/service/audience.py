"""Who hears of what the robot does."""

from collections.abc import Callable
from typing import Any, TypeVar

from daemon.messages import Message

_Kind = TypeVar("_Kind", bound=Message)


class Audience:
    """Listeners, each of one kind of message or of all. They are told in the order of joining.

    They are called in the loop: they must be quick and must not fail.
    """

    def __init__(self) -> None:
        self._listeners: list[tuple[type[Message], Callable[[Any], None]]] = []
        self._of: dict[type[Message], list[Callable[[Any], None]]] = {}
        """By kind of message, as far as there were any: found once, not with every message."""

    def add(self, listener: Callable[[Message], None]) -> None:
        """Hears of every message."""
        self.add_for(Message, listener)

    def add_for(self, kind: type[_Kind], listener: Callable[[_Kind], None]) -> None:
        """Hears of messages of this kind."""
        self._listeners.append((kind, listener))
        self._of.clear()

    def tell(self, message: Message) -> None:
        """Tell everybody whom it concerns."""
        listeners = self._of.get(type(message))
        if listeners is None:
            listeners = self._of[type(message)] = self._those_of(type(message))
        for listener in listeners:
            listener(message)

    def _those_of(self, kind: type[Message]) -> list[Callable[[Any], None]]:
        return [listener for wanted, listener in self._listeners if issubclass(kind, wanted)]
