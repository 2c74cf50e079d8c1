"""The client for programs: every command, and every reason why it was not carried out.

async with await RobotClient.connect(LocalAddress.in_folder(folder)) as robot:
    await robot.acquire()
    await robot.arm()
"""

import asyncio
import hashlib
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, Final, TypeVar

import msgspec
import zenoh

from daemon.messages import (
    Acquire,
    Answer,
    Arm,
    Clear,
    Command,
    Disarm,
    Event,
    Events,
    Hold,
    Home,
    Inject,
    Load,
    MovingObstacle,
    Obstacles,
    Plan,
    Release,
    Resume,
    Setpoint,
    Start,
    Status,
    Stop,
    Surround,
    Surroundings,
    Teleoperate,
    Upload,
    WhoAmI,
    verb,
)
from daemon.remote.client.address import Address, TlsAddress
from daemon.remote.client.client_errors import (
    ANSWERS_WITHIN_S,
    ARMS_WITHIN_S,
    HOMES_WITHIN_S,
    PREPARES_WITHIN_S,
    BadAnswerError,
    ClientError,
    DisconnectedError,
    LeaseLostError,
)
from daemon.remote.client.connection import Connection
from daemon.remote.client.lease_keeper import LeaseKeeper
from daemon.remote.client.stop_client import StopLine, first_answer
from daemon.remote.client.subscription import DEPTH, Subscription
from daemon.remote.wire import encode, encoding_of

C = TypeVar("C", bound=Command)
_PART_BYTES: Final = 49152
_BETWEEN_PARTS_S: Final = 0.005
"""So that the questions of one client stay below what the daemon takes of one user."""


