"""A serial line as a driver sees it, whatever is behind it: a port, a pty, or an emulated wire."""

from collections.abc import Awaitable, Callable
from typing import Protocol


class ByteReceiver(Protocol):
    """The driver's side of a stream. Called from the event loop, never from another thread."""

    def bytes_received(self, data: bytes, t_ns: int) -> None:
        """Some bytes came, in whatever pieces; `t_ns` was taken when they were read."""
        ...

    def stream_lost(self, error: OSError) -> None:
        """The stream is gone and already closed. Called once, and not after `close`."""
        ...


class ByteStream(Protocol):
    """An open serial line, 8 data bits, no parity, 1 stop bit."""

    def write(self, data: bytes) -> None:
        """Queue bytes for sending. Never blocks; a failure arrives as `stream_lost`."""
        ...

    def set_baud_rate(self, baud_rate: int) -> None:
        """Change the host's rate, after everything written has left."""
        ...

    def discard_input(self) -> None:
        """Forget what has been received and not been read yet."""
        ...

    async def send_break(self) -> None:
        """Hold the line low long enough for any device to notice (0.3 s)."""
        ...

    def close(self) -> None:
        """Let go of the line. Safe to call twice, and after `stream_lost`."""
        ...


StreamOpener = Callable[[ByteReceiver], Awaitable[ByteStream]]
"""Opens the line anew, at 9600 baud. Raises StreamError where that is not possible."""


class StreamError(OSError):
    """The line cannot be opened. Says why and what to do about it, and which kind of failure it is:
    ENOENT, EACCES, EBUSY, or another errno."""

    def __init__(self, number: int, reason: str, remedy: str) -> None:
        super().__init__(number, f"{reason}: {remedy}")
        self.reason = reason
        self.remedy = remedy

    def __str__(self) -> str:
        return f"{self.reason}: {self.remedy}"
