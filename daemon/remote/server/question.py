"""A query that waits for its answer. It always gets one: silence means that something is wrong."""

import threading
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from queue import SimpleQueue
from typing import Final

import zenoh

from daemon.messages import Message, Refusal
from daemon.remote.keys import is_exact, last_part
from daemon.remote.wire import Format, encode, encoding_of, requested_format

# Answers leave by a thread of their own: a client that does not read must not hold the loop.


Reply = Callable[[], None]

_MOST_WAITING: Final = 256


class ReplyThread:
    """Sends answers in their order, urgent ones first. Any thread may hand them in."""

    def __init__(self) -> None:
        self._urgent: deque[Reply] = deque()
        self._others: deque[Reply] = deque()
        self._wake: SimpleQueue[bool] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="remote replies", daemon=True)
        self._thread.start()

    def send(self, reply: Reply, *, urgent: bool = False) -> bool:
        """Have `reply` called; it must not raise. False: too many wait, and it is dropped."""
        waiting = self._urgent if urgent else self._others
        if len(waiting) >= _MOST_WAITING:
            return False
        waiting.append(reply)
        self._wake.put(True)
        return True

    def close(self, within_s: float) -> None:
        """Send what waits, then end; not later than `within_s`. Blocks."""
        self._wake.put(False)
        self._thread.join(within_s)

    def _run(self) -> None:
        # Every True stands for one answer, and False comes after all of them.
        while self._wake.get():
            reply = self._urgent.popleft() if self._urgent else self._others.popleft()
            reply()


_JSON_SCHEMA: Final = "application/schema+json"
_BYTES: Final = "application/octet-stream"


class Question:
    """One query, and the way back to whoever asked. `answer` or `refuse` is called once."""

    __slots__ = ("_query", "_replies", "_state", "key", "urgent", "word")

    def __init__(
        self,
        query: zenoh.Query,
        replies: ReplyThread,
        state: Callable[[], str],
        urgent_word: str = "",
    ) -> None:
        """state: the robot's, for refusals. urgent_word: its answer is sent before others."""
        self._query = query
        self._replies = replies
        self._state = state
        self.key = str(query.key_expr)
        self.word = last_part(self.key)
        """What is asked for."""
        self.urgent = self.word == urgent_word

    @property
    def exact(self) -> bool:
        """Whether one thing is asked for."""
        return is_exact(self.key)

    @property
    def payload(self) -> bytes:
        payload = self._query.payload
        return b"" if payload is None else payload.to_bytes()

    @property
    def payload_format(self) -> Format:
        """By the encoding. `?encoding=json` speaks of what is sent, too, where that is a map in
        JSON: none in msgpack begins with a brace."""
        if self._wants_json and self.payload.lstrip().startswith(b"{"):
            return Format.JSON
        return requested_format(self._query.encoding)

    @property
    def _wants_json(self) -> bool:
        return self._query.parameters.get("encoding") == "json"

    def matches(self, key: str) -> bool:
        """Whether `key` is among what is asked for."""
        return self._query.key_expr.intersects(key)

    def answer(self, message: Message) -> None:
        """Answer in the format that was asked for: by the encoding, or by `?encoding=json`."""
        form = Format.JSON if self._wants_json else self.payload_format
        payload, encoding = encode(message, form), encoding_of(message, form)

        def reply(query: zenoh.Query) -> None:
            if isinstance(message, Refusal):
                query.reply_err(payload, encoding=encoding)
            else:
                query.reply(self.key, payload, encoding=encoding)

        self._send(reply)

    def answer_schemas(self, schemas: Mapping[str, bytes]) -> None:
        """Answer with one schema per key."""

        def reply(query: zenoh.Query) -> None:
            for key, schema in schemas.items():
                query.reply(key, schema, encoding=_JSON_SCHEMA)

        self._send(reply)

    def answer_bytes(self, payload: bytes) -> None:
        """Answer with bytes that are no message."""
        self._send(lambda query: query.reply(self.key, payload, encoding=_BYTES))

    def refuse(self, name: str, text: str, request: str = "") -> None:
        """Say why there is no answer."""
        self.answer(Refusal(request=request, state=self._state(), name=name, text=text))

    def _send(self, reply: Callable[[zenoh.Query], None]) -> None:
        def send() -> None:
            with self._query as query, suppress(zenoh.ZError):  # the asker has left
                reply(query)

        if not self._replies.send(send, urgent=self.urgent):
            self._query.drop()  # type: ignore[no-untyped-call]
