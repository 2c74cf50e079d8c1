"""Commands and set-points on their way to whoever carries them out. Runs on the event loop."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Final, Protocol

import msgspec

from daemon.messages import (
    COMMANDS,
    Answer,
    Command,
    Obstacles,
    Refusal,
    Setpoint,
    SetpointRefused,
    Status,
    Stop,
    verb,
)
from daemon.remote.server.question import Question
from daemon.remote.wire import WireError, decode, request_in, requested_format

STOP: Final = verb(Stop)
_KINDS: Final[dict[str, type[Command]]] = {verb(kind): kind for kind in COMMANDS}
_MOST_IN_HAND: Final = 8
_REFUSALS_EVERY_S: Final = 0.5
_ERRORS_EVERY_S: Final = 5.0
_MOST_KINDS_OF_ERRORS: Final = 64


class CommandHandler(Protocol):
    """What carries commands out. Called on the event loop."""

    def stop_now(self) -> None:
        """Quick stop on the bus before this returns. `handle` of a `stop` tells how it went."""
        ...

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        """Carry `command` out, or say why not. Several may be in hand: a `stop` never waits."""
        ...

    def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
        """Take a set-point; its numbers are finite, all else is to be checked."""
        ...

    def obstacles(self, user: str, obstacles: Obstacles | str) -> None:
        """Take obstacles that move; words: what came cannot be read. What is refused is told as an
        event."""
        ...

    def status(self) -> Status:
        """The robot as it is now."""
        ...


class CommandDesk:
    """Reads what operators send, has it carried out, and sees to it that each gets an answer."""

    def __init__(
        self,
        handler: CommandHandler,
        operators: Iterable[str],
        publish: Callable[[SetpointRefused], None],
        errors: "ErrorReports",
    ) -> None:
        self._handler = handler
        self._publish = publish
        self._errors = errors
        self._in_hand: dict[str, set[asyncio.Task[None]]] = {user: set() for user in operators}
        self._refused: dict[str, tuple[str, float]] = {}

    def command(self, user: str, question: Question) -> None:
        """Have it carried out; its first part before the loop's next turn is over."""
        in_hand = self._in_hand[user]
        if question.word != STOP and len(in_hand) >= _MOST_IN_HAND:
            question.refuse("busy", "too many commands are in hand: wait for their answers")
            return
        task = asyncio.create_task(self._carry_out(user, question))
        in_hand.add(task)
        task.add_done_callback(in_hand.discard)

    def setpoint(self, user: str, payload: bytes, encoding: str) -> None:
        """Hand a set-point in, or publish why not."""
        sequence = -1
        try:
            setpoint = decode(payload, Setpoint, requested_format(encoding))
            sequence = setpoint.sequence
            refused = self._handler.setpoint(user, setpoint)
        except WireError as error:
            refused = SetpointRefused(sequence=sequence, reason=str(error))
        except Exception as error:
            self._errors.tell(f"a set-point of {user}", error)
            refused = SetpointRefused(sequence=sequence, reason=f"internal: {error!r}")
        if refused is not None:
            self._tell(user, msgspec.structs.replace(refused, user=user))

    def obstacles(self, user: str, payload: bytes, encoding: str) -> None:
        """Hand obstacles in. What cannot be read is as if it had not come: their validity ends."""
        try:
            try:
                came: Obstacles | str = decode(payload, Obstacles, requested_format(encoding))
            except WireError as error:
                came = str(error)
            self._handler.obstacles(user, came)
        except Exception as error:
            self._errors.tell(f"obstacles of {user}", error)

    async def close(self, within_s: float) -> None:
        """Refuse what is in hand."""
        tasks = [task for tasks in self._in_hand.values() for task in tasks]
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks, timeout=within_s)

    async def _carry_out(self, user: str, question: Question) -> None:
        request = ""
        try:
            command = _read(question)
            request = command.request
            outcome = await self._handler.handle(user, command)
        except WireError as error:
            question.refuse(error.name, str(error), error.request)
        except asyncio.CancelledError:
            question.refuse("closing", "the daemon is ending", request)
            raise
        except Exception as error:
            self._errors.tell(question.key, error)
            question.refuse("internal", f"{type(error).__name__}: {error}", request)
        else:
            question.answer(outcome)

    def _tell(self, user: str, refused: SetpointRefused) -> None:
        """They are a stream: a reason is told when it is new, and now and then while it lasts."""
        now_s = asyncio.get_running_loop().time()
        reason, published_s = self._refused.get(user, ("", 0.0))
        if refused.reason != reason or now_s - published_s >= _REFUSALS_EVERY_S:
            self._refused[user] = (refused.reason, now_s)
            self._publish(refused)


def _read(question: Question) -> Command:
    kind = _KINDS.get(question.word)
    if kind is None or not question.exact:
        raise WireError("bad_key", f"there is no such command; there are {', '.join(_KINDS)}")
    if kind is Stop:  # whatever is said with it, and in whatever version: it is obeyed
        return Stop(request=request_in(question.payload))
    return decode(question.payload, kind, question.payload_format)


class ErrorReports:
    """Errors of ours, for the log: whoever asked is told too, and may ask again at once."""

    def __init__(self) -> None:
        self._reported_s: dict[str, float] = {}
        self._unsaid: dict[str, int] = {}

    def tell(self, what: str, error: Exception) -> None:
        """One and the same is told now and then, with how often it came meanwhile. On the loop."""
        loop = asyncio.get_running_loop()
        key = f"{what}: {type(error).__name__}"
        if key not in self._reported_s and len(self._reported_s) >= _MOST_KINDS_OF_ERRORS:
            key = "others"
        if loop.time() - self._reported_s.get(key, -_ERRORS_EVERY_S) < _ERRORS_EVERY_S:
            self._unsaid[key] = self._unsaid.get(key, 0) + 1
            return
        self._reported_s[key] = loop.time()
        unsaid = self._unsaid.pop(key, 0)
        more = f" (and {unsaid} times more before)" if unsaid else ""
        loop.call_exception_handler({"message": f"remote: {what}{more}", "exception": error})
