"""Serves OpenIGTLink to many clients. Each gets the newest of everything; nothing waits for one."""

import asyncio
import socket
from collections.abc import Iterable
from contextlib import suppress
from typing import Final

from daemon.bridges.openigtlink.contents import (
    pack_capability,
    read_start_tracking,
)
from daemon.bridges.openigtlink.framing import Deframer, Frame, FramingError, packed
from daemon.bridges.openigtlink.translation import (
    KINDS,
    STATE,
    TOOLS,
    body_frames,
    device_of,
    in_words,
    lost_frames,
    state_frame,
    status_frame,
    tip_frames,
    tracking_frame,
)
from daemon.host.clock import MonotonicClock
from daemon.messages import Body, Message, Status, Surroundings, Tip, WhoAmI

_MOST_CLIENTS: Final = 32
_MOST_WAITING_BYTES: Final = 1 << 15
"""A second of everything. A client that has more to come gets nothing new until it has read it."""
_SOCKET_BYTES: Final = 1 << 15
"""The kernel keeps no more for a client: what it reads late is not old by much."""
_SLOW_S: Final = 2.0
"""A client that has not read for so long is hung up on; it may come back."""
_STATUS_EACH_NS: Final = 1_000_000_000
_READ_BYTES: Final = 1 << 14


class Client:
    """One that has come."""

    def __init__(self, writer: asyncio.StreamWriter, name: str, now_s: float) -> None:
        self.name = name
        self.left_out = 0
        """Frames that it was too slow for."""
        self.deframer = Deframer()
        self.tracking_s: float | None = None
        """How far apart it wants TDATA to be; None: it does not want any."""
        self._tracked_s = -float("inf")
        self._writer = writer
        self._keeps_up_s = now_s

    def send(self, data: bytes, now_s: float) -> bool:
        """Returns whether it is still a client; one that has not read for long is no more."""
        transport = self._writer.transport
        if transport.is_closing():
            return False
        if transport.get_write_buffer_size() > _MOST_WAITING_BYTES:
            self.left_out += 1
            if now_s - self._keeps_up_s <= _SLOW_S:
                return True
            transport.abort()
            return False
        self._keeps_up_s = now_s
        self._writer.write(data)
        return True

    def wants_tracking(self, now_s: float) -> bool:
        """Whether its next TDATA is due. A little early counts, lest every other one were left out
        where the wanted time is that of the measurements."""
        if self.tracking_s is None or now_s - self._tracked_s < 0.9 * self.tracking_s:
            return False
        self._tracked_s = now_s
        return True

    def abort(self) -> None:
        self._writer.transport.abort()


class OpenIGTLinkServer:
    """A bridge's listener, with the port that others come to."""

    def __init__(self, robot: str, body_kinds: tuple[str, ...] = ("POLYDATA",)) -> None:
        """robot: what it is called until its daemon has said so itself."""
        self.clients: dict[str, Client] = {}
        self.dropped = 0
        """Clients that were too slow."""
        self._robot = robot
        self._body_kinds = body_kinds
        self._clock = MonotonicClock()
        self._newest: dict[str, Frame] = {}
        """Of each device, what one that has just come is told first."""
        self._state = ""
        self._state_ns = 0
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()

    async def open(self, listening: socket.socket) -> None:
        """Raises OSError."""
        self._server = await asyncio.start_server(self._come, sock=listening)

    async def close(self) -> None:
        if self._server is not None:
            self._server.close()
        for client in self.clients.values():
            client.abort()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    # What the robot tells.

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:  # noqa: ARG002
        self._robot = me.robot
        self._newest.clear()

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        """Nothing of them is told."""

    def heard(self, message: Message, date_ns: int) -> None:
        if isinstance(message, Tip):
            self._send(tip_frames(message, date_ns))
            self._track(message, date_ns)
        elif isinstance(message, Body):
            self._keep_and_send(body_frames(message, date_ns, self._body_kinds))
        elif isinstance(message, Status):
            self._tell_state(message, date_ns)

    def lost(self, why: str) -> None:
        """Every place is old from here on; clients are told so, and nothing more of places."""
        self._newest.clear()
        self._state = ""
        self._keep_and_send(lost_frames(self._robot, why, self._clock.wall_time_ns()))

    def _tell_state(self, status: Status, date_ns: int) -> None:
        """When it changes, and now and then."""
        words = in_words(status)
        changed = words != self._state
        if not changed and date_ns - self._state_ns < _STATUS_EACH_NS:
            return
        self._state, self._state_ns = words, date_ns
        frames = [status_frame(status, date_ns)]
        if changed:
            frames.append(state_frame(status, date_ns))
        self._keep_and_send(frames)

    def _track(self, tip: Tip, date_ns: int) -> None:
        now_s = asyncio.get_running_loop().time()
        wanting = [one for one in self.clients.values() if one.wants_tracking(now_s)]
        if wanting and (frame := tracking_frame(tip, date_ns)) is not None:
            self._send([frame], wanting)

    def _keep_and_send(self, frames: list[Frame]) -> None:
        self._newest.update((frame.device, frame) for frame in frames)
        self._send(frames)

    def _send(self, frames: list[Frame], to: Iterable[Client] | None = None) -> None:
        now_s = asyncio.get_running_loop().time()
        made: dict[int, bytes] = {}
        for client in list(self.clients.values() if to is None else to):
            version = client.deframer.version
            if version not in made:
                made[version] = b"".join(packed(frame, version) for frame in frames)
            if not client.send(made[version], now_s):
                self.dropped += self.clients.pop(client.name, None) is not None

    # Clients.

    async def _come(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        if len(self.clients) >= _MOST_CLIENTS:
            writer.transport.abort()
            return
        link: socket.socket = writer.get_extra_info("socket")
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        link.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SOCKET_BYTES)
        name = str(writer.get_extra_info("peername"))
        client = Client(writer, name, asyncio.get_running_loop().time())
        self.clients[name] = client
        self._send(list(self._newest.values()), [client])
        try:
            await self._talk(client, reader)
        except (FramingError, OSError):
            pass  # it has gone, or what it says is no OpenIGTLink
        finally:
            if self.clients.get(name) is client:
                del self.clients[name]
            client.abort()
            with suppress(OSError):
                await writer.wait_closed()

    async def _talk(self, client: Client, reader: asyncio.StreamReader) -> None:
        """Raises FramingError, OSError."""
        while data := await reader.read(_READ_BYTES):
            for frame in client.deframer.feed(data):
                self._answer(client, frame)

    def _answer(self, client: Client, frame: Frame) -> None:
        """What it does not ask for here is no error: a client may send its own transforms to
        everyone. Raises FramingError."""
        now_ns = self._clock.wall_time_ns()
        if frame.kind == "GET_STATUS":
            status = self._newest.get(device_of(self._robot))
            self._send([] if status is None else [status], [client])
        elif frame.kind == "GET_STRING":
            state = self._newest.get(STATE)
            self._send([] if state is None else [state], [client])
        elif frame.kind == "GET_CAPABIL":
            content = pack_capability(KINDS)
            self._send([Frame("CAPABILITY", device_of(self._robot), content, now_ns)], [client])
        elif frame.kind == "STT_TDATA":
            client.tracking_s = read_start_tracking(frame.content) * 1e-3
            self._send([Frame("RTS_TDATA", TOOLS, b"\0", now_ns)], [client])
        elif frame.kind == "STP_TDATA":
            client.tracking_s = None
            self._send([Frame("RTS_TDATA", TOOLS, b"\0", now_ns)], [client])
