"""The lab's control socket: one JSON object per line asks, one per line answers."""

import asyncio
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

LONGEST_LINE_BYTES: Final = 65_536

Request = Mapping[str, Any]
Handler = Callable[[Request], Mapping[str, Any]]


class ControlServer:
    """Answers requests `{"do": VERB, ...}` with `{"ok": true, ...}` or `{"ok": false, "error": …}`.

    Handlers are quick and run in the event loop. Whatever a client sends, it gets an answer or is
    hung up on, and the others do not notice.
    """

    def __init__(self, handlers: Mapping[str, Handler]) -> None:
        self._handlers = handlers
        self._server: asyncio.Server | None = None

    async def listen(self, path: Path) -> None:
        """Start answering on the unix socket `path`."""
        self._server = await asyncio.start_unix_server(self._serve, path, limit=LONGEST_LINE_BYTES)

    async def close(self) -> None:
        """Answer no more."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def answer(self, line: bytes) -> Mapping[str, Any]:
        """The answer to one line."""
        try:
            request = json.loads(line)
        except ValueError as error:
            return _refusal(f"not JSON: {error}")
        if not isinstance(request, dict):
            return _refusal('a request is an object like {"do": "state"}')
        handler = self._handlers.get(str(request.get("do")))
        if handler is None:
            return _refusal(f"there is no {request.get('do')!r}: do {', '.join(self._handlers)}")
        try:
            return {"ok": True, **handler(request)}
        except ValueError as error:
            return _refusal(str(error))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while line := await reader.readline():
                writer.write(json.dumps(self.answer(line)).encode() + b"\n")
                await writer.drain()
        except (ConnectionError, ValueError):  # ValueError: a line without an end
            pass
        finally:
            writer.close()


def _refusal(error: str) -> Mapping[str, Any]:
    return {"ok": False, "error": error}
