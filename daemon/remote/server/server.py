"""The daemon's side: publishes what the robot does, answers questions, hands commands in.

zenoh's threads only leave things in the inbox; everything is decided on the event loop; answers
leave by a thread of their own. So no client can hold the loop, whatever it sends or fails to read.
"""

import asyncio
import json
import os
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import zenoh

from config.paths import certificates_path
from config.remote import LOCAL_USER, Remote
from daemon.host.clock import MonotonicClock
from daemon.messages import (
    COMMANDS,
    Answer,
    Event,
    Events,
    Message,
    Obstacles,
    Refusal,
    Setpoint,
    SetpointRefused,
    Status,
    Surroundings,
    WhoAmI,
    tag,
)
from daemon.remote.access import User, daemon_config, unix_endpoint
from daemon.remote.bounded import call_bounded, close_session, open_until_exit
from daemon.remote.discovery import STOP_SOCKET, UNIX_SOCKET, RunningDaemon, RuntimeFolder
from daemon.remote.keys import TELEMETRY_KEYS, Keys
from daemon.remote.server.command_desk import STOP, CommandDesk, CommandHandler, ErrorReports
from daemon.remote.server.gateway_process import GatewayProcess, StopChannel
from daemon.remote.server.inbox import Inbox, Quota
from daemon.remote.server.question import Question, ReplyThread
from daemon.remote.server.stop_desk import LocalStopSocket, StopDesk
from daemon.remote.surroundings import PreparedSurroundings
from daemon.remote.wire import LARGEST_ANSWER_BYTES, encode, encoding_of, json_schema

Answering = Callable[[Question], None]

_KEY_OF: Final = {kind: name for name, kinds in TELEMETRY_KEYS.items() for kind in kinds}
_WITH_SCHEMA: Final[tuple[type[Message], ...]] = (
    *_KEY_OF,
    *COMMANDS,
    Setpoint,
    Obstacles,
    WhoAmI,
    Answer,
    Refusal,
    Events,
    Surroundings,
)
_FIRST: Final = frozenset({"state", "event"})
"""Published with a queue of their own, so that a congested subscriber still gets these."""
_QUESTIONS_PER_S: Final = 500
"""Of one user, besides commands; more are refused without the loop's doing."""
_ENDS_WITHIN_S: Final = 1.0
_EVENTS_KEPT: Final = 200
_DIGITS: Final = 9
"""Longer numbers of parts are none."""


class RemoteOpenError(RuntimeError):
    """The daemon cannot be reached by anybody; the text says why."""


