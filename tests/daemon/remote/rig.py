"""A robot that only keeps count of what it is told, behind the real server."""

import asyncio
import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

import zenoh

from config.remote import Remote
from daemon.host.clock import MonotonicClock
from daemon.messages import (
    Acquire,
    Answer,
    Command,
    LeaseStatus,
    Load,
    LoopStatus,
    Message,
    Obstacles,
    Refusal,
    Release,
    RiskStatus,
    Setpoint,
    SetpointRefused,
    Status,
    Stop,
    Tip,
    TrackerStatus,
    verb,
)
from daemon.remote.client.address import Address
from daemon.remote.keys import Keys
from daemon.remote.server.server import RemoteServer
from daemon.remote.surroundings import PreparedSurroundings
from daemon.remote.wire import decode, encode, encoding_of, requested_format
from daemon.service.lease import Lease

ROBOT = "little_arm"
WITHIN_S = 20.0
"""How long a test waits for what must come; it ends as soon as it comes."""


class FakeRobot:
    """Carries out everything at once. Implements CommandHandler."""

    def __init__(self, lease_s: float = 60.0) -> None:
        self.clock = MonotonicClock()
        self.lease = Lease(lease_s)
        self.carried_out: list[tuple[str, Command]] = []
        self.setpoints: list[tuple[str, Setpoint]] = []
        self.seen: list[tuple[str, Obstacles | str]] = []
        self.state = "STANDBY"
        self.slow_until: asyncio.Event | None = None
        """While it is there and not set, `load` takes for ever."""
        self.fails = False
        self.stopped_ns: list[int] = []
        """When each STOP was obeyed."""
        self._sequence = -1

    def stop_now(self) -> None:
        self.state = "STANDBY"
        self.stopped_ns.append(self.clock.now_ns())

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        if self.fails:
            raise RuntimeError("the handler is broken")
        now_ns = self.clock.now_ns()
        if isinstance(command, Acquire):
            token = self.lease.acquire(user, command.token, now_ns)
            if token is None:
                return self.refusal(command, "no_lease", f"{self.lease.holder(now_ns)} has it")
            left_s = self.lease.expires_in_s(now_ns)
            return self.answer(command, token=token, expires_in_s=left_s)
        if isinstance(command, Stop):
            self.state = "STANDBY"
        elif not self.lease.holds(command.token, user, now_ns):
            return self.refusal(command, "no_lease", "acquire the lease first")
        elif isinstance(command, Release):
            self.lease.release(command.token, user, now_ns)
        elif isinstance(command, Load) and self.slow_until is not None:
            await self.slow_until.wait()
        elif verb(command) == "arm":
            self.state = "ARMED"
        self.carried_out.append((user, command))
        return self.answer(command)

    def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
        if setpoint.sequence <= self._sequence:
            return SetpointRefused(sequence=setpoint.sequence, reason="not newer than the last")
        self._sequence = setpoint.sequence
        self.setpoints.append((user, setpoint))
        return None

    def obstacles(self, user: str, obstacles: Obstacles | str) -> None:
        self.seen.append((user, obstacles))

    def status(self) -> Status:
        now_ns = self.clock.now_ns()
        return Status(
            robot=ROBOT,
            state=self.state,
            reasons=[],
            t_ns=now_ns,
            sequence=len(self.carried_out),
            tip_mm=[1.0, 2.0, 103.5],
            reference_mm=None,
            error_mm=None,
            tracker=TrackerStatus(
                state="tracking", rate_hz=40.0, age_s=0.01, quality=1.0, latency_s=0.02
            ),
            axes=[],
            risk=RiskStatus(
                source="none", contact_risk=0.0, body_point_risk=None, threshold=0.05, scale=1.0
            ),
            loop=LoopStatus(
                rate_hz=40.0,
                cycle_rate_hz=100.0,
                lateness_p50_s=1e-5,
                lateness_p99_s=1e-4,
                lateness_max_s=1e-3,
                missed=0,
                step_p50_s=1e-4,
                step_p99_s=1e-3,
            ),
            lease=LeaseStatus(
                holder=self.lease.holder(now_ns), expires_in_s=self.lease.expires_in_s(now_ns)
            ),
            recording=None,
            simulated=True,
            version="1.2.3",
        )

    def answer(self, command: Command, **more: Any) -> Answer:
        return Answer(request=command.request, state=self.state, **more)

    def refusal(self, command: Command, name: str, text: str) -> Refusal:
        return Refusal(request=command.request, state=self.state, name=name, text=text)

    def verbs(self) -> list[str]:
        """What was carried out, in its order."""
        return [verb(command) for _, command in self.carried_out]


