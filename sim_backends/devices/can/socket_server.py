"""The bus as a unix socket: a SEQPACKET socket that carries what a SocketCAN socket carries.

One `struct can_frame` of 16 bytes per packet. Each client is a node of its own: it hears the
others, not itself. What a SocketCAN socket says by an errno arrives as a packet of 4 bytes, the
errno as a little-endian number: ENETDOWN when the interface is set down, and again for each frame
that is sent meanwhile. End of file means that the adapter has been pulled out.
"""

import asyncio
import errno
import socket
from collections.abc import Iterator
from pathlib import Path
from struct import Struct
from typing import Final

from drivers.can.bus_lock import door_of
from drivers.can.frame import (
    CAN_FRAME,
    ERROR_FLAG,
    EXTENDED_FLAG,
    FRAME_BYTES,
    REMOTE_FLAG,
    STANDARD_ID_MASK,
)
from drivers.clock import Clock
from drivers.exclusive_name import OtherName
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.port import ControllerState, Port
from sim_backends.devices.device import Pump

# What the kernel tells a program about its CAN controller: error frames (linux/can/error.h).


_CONTROLLER: Final = 0x004
_BUS_OFF: Final = 0x040
_RESTARTED: Final = 0x100
_COUNTERS: Final = 0x200

# Second byte of a controller error.
_TRANSMIT_WARNING: Final = 0x08
_TRANSMIT_PASSIVE: Final = 0x20
_RECEIVE_WARNING: Final = 0x04
_RECEIVE_PASSIVE: Final = 0x10
_ACTIVE: Final = 0x40


def error_frame(port: Port, was_off: bool) -> tuple[int, bytes]:
    """Identifier and data of the error frame that tells of the state `port` has just come to."""
    counters = bytes((min(port.transmit_errors, 255), min(port.receive_errors, 255)))
    if port.state is ControllerState.OFF:
        return ERROR_FLAG | _BUS_OFF, bytes(8)
    if was_off:
        return ERROR_FLAG | _RESTARTED, bytes(8)
    detail = _ACTIVE
    transmits = port.transmit_errors >= port.receive_errors
    if port.state is ControllerState.PASSIVE:
        detail = _TRANSMIT_PASSIVE if transmits else _RECEIVE_PASSIVE
    elif port.state is ControllerState.WARNING:
        detail = _TRANSMIT_WARNING if transmits else _RECEIVE_WARNING
    data = bytes((0, detail, 0, 0, 0, 0)) + counters
    return ERROR_FLAG | _CONTROLLER | _COUNTERS, data


ERRNO: Final = Struct("<i")

DEFAULT_QUEUE_FRAMES: Final = 128
DEFAULT_RESTART_S: Final = 0.1

_MAX_CLIENTS: Final = 16
_FRAMES_AT_ONCE: Final = 64  # then the loop gets its turn


class SocketServer:
    """Listens at `path` until closed. Lives in the running event loop.

    queue_frames: the transmit queue of each client's controller. restart_s: how long after
    bus-off a controller comes back; None: never. Raises OSError where the path cannot be had.
    """

    def __init__(
        self,
        bus: CanBus,
        pump: Pump,
        clock: Clock,
        path: Path,
        *,
        queue_frames: int = DEFAULT_QUEUE_FRAMES,
        restart_s: float | None = DEFAULT_RESTART_S,
        door_of_bus: str = "",
    ) -> None:
        """door_of_bus: a name for the bus, if there are several ways to it."""
        self.bus = bus
        self.pump = pump
        self.clock = clock
        self.path = path
        self.queue_frames = queue_frames
        self.restart_after_ns = None if restart_s is None else round(restart_s * 1e9)
        self.loop = asyncio.get_running_loop()
        self._clients: list[_Client] = []
        self._listener: socket.socket | None = None
        self._door_of_bus = door_of_bus
        self._door: OtherName | None = None
        if bus.plugged:
            self._listen()
        bus.adapters.append(self)

    @property
    def frames_lost(self) -> int:
        """Frames that clients were too slow to take, those of clients that are gone left out."""
        return sum(client.port.received_lost for client in self._clients)

    def close(self) -> None:
        """Hang up on everyone."""
        self.set_plugged(False)
        self.bus.adapters.remove(self)

    # As an adapter

    def ports(self) -> Iterator[Port]:
        return (client.port for client in tuple(self._clients))

    def set_up(self, up: bool) -> None:
        for client in tuple(self._clients):
            client.port.connect(up)
            if not up:
                client.tell_errno(errno.ENETDOWN)

    def set_plugged(self, plugged: bool) -> None:
        if plugged and self._listener is None:
            self._listen()
        elif not plugged:
            self._stop_listening()
            for client in tuple(self._clients):
                client.close()

    # Clients

    def forget(self, client: "_Client") -> None:
        """The client is closed."""
        self._clients.remove(client)

    def _listen(self) -> None:
        self.path.unlink(missing_ok=True)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            listener.bind(str(self.path))
            if self._door_of_bus:
                self._door = door_of(self.path, self._door_of_bus)
            listener.listen(_MAX_CLIENTS)
        except OSError:
            listener.close()
            raise
        listener.setblocking(False)
        self.loop.add_reader(listener, self._accept)
        self._listener = listener

    def _stop_listening(self) -> None:
        if self._listener is not None:
            self.loop.remove_reader(self._listener)
            self._listener.close()
            self._listener = None
            self.path.unlink(missing_ok=True)
            if self._door is not None:
                self._door.release()
                self._door = None

    def _accept(self) -> None:
        assert self._listener is not None
        try:
            connection, _ = self._listener.accept()
        except (BlockingIOError, ConnectionError):
            return
        if len(self._clients) >= _MAX_CLIENTS:
            connection.close()
            return
        self._clients.append(_Client(self, connection))