class RobotClient:
    """A connected client. All methods raise ClientError. To be used on one event loop."""

    def __init__(self, connection: Connection, stop_connection: Connection, me: WhoAmI) -> None:
        """Use `connect`. stop_connection: may be the same; then a flood delays our own STOP."""
        self.me = me
        """What the daemon has said of itself and of our role."""
        self.lease_lost: LeaseLostError | None = None
        """Why the lease that was acquired is not kept any more."""
        self.token = ""
        """Of somebody's lease, for commands while this client has acquired none itself."""
        self._connection = connection
        self._stop_connection = stop_connection
        self._stop_line: StopLine | None = None
        self._lease = LeaseKeeper(self._renew, self._on_lease_lost)
        self._subscriptions: list[Subscription] = []
        self._request = 0
        self._setpoint = self._obstacles = 0
        self._loop = asyncio.get_running_loop()
        self._gone = False
        self._watch = self._watch_daemon()

    @classmethod
    async def connect(
        cls, address: Address, *, wait_s: float = 0.0, own_stop: bool = True
    ) -> "RobotClient":
        """wait_s: for a daemon that is still starting. own_stop: a second connection for STOP, so
        that nothing else that is sent can delay it."""
        connection = await Connection.connect(address, wait_s)
        stop_connection = connection
        try:
            me = await connection.whoami()
            if not own_stop:
                return cls(connection, stop_connection, me)
            stop_connection = await Connection.connect(address)
            client = cls(connection, stop_connection, me)
            await client._open_stop_line()
            return client
        except ClientError:
            await connection.close()
            raise

    async def _open_stop_line(self) -> None:
        """Over tls: a connection for STOP, there before it is wanted."""
        address = self._connection.address
        if isinstance(address, TlsAddress) and self.me.role == "operator":
            self._stop_line = address.stop_line()
            with suppress(ClientError):  # an older daemon: STOP goes as a command then
                await self._stop_line.connect()

    async def __aenter__(self) -> "RobotClient":
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        await self.close()

    async def close(self) -> None:
        """Let the lease run out, and hang up. `release` gives it back at once."""
        await self._lease.stop()
        for subscription in self._subscriptions:
            subscription.close()
        await self._connection.close()
        if self._stop_line is not None:
            await self._stop_line.close()
        if self._stop_connection is not self._connection:
            await self._stop_connection.close()

    # Watching.

    @property
    def connected(self) -> bool:
        """Whether the daemon is there, as far as the network can tell."""
        return not self._gone and self._connection.is_connected()

    async def whoami(self) -> WhoAmI:
        return await self._connection.whoami(ANSWERS_WITHIN_S)

    async def status(self) -> Status:
        return await self._connection.ask(
            self._connection.keys.telemetry("state"), Status, within_s=ANSWERS_WITHIN_S
        )

    async def events(self) -> list[Event]:
        """The last 200 that there were, the oldest first."""
        connection = self._connection
        told = await connection.ask(connection.keys.events, Events, within_s=ANSWERS_WITHIN_S)
        return told.events

    async def surroundings(self) -> tuple[Surroundings, bytes]:
        """What is round the body, and its mesh as a binary STL file; empty where there is none."""
        connection = self._connection
        keys = connection.keys
        about = await connection.ask(keys.surroundings, Surroundings, within_s=ANSWERS_WITHIN_S)
        mesh = b""
        for number in range(about.parts):
            part = keys.surroundings_part(number)
            mesh += await connection.ask_bytes(part, ANSWERS_WITHIN_S)
            await asyncio.sleep(_BETWEEN_PARTS_S)
        if about.parts and hashlib.sha256(mesh).hexdigest() != about.sha256:
            raise BadAnswerError("the surroundings have not come whole: ask again")
        return about, mesh

    def subscribe(self, names: Sequence[str], depth: int = DEPTH) -> Subscription:
        """What is published under these names: `state`, `tip`, `axes`, `risk`, `loop`, `event`,
        `body`."""
        connection = self._connection
        subscription = Subscription(connection.session, connection.keys, names, depth)
        subscription.daemon_gone(self._gone)
        self._subscriptions.append(subscription)
        return subscription

    # Commanding.

    async def acquire(self) -> Answer:
        """Take the lease, and renew it until `release` or `close`."""
        answer = await self._lease.acquire(ANSWERS_WITHIN_S)
        self.lease_lost = None
        return answer

    async def release(self) -> Answer:
        """Give the lease back."""
        token = self._lease.token or self.token
        answer = await self._command(Release(token=token))
        await self._lease.stop()
        return answer

    async def arm(self, *, despite_contact: bool = False) -> Answer:
        """despite_contact: of a body that touches something, to lead it out."""
        return await self._command(Arm(despite_contact=despite_contact), ARMS_WITHIN_S)

    async def home(self, axes: Sequence[str] = (), within_s: float = HOMES_WITHIN_S) -> Answer:
        """Let axes look for their zeros; empty: all that do not know theirs."""
        return await self._command(Home(axes=list(axes)), within_s)

    async def disarm(self) -> Answer:
        return await self._command(Disarm(), ARMS_WITHIN_S)

    async def load(
        self,
        trajectory: dict[str, Any],
        controller: dict[str, Any] | None = None,
        cycles: int | None = None,
    ) -> Answer:
        command = Load(trajectory=trajectory, controller=controller, cycles=cycles)
        return await self._command(command, ARMS_WITHIN_S)

    async def plan(
        self,
        to_mm: Sequence[float],
        via_mm: Sequence[Sequence[float]] = (),
        pointing: Sequence[float] | None = None,
        *,
        tip_speed_mm_s: float = 8.0,
        most_risk: float = 0.05,
        within_s: float = PREPARES_WITHIN_S,
    ) -> Answer:
        """A path from where the robot stands, among what is round it: `file` of the answer is what
        `load` takes, and `path` what stands in it. Refused with the reason where there is none."""
        command = Plan(
            to_mm=list(to_mm),
            via_mm=[list(place) for place in via_mm],
            pointing=None if pointing is None else list(pointing),
            tip_speed_mm_s=tip_speed_mm_s,
            most_risk=most_risk,
        )
        return await self._command(command, within_s)

    async def start(self) -> Answer:
        return await self._command(Start())

    async def teleoperate(self, controller: dict[str, Any] | None = None) -> Answer:
        return await self._command(Teleoperate(controller=controller))

    async def hold(self) -> Answer:
        return await self._command(Hold())

    async def resume(self) -> Answer:
        return await self._command(Resume())

    async def clear(self) -> Answer:
        return await self._command(Clear(), ARMS_WITHIN_S)

    async def upload(self, name: str, content: bytes) -> str:
        """Send a mesh's file, of which `name` tells by its end how it is written.

        Returns what `surround` takes for it.
        """
        digest = hashlib.sha256(content).hexdigest()
        for offset in range(0, max(len(content), 1), _PART_BYTES):
            part = Upload(
                name=name,
                sha256=digest,
                size_bytes=len(content),
                offset=offset,
                data=content[offset : offset + _PART_BYTES],
            )
            await self._command(part)
        return f"upload:{digest}"

    async def surround(
        self,
        surface: dict[str, Any] | None = None,
        *,
        add: bool = False,
        within_s: float = PREPARES_WITHIN_S,
    ) -> Answer:
        """Replace what is round the body; the robot must not move. surface: with the keys of
        `risk.surface` in robot files; None: that of the robot file again. add: its `bodies` and
        `regions`, besides what is there."""
        return await self._command(Surround(surface=surface, add=add), within_s)

    async def inject(self, fault: str) -> Answer:
        return await self._command(Inject(fault=fault))

    async def stop(self, within_s: float = ANSWERS_WITHIN_S) -> Answer:
        """Quick stop, then power off. Needs no lease. Look at `confirmed` in the answer.

        By STOP's own way first, and as a command where that brings nothing soon.
        """
        stop = self._signed(Stop())

        async def as_command(left_s: float) -> Answer:
            return await self._stop_connection.command(verb(Stop), stop, Answer, left_s)

        line = self._stop_line
        address = self._connection.address
        own_way = (address if line is None else line).stop(stop.request, within_s)
        return await first_answer(own_way, as_command, within_s)

    async def send(self, command: Command, within_s: float = ARMS_WITHIN_S) -> Answer:
        """Any command, as it is made."""
        if isinstance(command, Stop):
            return await self.stop(within_s)
        return await self._command(command, within_s)

    def send_setpoint(
        self,
        position_mm: Sequence[float],
        valid_s: float = 0.2,
        velocity_mm_s: Sequence[float] | None = None,
        direction: Sequence[float] | None = None,
    ) -> int:
        """Where the tip shall be now, after `teleoperate`, and with a `direction` also where it
        shall point: a unit vector. Refusals are published as `event`.

        Returns the set-point's number, by which they name it. Raises DisconnectedError; whether it
        has arrived is not known.
        """
        if not self.connected:
            raise DisconnectedError("the daemon has gone")
        self._setpoint += 1
        setpoint = Setpoint(
            token=self._lease.token or self.token,
            sequence=self._setpoint,
            position_mm=list(position_mm),
            valid_s=valid_s,
            velocity_mm_s=None if velocity_mm_s is None else list(velocity_mm_s),
            direction=None if direction is None else list(direction),
        )
        connection = self._connection
        connection.session.put(
            connection.keys.setpoint(connection.address.user),
            encode(setpoint),
            encoding=encoding_of(setpoint),
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )
        return setpoint.sequence

    def send_obstacles(
        self,
        balls: Sequence[MovingObstacle],
        valid_for_s: float = 0.3,
        age_s: float = 0.0,
    ) -> None:
        """Where obstacles are that move: again and again, sooner than `valid_for_s` is over. None
        at all ends the stream. age_s: how long ago they were measured. Raises DisconnectedError;
        whether they have arrived is not known."""
        if not self.connected:
            raise DisconnectedError("the daemon has gone")
        self._obstacles += 1
        message = Obstacles(
            sequence=self._obstacles, balls=list(balls), valid_for_s=valid_for_s, age_s=age_s
        )
        connection = self._connection
        connection.session.put(
            connection.keys.obstacles(connection.address.user),
            encode(message),
            encoding=encoding_of(message),
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )

    async def _command(self, command: Command, within_s: float = ANSWERS_WITHIN_S) -> Answer:
        signed = self._signed(command)
        return await self._connection.command(verb(command), signed, Answer, within_s)

    def _signed(self, command: C) -> C:
        self._request += 1
        token = command.token or self._lease.token or self.token
        return msgspec.structs.replace(command, request=str(self._request), token=token)

    async def _renew(self, token: str, within_s: float) -> Answer:
        command = Acquire(token=token, request="lease")
        return await self._connection.command(verb(command), command, Answer, within_s)

    def _on_lease_lost(self, error: LeaseLostError) -> None:
        self.lease_lost = error

    def _watch_daemon(self) -> zenoh.Subscriber[None]:
        def came(sample: zenoh.Sample) -> None:
            gone = sample.kind != zenoh.SampleKind.PUT
            with suppress(RuntimeError):  # the loop has ended without us
                self._loop.call_soon_threadsafe(self._daemon_gone, gone)

        connection = self._connection
        return connection.session.liveliness().declare_subscriber(
            connection.keys.alive, zenoh.handlers.Callback(came, indirect=False), history=True
        )

    def _daemon_gone(self, gone: bool) -> None:
        self._gone = gone
        for subscription in self._subscriptions:
            subscription.daemon_gone(gone)
