"""A stream of what the daemon publishes: the newest messages win, and its end is told."""

import asyncio
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from types import TracebackType
from typing import Final

import zenoh

from daemon.messages import Message
from daemon.remote.client.client_errors import DisconnectedError
from daemon.remote.keys import TELEMETRY_KEYS, Keys
from daemon.remote.wire import WireError, decode_one_of, requested_format

_Came = tuple[str, bytes, str]

DEPTH: Final = 64


class Subscription:
    """An asynchronous iterator. One that is read too slowly misses the oldest messages."""

    def __init__(
        self, session: zenoh.Session, keys: Keys, names: Sequence[str], depth: int
    ) -> None:
        """names: of TELEMETRY_KEYS. Raises ValueError."""
        self.missed = 0
        """Messages that were there and were not read in time."""
        self.unreadable = 0
        """Messages that this version does not understand."""
        self._waiting: deque[_Came] = deque(maxlen=depth)
        self._news = asyncio.Event()
        self._loop = asyncio.get_running_loop()
        self._gone = False
        self._subscribers = [self._subscriber(session, keys.telemetry(n), n) for n in names]

    async def __aenter__(self) -> "Subscription":
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def __aiter__(self) -> "Subscription":
        return self

    async def __anext__(self) -> Message:
        """The next message. Raises DisconnectedError once the daemon has gone."""
        while True:
            while self._waiting:
                message = self._read(self._waiting.popleft())
                if message is not None:
                    return message
            if self._gone:
                raise DisconnectedError("the daemon has gone")
            self._news.clear()
            if not self._waiting:
                await self._news.wait()

    def daemon_gone(self, gone: bool) -> None:
        """The daemon has gone, or has come back. On the loop."""
        self._gone = gone
        self._news.set()

    def close(self) -> None:
        """Listen no more."""
        for subscriber in self._subscribers:
            with suppress(zenoh.ZError):
                subscriber.undeclare()  # type: ignore[no-untyped-call]
        self._subscribers.clear()

    def _subscriber(self, session: zenoh.Session, key: str, name: str) -> zenoh.Subscriber[None]:
        def came(sample: zenoh.Sample) -> None:
            if sample.kind != zenoh.SampleKind.PUT:
                return
            if len(self._waiting) == self._waiting.maxlen:
                self.missed += 1
            self._waiting.append((name, sample.payload.to_bytes(), str(sample.encoding)))
            if not self._news.is_set():
                with suppress(RuntimeError):  # the loop has ended without us
                    self._loop.call_soon_threadsafe(self._news.set)

        return session.declare_subscriber(key, zenoh.handlers.Callback(came, indirect=False))

    def _read(self, came: _Came) -> Message | None:
        name, payload, encoding = came
        try:
            return decode_one_of(payload, TELEMETRY_KEYS[name], requested_format(encoding))
        except WireError:
            self.unreadable += 1
            return None