class _Client:
    """One connection, and its node on the bus."""

    def __init__(self, server: SocketServer, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._server = server
        self._connection = connection
        self._open = True
        self._was_off = False
        self.port = server.bus.attach("client", server.queue_frames)
        self.port.restart_after_ns = server.restart_after_ns
        self.port.on_state = self._state_changed
        self.port.on_space = self._space
        self.port.listen({}, self._frame)
        self.port.connect(server.bus.up)
        server.loop.add_reader(connection, self._readable)
        server.pump.touch()

    def close(self) -> None:
        """Hang up."""
        if self._open:
            self._open = False
            self._server.loop.remove_reader(self._connection)
            self._connection.close()
            self._server.bus.detach(self.port)
            self._server.forget(self)

    def tell_errno(self, number: int) -> None:
        """What a SocketCAN socket would raise."""
        self._send(ERRNO.pack(number))

    def _readable(self) -> None:
        server, port = self._server, self.port
        t_ns = server.clock.now_ns()
        try:
            for _ in range(_FRAMES_AT_ONCE):
                if port.full:
                    server.loop.remove_reader(self._connection)
                    break
                packet = self._connection.recv(FRAME_BYTES + 1)
                if not packet:
                    self.close()
                    return
                if not self._take(packet, t_ns):
                    port.refused += 1
        except BlockingIOError:
            pass
        except OSError:
            self.close()
            return
        server.pump.touch()

    def _take(self, packet: bytes, t_ns: int) -> bool:
        """Hand a frame to the controller. What is no frame the kernel refuses (EINVAL)."""
        if not self._server.bus.up:
            self.tell_errno(errno.ENETDOWN)
            return False
        if len(packet) != FRAME_BYTES:
            return False
        can_id, length, data = CAN_FRAME.unpack(packet)
        if length > 8 or can_id & ERROR_FLAG:
            return False
        if not can_id & EXTENDED_FLAG:
            can_id &= STANDARD_ID_MASK | REMOTE_FLAG
        return self.port.send(can_id, data[:length], t_ns)

    def _space(self, _t_ns: int) -> None:
        if self._open:
            self._server.loop.add_reader(self._connection, self._readable)

    def _frame(self, can_id: int, data: bytes, _t_ns: int) -> None:
        self._send(CAN_FRAME.pack(can_id, len(data), data))

    def _state_changed(self, state: ControllerState, _t_ns: int) -> None:
        can_id, data = error_frame(self.port, self._was_off)
        self._was_off = state is ControllerState.OFF
        self._send(CAN_FRAME.pack(can_id, len(data), data))

    def _send(self, packet: bytes) -> None:
        """Never waits: a client that does not read loses frames, and hears no more of it."""
        if not self._open:
            return
        try:
            self._connection.send(packet)
        except BlockingIOError:
            self.port.received_lost += 1
        except OSError:
            self._server.loop.call_soon(self.close)
