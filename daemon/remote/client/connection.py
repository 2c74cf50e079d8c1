"""One connection to a daemon: questions with answers, or with a reason why there is none."""

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TypeVar, cast

import zenoh

from daemon.messages import Command, Message, Refusal, WhoAmI
from daemon.remote.bounded import call_bounded, close_session, open_until_exit
from daemon.remote.client.address import Address
from daemon.remote.client.client_errors import (
    AccessDeniedError,
    BadAnswerError,
    ClientError,
    DaemonNotRunningError,
    DisconnectedError,
    RefusedError,
    TimedOutError,
    VersionMismatchError,
)
from daemon.remote.keys import ANY_ROBOT_ALIVE, Keys, robot_of
from daemon.remote.wire import (
    WireError,
    decode,
    encode,
    encoding_of,
    requested_format,
)

M = TypeVar("M", bound=Message)

_Ask = Callable[[Callable[[], None]], None]
"""Asks something, and has the given function called once there are no more replies."""

_CLOSE_WITHIN_S: Final = 2.0
_WHY_WITHIN_S: Final = 1.0
_OPERATOR: Final = "operator"


class Connection:
    """A zenoh session of a client. Made by `connect`."""

    def __init__(self, address: Address, session: zenoh.Session) -> None:
        self.address = address
        self.session = session
        self.keys = Keys(address.robot)
        self._closed = False
        self._is_known = False
        """The daemon has answered this user before."""

    @classmethod
    async def connect(cls, address: Address, wait_s: float = 0.0) -> "Connection":
        """wait_s: for a daemon that is still starting. Raises ClientError."""
        try:
            config = zenoh.Config.from_json5(json.dumps(address.config(wait_s)))
        except ValueError as error:
            raise AccessDeniedError(str(error)) from None
        try:
            return cls(address, await asyncio.to_thread(open_until_exit, config))
        except zenoh.ZError:
            raise await asyncio.to_thread(address.why_not) from None

    def is_connected(self) -> bool:
        """Whether there is a way to the daemon now."""
        # Never session.is_closed(): it keeps Python's lock while it waits for one of zenoh's, and
        # who has that one may be waiting for Python's, to tell of a connection's end.
        return not self._closed and bool(self.session.info.transports())

    async def ask(
        self, key: str, kind: type[M], message: Message | None = None, within_s: float = 5.0
    ) -> M:
        """Ask, and get an answer of this kind. Raises ClientError."""
        sample = await self._sample(key, message, within_s)
        return read(sample.payload.to_bytes(), str(sample.encoding), kind)

    async def ask_bytes(self, key: str, within_s: float) -> bytes:
        """Ask for bytes that are no message. Raises ClientError."""
        return (await self._sample(key, None, within_s)).payload.to_bytes()

    async def _sample(self, key: str, message: Message | None, within_s: float) -> zenoh.Sample:
        replies = await self._get(key, message, within_s)
        if not replies:
            raise await self._why_silent(key)
        self._is_known = True
        reply = replies[0]
        if reply.err is not None:
            raise _error(reply.err, key, within_s)
        return cast(zenoh.Sample, reply.ok)

    async def whoami(self, within_s: float = 5.0) -> WhoAmI:
        """What this user may do. Raises ClientError."""
        return await self.ask(self.keys.whoami(self.address.user), WhoAmI, within_s=within_s)

    async def command(self, verb: str, command: Command, kind: type[M], within_s: float) -> M:
        """Have a command carried out. Raises ClientError."""
        return await self.ask(self.keys.command(self.address.user, verb), kind, command, within_s)

    async def close(self) -> None:
        """Hang up. Takes at most two seconds."""
        self._closed = True
        await call_bounded(lambda: close_session(self.session), _CLOSE_WITHIN_S)

    async def _get(self, key: str, message: Message | None, within_s: float) -> list[zenoh.Reply]:
        replies: list[zenoh.Reply] = []

        def ask(done: Callable[[], None]) -> None:
            self.session.get(
                key,
                zenoh.handlers.Callback(replies.append, done, indirect=False),
                payload=None if message is None else encode(message),
                encoding=None if message is None else encoding_of(message),
                timeout=within_s,
                express=True,
            )

        await self._called_back(ask, within_s)
        return replies

    async def _called_back(
        self, ask: Callable[[Callable[[], None]], None], within_s: float
    ) -> None:
        loop, over = asyncio.get_running_loop(), asyncio.Event()

        def done() -> None:
            with suppress(RuntimeError):  # nobody waits any more
                loop.call_soon_threadsafe(over.set)

        try:
            ask(done)
            async with asyncio.timeout(within_s + _WHY_WITHIN_S):
                await over.wait()
        except zenoh.ZError as error:
            raise DisconnectedError(f"the connection is closed: {error}") from None
        except TimeoutError:
            raise TimedOutError(f"no answer within {within_s:g} s") from None

    async def _why_silent(self, key: str) -> ClientError:
        """zenoh gives an empty answer for everything that has gone wrong: find out what."""
        if not self.is_connected():
            return self._gone()
        whoami_key = self.keys.whoami(self.address.user)
        replies = [] if key == whoami_key else await self._get(whoami_key, None, _WHY_WITHIN_S)
        if replies and replies[0].ok is not None:
            return self._why_not_that(key, replies[0].ok)
        robots = await self._robots()
        if robots and self.keys.robot not in robots:
            return DaemonNotRunningError(
                f"there is a daemon, but it is the one of {', '.join(robots)}, not of "
                f"{self.keys.robot}"
            )
        if not self.is_connected():
            return self._gone()
        if self._is_known:
            return self._no_answer(key)
        return AccessDeniedError(
            f"the daemon of {self.address} does not know the user '{self.address.user}': list it "
            "under `remote: {users: ...}` in the robot file, and use the certificate of that name"
        )

    def _gone(self) -> DisconnectedError:
        return DisconnectedError(f"the daemon of {self.address} has gone")

    def _why_not_that(self, key: str, sample: zenoh.Sample) -> ClientError:
        me = read(sample.payload.to_bytes(), str(sample.encoding), WhoAmI)
        if "/cmd/" in key and me.role != _OPERATOR:
            return AccessDeniedError(
                f"'{self.address.user}' is a {me.role} and may not command: that takes an operator"
            )
        return self._no_answer(key)

    def _no_answer(self, key: str) -> DisconnectedError:
        return DisconnectedError(f"the daemon has given no answer to {key}")

    async def _robots(self) -> list[str]:
        found: list[zenoh.Reply] = []

        def ask(done: Callable[[], None]) -> None:
            callback = zenoh.handlers.Callback(found.append, done, indirect=False)
            self.session.liveliness().get(ANY_ROBOT_ALIVE, callback, timeout=_WHY_WITHIN_S)

        await self._called_back(ask, _WHY_WITHIN_S)
        return sorted(robot_of(str(reply.ok.key_expr)) for reply in found if reply.ok is not None)


def read(payload: bytes, encoding: str, kind: type[M]) -> M:
    """What the daemon has sent. Raises VersionMismatchError, BadAnswerError."""
    try:
        return decode(payload, kind, requested_format(encoding))
    except WireError as error:
        if error.name == "bad_version":
            raise VersionMismatchError(f"the daemon is of another version: {error}") from None
        raise BadAnswerError(f"this is not what a daemon answers: {error}") from None


def _error(reply: zenoh.ReplyError, key: str, within_s: float) -> ClientError:
    payload = reply.payload.to_bytes()
    if payload == b"Timeout":
        return TimedOutError(f"no answer to {key} within {within_s:g} s")
    try:
        refusal = read(payload, str(reply.encoding), Refusal)
    except ClientError as error:
        return error
    if refusal.name == "bad_version":
        return VersionMismatchError(f"the daemon is of another version: {refusal.text}")
    return RefusedError(refusal)