def tip(sequence: int = 0) -> Tip:
    return Tip(
        sequence=sequence,
        t_ns=sequence * 25_000_000,
        state="RUNNING",
        measured_mm=[1.0, 2.0, 103.5],
        tip_mm=[1.1, 2.1, 103.4],
        velocity_mm_s=[0.0, 0.0, 0.0],
        quaternion=[1.0, 0.0, 0.0, 0.0],
        reference_mm=[1.0, 2.0, 103.0],
        error_mm=0.42,
    )


@asynccontextmanager
async def serving(
    folder: Path,
    robot: FakeRobot | None = None,
    settings: Remote | None = None,
    surroundings: PreparedSurroundings | None = None,
    name: str = ROBOT,
) -> AsyncIterator[tuple[RemoteServer, FakeRobot]]:
    """A server with its robot, closed at the end."""
    robot = robot or FakeRobot()
    server = RemoteServer(
        name,
        settings or Remote(),
        folder,
        robot,
        simulated=True,
        version="1.2.3",
        surroundings=surroundings,
    )
    await server.open()
    try:
        yield server, robot
    finally:
        await server.close()


async def publish_until(server: RemoteServer, message: Message, true: Callable[[], object]) -> None:
    """Publish it again and again until something is so: who has just come may miss the first."""

    def publish_and_look() -> object:
        server.publish(message)
        return true()

    await until(publish_and_look)


async def until(true: Callable[[], object], what: str = "it") -> None:
    """Wait until something is so."""
    try:
        async with asyncio.timeout(WITHIN_S):
            while not true():
                await asyncio.sleep(0.01)
    except TimeoutError:
        raise AssertionError(f"{what} has not come within {WITHIN_S} s") from None


class Reply(NamedTuple):
    """One answer, or one refusal."""

    refused: bool
    payload: bytes
    encoding: str

    @property
    def refusal(self) -> Refusal:
        assert self.refused, self
        return decode(self.payload, Refusal, requested_format(self.encoding))

    @property
    def answer(self) -> Answer:
        assert not self.refused, self
        return decode(self.payload, Answer, requested_format(self.encoding))


def _reply(reply: zenoh.Reply) -> Reply:
    if reply.ok is not None:
        return Reply(False, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
    assert reply.err is not None
    return Reply(True, reply.err.payload.to_bytes(), str(reply.err.encoding))


class Raw:
    """A client that keeps to nothing: a bare zenoh session, for what ours would never send."""

    def __init__(self, session: zenoh.Session, robot: str = ROBOT) -> None:
        self.session = session
        self.keys = Keys(robot)

    async def get(self, key: str, payload: bytes | None = None, encoding: str = "") -> list[Reply]:
        """All answers to a query."""

        loop, over = asyncio.get_running_loop(), asyncio.Event()
        replies: list[Reply] = []

        def came(reply: zenoh.Reply) -> None:
            replies.append(_reply(reply))

        self.session.get(
            key,
            zenoh.handlers.Callback(
                came, lambda: loop.call_soon_threadsafe(over.set), indirect=False
            ),
            payload=payload,
            encoding=encoding or None,
            timeout=WITHIN_S,
        )
        await over.wait()
        return replies

    async def ask(self, user: str, command: Command) -> list[Reply]:
        """A command as it should be."""
        key = self.keys.command(user, verb(command))
        return await self.get(key, encode(command), encoding_of(command))

    def stream(self, user: str, setpoint: Setpoint) -> None:
        self.session.put(self.keys.setpoint(user), encode(setpoint), encoding=encoding_of(setpoint))

    def hear(self, key: str) -> list[bytes]:
        """What others say on `key` from now on."""
        heard: list[bytes] = []

        def came(sample: zenoh.Sample) -> None:
            heard.append(sample.payload.to_bytes())

        callback = zenoh.handlers.Callback(came, indirect=False)
        self.session.declare_subscriber(key, callback, allowed_origin=zenoh.Locality.REMOTE)
        return heard


@asynccontextmanager
async def raw(address: Address) -> AsyncIterator[Raw]:
    """A bare session there."""
    config = zenoh.Config.from_json5(json.dumps(address.config(0.0)))
    session = await asyncio.to_thread(zenoh.open, config)
    try:
        yield Raw(session, address.robot)
    finally:
        await asyncio.to_thread(session.close)


def setpoint(sequence: int, token: str = "", x_mm: float = 1.0) -> Setpoint:
    return Setpoint(token=token, sequence=sequence, position_mm=[x_mm, 2.0, 100.0], valid_s=0.2)
