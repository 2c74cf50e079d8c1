"""Any interface of python-can, through python-can's own sending and receiving.

For adapters that have no descriptor of plain frames. Receiving costs a message object per frame,
and where the interface cannot be polled a thread that does nothing but wait.
"""

import asyncio
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final

import can

from drivers.can.conditions import ERRORS, QUEUE_FULL
from drivers.can.link import FrameReceiver
from drivers.clock import Clock

_FRAMES_AT_ONCE: Final = 64
_THREAD_WAKES_S: Final = 0.1
_ECHOES_KEPT: Final = 1024  # of some ten cycles of the largest robots


class PythonCanLink:
    """A `can.BusABC` as a link."""

    def __init__(
        self,
        bus: can.BusABC,
        receiver: FrameReceiver,
        clock: Clock,
        on_closed: Callable[[], None] = lambda: None,
        *,
        echoes: bool = False,
    ) -> None:
        """on_closed: called when the interface has been let go of, in a thread of its own. echoes:
        what is sent comes back unmarked, as if others had sent it."""
        self._bus = bus
        self._on_closed = on_closed
        self._receiver = receiver
        self._clock = clock
        self._loop = asyncio.get_running_loop()
        self._open = True
        self._full = False
        self._echoes: deque[tuple[int, bytes]] | None = None
        """What has been sent and has not come back yet."""
        if echoes:
            self._echoes = deque(maxlen=_ECHOES_KEPT)
        self._fd = _descriptor(bus)
        if self._fd >= 0:
            self._loop.add_reader(self._fd, self._readable)
        else:
            threading.Thread(target=self._wait, name="can-receive", daemon=True).start()

    def send(self, can_id: int, data: bytes) -> bool:
        if not self._open:
            return False
        message = can.Message(arbitration_id=can_id, data=data, is_extended_id=False, check=False)
        try:
            self._bus.send(message, timeout=0)
        except can.CanError as error:  # most tell of a lost adapter when they receive
            self._queue_full(True, str(error))
            return False
        except OSError as error:  # and some here, in the words of whatever is behind them
            self._lose(error)
            return False
        if self._echoes is not None:
            self._echoes.append((can_id, data))
        self._queue_full(False, "")
        return True

    def send_all(self, frames: Sequence[tuple[int, bytes]]) -> int:
        for taken, (can_id, data) in enumerate(frames):
            if not self.send(can_id, data):
                return taken
        return len(frames)

    def read_in_cycle(self, on: bool) -> None:
        """Nothing to choose: python-can has its own way to read."""

    def drain(self) -> None:
        """Frames are delivered when they come."""

    def close(self) -> None:
        if self._open:
            self._open = False
            if self._fd >= 0:
                self._loop.remove_reader(self._fd)
                # A vendor's library may take its time, for ever where its adapter is dead.
                threading.Thread(target=self._shut_down, name="can-close", daemon=True).start()

    def _readable(self) -> None:
        t_ns = self._clock.now_ns()
        try:
            for _ in range(_FRAMES_AT_ONCE):
                message = self._bus.recv(0)
                if message is None or not self._open:
                    return
                self._deliver(message, t_ns)
        except (can.CanError, OSError, ValueError) as error:
            self._lose(_failure(error))

    def _wait(self) -> None:
        """The waiting thread's whole life. It alone receives, and it closes the interface."""
        try:
            while self._open:
                message = self._bus.recv(_THREAD_WAKES_S)
                if message is not None:
                    t_ns = self._clock.now_ns()
                    self._loop.call_soon_threadsafe(self._deliver, message, t_ns)
        except (can.CanError, OSError, ValueError) as error:
            self._loop.call_soon_threadsafe(self._lose, _failure(error))
        except RuntimeError:  # the loop has closed before us
            pass
        finally:
            self._shut_down()

    def _shut_down(self) -> None:
        try:
            self._bus.shutdown()
        finally:
            self._on_closed()

    def _deliver(self, message: can.Message, t_ns: int) -> None:
        if not self._open:
            return
        if message.is_error_frame:
            self._receiver.condition_seen(ERRORS, True, f"error frame {message.data.hex()}")
            self._receiver.condition_seen(ERRORS, False, "")
        elif message.is_rx and not (
            message.is_remote_frame or message.is_extended_id or message.is_fd
        ):
            can_id, data = message.arbitration_id, bytes(message.data)
            if not (self._echoes and self._is_echo(can_id, data)):
                self._receiver.frame_received(can_id, data, t_ns)

    def _is_echo(self, can_id: int, data: bytes) -> bool:
        """They come in order; those before it were lost on their way."""
        assert self._echoes is not None
        if (can_id, data) not in self._echoes:
            return False
        while self._echoes.popleft() != (can_id, data):
            pass
        return True

    def _queue_full(self, full: bool, detail: str) -> None:
        if full != self._full:
            self._full = full
            self._receiver.condition_seen(QUEUE_FULL, full, detail)

    def _lose(self, error: OSError) -> None:
        if self._open:
            self.close()
            self._receiver.link_lost(error)


def _descriptor(bus: can.BusABC) -> int:
    try:
        return bus.fileno()
    except NotImplementedError:
        return -1


def _failure(error: Exception) -> OSError:
    """Some texts have a traceback behind their first line."""
    text, code = (str(error).splitlines() or [""])[0], getattr(error, "error_code", None)
    return OSError(text) if code is None else OSError(code, text)