class RemoteServer:
    """One robot's place on the wire. `publish` before `open` and after `close` does nothing."""

    def __init__(
        self,
        robot_name: str,
        settings: Remote,
        runtime_dir: Path,
        handler: CommandHandler,
        *,
        simulated: bool,
        version: str,
        robot_file_dir: Path = Path(),
        surroundings: PreparedSurroundings | None = None,
    ) -> None:
        """robot_file_dir: from where the settings' relative paths are seen. surroundings: of the
        body; None: nobody knows them."""
        self._keys = Keys(robot_name)
        self._settings = settings
        self._handler = handler
        self._simulated = simulated
        self._version = version
        self._robot_file_dir = robot_file_dir
        self._surroundings = surroundings or PreparedSurroundings(Surroundings(), ())
        self._events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self._folder = RuntimeFolder(runtime_dir, group=settings.group_may_connect)
        self._users = _users(settings)
        self._errors = ErrorReports()
        operators = [user.name for user in self._users if user.may_command]
        self._desk = CommandDesk(handler, operators, self.publish, self._errors)
        askers = [_reader(user.name) for user in self._users]
        self._inbox = Inbox[tuple[Question, Answering]]([*operators, *askers])
        self._stop_desk = StopDesk(handler, self._errors)
        self._stop_socket: LocalStopSocket | None = None
        self._stop_channel: StopChannel | None = None
        self._gateways: list[GatewayProcess] = []
        self._sessions: list[zenoh.Session] = []
        self._replies: ReplyThread | None = None
        self._alive: list[zenoh.LivelinessToken] = []
        self._publishers: dict[type[Message], list[zenoh.Publisher]] = {}
        self._last: dict[str, Message] = {}
        self._schemas = _schemas(self._keys)
        self._closed = False

    def publish(self, message: Message) -> None:
        """Tell everybody who listens; who does not keep up misses it. Never blocks or raises."""
        publishers = self._publishers.get(type(message))
        if publishers is None:
            return
        if not isinstance(message, SetpointRefused):
            self._last[_KEY_OF[type(message)]] = message
        if isinstance(message, Event):
            self._events.append(message)
        try:
            payload = encode(message)
            for publisher in publishers:
                publisher.put(payload)
        except zenoh.ZError:
            pass
        except Exception as error:  # what cannot be written must not stop who tells it
            self._errors.tell(f"publishing {_KEY_OF[type(message)]}", error)

    def show(self, surroundings: PreparedSurroundings) -> None:
        """Answer with these from now on."""
        self._surroundings = surroundings

    @property
    def surroundings_stl(self) -> bytes:
        """Their meshes, as they are answered."""
        return b"".join(self._surroundings.parts)

    # The life.

    async def open(self) -> None:
        """Begin to listen. Raises SecondDaemonError, FolderError, RemoteOpenError."""
        if not self._users:
            return
        self._folder.take()
        try:
            await self._open_sessions()
            self._open_stop()
            await self._open_gateways()
            self._folder.announce(self._announcement())
        except (OSError, ValueError, zenoh.ZError, RemoteOpenError) as error:
            await self.close()
            raise RemoteOpenError(f"nobody can reach the daemon: {error}") from None

    async def _open_sessions(self) -> None:
        """One for each user, so that nobody can use up what another one needs."""
        self._replies = ReplyThread()
        self._inbox.open(lambda waiting: waiting[1](waiting[0]), self._streamed)
        for user in self._users:
            path = self._session_path(user)
            config = daemon_config(self._keys, [user], [unix_endpoint(path)])
            session = await asyncio.to_thread(_open_session, config)
            self._sessions.append(session)
            path.chmod(self._socket_mode if user.name == LOCAL_USER else 0o600)
            self._declare(session, user, self._replies)

    def _open_stop(self) -> None:
        if self._settings.unix_socket:
            stop = partial(self._stop_desk.stop, LOCAL_USER)
            self._stop_socket = LocalStopSocket(self._stop_path, self._socket_mode, stop)

    async def _open_gateways(self) -> None:
        tls = self._settings.tls
        if tls is None:
            return
        folder = certificates_path(tls.certificates, self._robot_file_dir)
        for name in ("ca.pem", "server.pem", "server.key"):
            if not (folder / name).is_file():
                raise RemoteOpenError(
                    f"there is no {folder / name}; `tentacled certificates` makes it"
                )
        # Those who come over the network need it, and nobody else has to wait for it.
        from daemon.remote.server.tls_listener import server_context

        server_context(folder)
        users = {user.name: user for user in self._users if user.name != LOCAL_USER}
        sockets = {name: str(self._session_path(user)) for name, user in users.items()}
        roles = {name: user.role for name, user in users.items()}
        self._stop_channel = channel = StopChannel(self._stop_desk)
        for endpoint, known_users, stops in (
            (tls.stops_at, roles, channel.theirs),
            (tls.endpoint, sockets, None),
        ):
            try:
                gateway = GatewayProcess(endpoint, folder, known_users, self._errors, stops)
            except OSError as error:
                raise RemoteOpenError(f"{endpoint}: {error.strerror or error}") from None
            self._gateways.append(gateway)
            await gateway.start()

    async def close(self) -> None:
        """Refuse what is in hand and fall silent, within about three seconds. May be repeated."""
        if self._closed:
            return
        self._closed = True
        # Kept until the session is closed: to forget a publisher that is still declared takes a
        # lock of zenoh's while Python's is held, and who has that one may be waiting for Python's.
        publishers, self._publishers = self._publishers, {}
        if self._stop_socket is not None:
            self._stop_socket.close()
        await asyncio.gather(*(gateway.close() for gateway in self._gateways))
        if self._stop_channel is not None:
            self._stop_channel.close()
        await self._stop_desk.close()
        sessions, replies = self._sessions, self._replies
        if replies is not None:
            await self._desk.close(_ENDS_WITHIN_S)
            for question, _ in self._inbox.close():
                question.refuse("closing", "the daemon is ending")
            await call_bounded(lambda: _end(sessions, replies), 2 * _ENDS_WITHIN_S)
        publishers.clear()
        self._folder.give_back()

    @property
    def _socket_mode(self) -> int:
        return 0o660 if self._settings.group_may_connect else 0o600

    def _session_path(self, user: User) -> Path:
        """Where a user's session listens: for the gateway, unless the user is on this machine."""
        if user.name == LOCAL_USER:
            return self._socket_path
        return (self._folder.path / f"user-{self._users.index(user)}.sock").absolute()

    @property
    def _socket_path(self) -> Path:
        named = self._settings.unix_socket_path
        return (Path(named) if named else self._folder.path / UNIX_SOCKET).absolute()

    @property
    def _stop_path(self) -> Path:
        return (self._folder.path / STOP_SOCKET).absolute()

    def _announcement(self) -> RunningDaemon:
        return RunningDaemon(
            robot=self._keys.robot,
            pid=os.getpid(),
            version=self._version,
            simulated=self._simulated,
            unix_socket=str(self._socket_path) if self._settings.unix_socket else None,
            tls=self._settings.tls.endpoint if self._settings.tls else None,
            stop_socket=str(self._stop_path) if self._settings.unix_socket else None,
        )

    def _declare(self, session: zenoh.Session, user: User, replies: ReplyThread) -> None:
        keys, reader = self._keys, _reader(user.name)
        for kind, name in _KEY_OF.items():
            publisher = session.declare_publisher(
                keys.telemetry(name),
                encoding=encoding_of(kind),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_HIGH if name in _FIRST else zenoh.Priority.DATA,
            )
            self._publishers.setdefault(kind, []).append(publisher)
        quota = Quota(_QUESTIONS_PER_S, MonotonicClock())

        def answers(key: str, asker: str, answering: Answering) -> None:
            # Called on zenoh's threads: leave the question for the loop, and return at once.
            def on_query(query: zenoh.Query) -> None:
                question = Question(query, replies, self._state, STOP)
                leave = self._inbox.stop if question.urgent else self._inbox.question
                if asker == reader and not quota.take():
                    text = f"more than {_QUESTIONS_PER_S} questions a second: subscribe instead"
                    question.refuse("busy", text)
                elif not leave(asker, (question, answering)):
                    question.refuse("busy", "too many questions wait already: ask again")

            session.declare_queryable(key, zenoh.handlers.Callback(on_query, indirect=False))

        for name in TELEMETRY_KEYS:
            answers(keys.telemetry(name), reader, self._tell_last)
        answers(keys.schemas, reader, self._tell_schemas)
        answers(keys.events, reader, self._tell_events)
        answers(keys.surroundings, reader, self._tell_surroundings)
        answers(keys.surroundings_part(), reader, self._tell_surroundings_part)
        answers(keys.whoami(user.name), reader, self._whoami_teller(user))
        if user.may_command:
            answers(keys.commands(user.name), user.name, self._command_taker(user))
            session.declare_subscriber(keys.setpoint(user.name), self._stream_taker(user.name))
            watcher = self._stream_taker(_watcher(user.name))
            session.declare_subscriber(keys.obstacles(user.name), watcher)
        self._alive.append(session.liveliness().declare_token(keys.alive))

    # What is answered, on the loop.

    def _tell_last(self, question: Question) -> None:
        name = question.word
        try:
            last = self._handler.status() if name == "state" else self._last.get(name)
        except Exception as error:
            self._errors.tell(question.key, error)
            question.refuse("internal", f"{type(error).__name__}: {error}")
            return
        if last is None:
            question.refuse("nothing_yet", f"there has not been any '{name}' yet")
        else:
            question.answer(last)

    def _tell_schemas(self, question: Question) -> None:
        found = {k: schema for k, schema in self._schemas.items() if question.matches(k)}
        if found:
            question.answer_schemas(found)
        else:
            question.refuse("bad_key", f"there are {', '.join(self._schemas)}")

    def _tell_events(self, question: Question) -> None:
        told = list(self._events)
        while len(encode(Events(events=told))) > LARGEST_ANSWER_BYTES:
            told = told[len(told) // 2 :]
        question.answer(Events(events=told))

    def _tell_surroundings(self, question: Question) -> None:
        question.answer(self._surroundings.about)

    def _tell_surroundings_part(self, question: Question) -> None:
        parts, word = self._surroundings.parts, question.word
        if word.isdecimal() and len(word) < _DIGITS and int(word) < len(parts):
            question.answer_bytes(parts[int(word)])
        else:
            question.refuse("bad_key", f"the surroundings have {len(parts)} parts")

    def _whoami_teller(self, user: User) -> Answering:
        me = WhoAmI(
            robot=self._keys.robot,
            version=self._version,
            role=user.role,
            simulated=self._simulated,
        )
        return lambda question: question.answer(me)

    def _command_taker(self, user: User) -> Answering:
        return lambda question: self._desk.command(user.name, question)

    def _streamed(self, asker: str, payload: bytes, encoding: str) -> None:
        user = asker.removesuffix(_WATCHES)
        if user == asker:
            self._desk.setpoint(user, payload, encoding)
        else:
            self._desk.obstacles(user, payload, encoding)

    def _stream_taker(self, asker: str) -> "zenoh.handlers.Callback[zenoh.Sample]":
        def came(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                self._inbox.setpoint(asker, sample.payload.to_bytes(), str(sample.encoding))

        return zenoh.handlers.Callback(came, indirect=False)

    def _state(self) -> str:
        last = self._last.get("state")
        return last.state if isinstance(last, Status) else ""


def _reader(user: str) -> str:
    """In the inbox: the questions that only this user may ask, and that are no commands."""
    return f"{user} reads"


_WATCHES: Final = " watches"


def _watcher(user: str) -> str:
    """In the inbox: the stream of obstacles that this user sends."""
    return user + _WATCHES


def _users(settings: Remote) -> list[User]:
    local = settings.role(LOCAL_USER)
    users = [] if local is None else [User(LOCAL_USER, local)]
    return users + [User(name, role) for name, role in settings.users.items()]


def _schemas(keys: Keys) -> dict[str, bytes]:
    """By key, made beforehand: making them takes milliseconds, which the loop does not have."""
    kinds = {tag(kind).split("/")[0]: kind for kind in _WITH_SCHEMA}
    return {
        keys.schema(name): json.dumps(json_schema(kind)).encode() for name, kind in kinds.items()
    }


def _open_session(config: dict[str, Any]) -> zenoh.Session:
    zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
    try:
        return open_until_exit(zenoh.Config.from_json5(json.dumps(config)))
    except zenoh.ZError as error:
        raise RemoteOpenError(str(error)) from None


def _end(sessions: Sequence[zenoh.Session], replies: ReplyThread) -> None:
    replies.close(_ENDS_WITHIN_S)
    for session in sessions:
        close_session(session)
