"""The daemon's side: publishes what the robot does, answers questions, hands commands in.

zenoh's threads only leave things in the inbox; everything is decided on the event loop; answers
leave by a thread of their own. So no client can hold the loop, whatever it sends or fails to read.
"""

import asyncio
import json
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Final

import zenoh

from config.remote import LOCAL_USER, Remote
from daemon.remote.access import TLS, UNIX, User, daemon_config, server_tls, unix_endpoint
from daemon.remote.bounded import call_bounded, close_session, open_until_exit
from daemon.remote.command_desk import STOP, CommandDesk, CommandHandler, ErrorReports
from daemon.remote.discovery import STOP_SOCKET, UNIX_SOCKET, RunningDaemon, RuntimeFolder
from daemon.remote.inbox import Inbox
from daemon.remote.keys import TELEMETRY_KEYS, Keys
from daemon.remote.messages import (
    COMMANDS,
    Answer,
    Message,
    Refusal,
    Setpoint,
    SetpointRefused,
    Status,
    WhoAmI,
    tag,
)
from daemon.remote.question import Question
from daemon.remote.replies import ReplyThread
from daemon.remote.stop_desk import LocalStopSocket, StopDesk
from daemon.remote.wire import encode, encoding_of, json_schema

Answering = Callable[[Question], None]

