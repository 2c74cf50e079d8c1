"""Foxglove's WebSocket protocol, view-only: whoever comes sees the robot, and can do nothing."""

import logging
from typing import Any, Final

import foxglove
from foxglove.websocket import ServerListener, WebSocketServer

from daemon.bridges.foxglove.scene import SURROUNDINGS, FoxgloveScene
from daemon.messages import Message, Surroundings, WhoAmI

_BACKLOG: Final = 256
"""Messages that wait for a client: some two seconds; then the oldest are dropped."""


class FoxgloveServer:
    """Implements a bridge's listener."""

    def __init__(self, name: str, host: str, port: int) -> None:
        """Raises RuntimeError where the port cannot be had."""
        foxglove.set_log_level(logging.WARNING)
        self.scene = FoxgloveScene()
        self._wanted = _Wanted()
        self._server: WebSocketServer = foxglove.start_server(
            name=name,
            host=host,
            port=port,
            context=self.scene.context,
            server_listener=self._wanted,
            message_backlog_size=_BACKLOG,
        )

    @property
    def port(self) -> int:
        return int(self._server.port)

    def close(self) -> None:
        self._server.stop()

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:
        self.scene.connected(me, surroundings, mesh)
        self._wanted.surroundings = True

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        self.scene.surrounded(surroundings, mesh)
        self._wanted.surroundings = True

    def heard(self, message: Message, date_ns: int) -> None:
        if self._wanted.surroundings:
            self._wanted.surroundings = False
            self.scene.show_surroundings(date_ns)
        self.scene.heard(message, date_ns)

    def lost(self, why: str) -> None:
        self.scene.lost(why)


class _Wanted(ServerListener):
    """Hears on a thread of the library's whether somebody has come for what is told only once."""

    def __init__(self) -> None:
        self.surroundings = False

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ARG002
        if channel.topic == SURROUNDINGS:
            self.surroundings = True