_KEY_OF: Final = {kind: name for name, kinds in TELEMETRY_KEYS.items() for kind in kinds}
_WITH_SCHEMA: Final[tuple[type[Message], ...]] = (
    *_KEY_OF,
    *COMMANDS,
    Setpoint,
    WhoAmI,
    Answer,
    Refusal,
)
_FIRST: Final = frozenset({"state", "event"})
"""Published with a queue of their own, so that a congested subscriber still gets these."""
_READERS: Final = ""
"""In the inbox: the questions of which it is not known who asks."""
_ENDS_WITHIN_S: Final = 1.0


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
    ) -> None:
        """robot_file_dir: from where the settings' relative paths are seen."""
        self._keys = Keys(robot_name)
        self._settings = settings
        self._handler = handler
        self._simulated = simulated
        self._version = version
        self._robot_file_dir = robot_file_dir
        self._folder = RuntimeFolder(runtime_dir, group=settings.group_may_connect)
        self._users = _users(settings)
        self._errors = ErrorReports()
        operators = [user.name for user in self._users if user.may_command]
        self._desk = CommandDesk(handler, operators, self.publish, self._errors)
        askers = [_reader(user.name) for user in self._users]
        self._inbox = Inbox[tuple[Question, Answering]]([*operators, *askers, _READERS])
        self._stop_desk = StopDesk(handler, self._errors)
        self._stop_socket: LocalStopSocket | None = None
        self._session: zenoh.Session | None = None
        self._replies: ReplyThread | None = None
        self._alive: zenoh.LivelinessToken | None = None
        self._publishers: dict[type[Message], zenoh.Publisher] = {}
        self._last: dict[str, Message] = {}
        self._schemas = _schemas(self._keys)
        self._closed = False

    def publish(self, message: Message) -> None:
        """Tell everybody who listens; who does not keep up misses it. Never blocks or raises."""
        publisher = self._publishers.get(type(message))
        if publisher is None:
            return
        if not isinstance(message, SetpointRefused):
            self._last[_KEY_OF[type(message)]] = message
        try:
            publisher.put(encode(message))
        except zenoh.ZError:
            pass
        except Exception as error:  # what cannot be written must not stop who tells it
            self._errors.tell(f"publishing {_KEY_OF[type(message)]}", error)

    # The life.

    async def open(self) -> None:
        """Begin to listen. Raises SecondDaemonError, FolderError, RemoteOpenError."""
        if not self._users:
            return
        self._folder.take()
        try:
            config = self._config()
            session = await asyncio.to_thread(_open_session, config)
        except (ValueError, RemoteOpenError) as error:
            self._folder.give_back()
            raise RemoteOpenError(f"nobody can reach the daemon: {error}") from None
        self._session = session
        self._replies = ReplyThread()
        self._inbox.open(lambda asked: asked[1](asked[0]), self._desk.setpoint)
        try:
            if self._settings.unix_socket:
                mode = 0o660 if self._settings.group_may_connect else 0o600
                self._socket_path.chmod(mode)
                self._stop_socket = LocalStopSocket(
                    self._stop_path, mode, partial(self._stop_desk.stop, LOCAL_USER)
                )
            self._declare(session, self._replies)
            self._folder.announce(self._announcement())
        except (OSError, zenoh.ZError) as error:
            await self.close()
            raise RemoteOpenError(f"nobody can reach the daemon: {error}") from None

    async def close(self) -> None:
        """Refuse what is in hand and fall silent, within about three seconds. May be repeated."""
        if self._closed:
            return
        self._closed = True
        # Kept until the session is closed: to forget a publisher that is still declared takes a
        # lock of zenoh's while Python's is held, and who has that one may be waiting for Python's.
        publishers, self._publishers = self._publishers, {}
        session, replies = self._session, self._replies
        if self._stop_socket is not None:
            self._stop_socket.close()
        await self._stop_desk.close()
        if session is not None and replies is not None:
            await self._desk.close(_ENDS_WITHIN_S)
            for question, _ in self._inbox.close():
                question.refuse("closing", "the daemon is ending")
            await call_bounded(lambda: _end(session, replies), 2 * _ENDS_WITHIN_S)
        publishers.clear()
        self._folder.give_back()

    def _config(self) -> dict[str, Any]:
        endpoints, tls = [], None
        if self._settings.unix_socket:
            endpoints.append(unix_endpoint(self._socket_path))
        if self._settings.tls is not None:
            endpoints.append(f"{TLS}/{self._settings.tls.endpoint}")
            folder = (self._robot_file_dir / self._settings.tls.certificates).absolute()
            for name in ("ca.pem", "server.pem", "server.key"):
                if not (folder / name).is_file():
                    raise RemoteOpenError(
                        f"there is no {folder / name}; `tentacled certificates` makes it"
                    )
            tls = server_tls(folder)
        return daemon_config(self._keys, self._users, endpoints, tls)

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

    def _declare(self, session: zenoh.Session, replies: ReplyThread) -> None:
        keys = self._keys
        for kind, name in _KEY_OF.items():
            self._publishers[kind] = session.declare_publisher(
                keys.telemetry(name),
                encoding=encoding_of(kind),
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_HIGH if name in _FIRST else zenoh.Priority.DATA,
            )

        def answers(key: str, asker: str, answering: Answering) -> None:
            # Called on zenoh's threads: leave the question for the loop, and return at once.
            def asked(query: zenoh.Query) -> None:
                question = Question(query, replies, self._state, STOP)
                leave = self._inbox.stop if question.urgent else self._inbox.question
                if not leave(asker, (question, answering)):
                    question.refuse("busy", "too many questions wait already: ask again")

            session.declare_queryable(key, zenoh.handlers.Callback(asked, indirect=False))

        for name in TELEMETRY_KEYS:
            answers(keys.telemetry(name), _READERS, self._tell_last)
        answers(keys.schemas, _READERS, self._tell_schemas)
        for user in self._users:
            answers(keys.whoami(user.name), _reader(user.name), self._whoami_teller(user))
            if user.may_command:
                answers(keys.commands(user.name), user.name, self._command_taker(user))
                session.declare_subscriber(keys.setpoint(user.name), self._setpoint_taker(user))
        self._alive = session.liveliness().declare_token(keys.alive)

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

    def _setpoint_taker(self, user: User) -> "zenoh.handlers.Callback[zenoh.Sample]":
        def came(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                self._inbox.setpoint(user.name, sample.payload.to_bytes(), str(sample.encoding))

        return zenoh.handlers.Callback(came, indirect=False)

    def _state(self) -> str:
        last = self._last.get("state")
        return last.state if isinstance(last, Status) else ""


def _reader(user: str) -> str:
    """In the inbox: the questions that only this user may ask, and that are no commands."""
    return f"{user} reads"


def _users(settings: Remote) -> list[User]:
    local = settings.role(LOCAL_USER)
    users = [] if local is None else [User(LOCAL_USER, local, UNIX)]
    return users + [User(name, role, TLS) for name, role in settings.users.items()]


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


def _end(session: zenoh.Session, replies: ReplyThread) -> None:
    replies.close(_ENDS_WITHIN_S)
    close_session(session)
