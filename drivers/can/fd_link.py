"""Direct reading and writing of `struct can_frame` on a file descriptor.

For SocketCAN, and for the emulated bus, whose socket carries the same structs. A frame costs one
system call and one call-back; python-can's own receiving costs a message object and a queue more.
What a SocketCAN socket says by an errno the emulated one says by a packet of 4 bytes.
"""

import asyncio
import errno
import os
import socket
from collections.abc import Callable, Sequence
from typing import Final

from drivers.can.conditions import DOWN, QUEUE_FULL
from drivers.can.frame import (
    CAN_FRAME,
    ERROR_FLAG,
    EXTENDED_FLAG,
    FRAME_BYTES,
    REMOTE_FLAG,
    conditions_of_error_frame,
)
from drivers.can.link import FrameReceiver
from drivers.clock import Clock

_FRAMES_AT_ONCE: Final = 64  # then the loop gets its turn, however fast frames come
_NOT_DATA: Final = ERROR_FLAG | REMOTE_FLAG | EXTENDED_FLAG
_FULL: Final = {errno.ENOBUFS, errno.EAGAIN}
_ERRNO_BYTES: Final = 4
_UP_AGAIN_NS: Final = 200_000_000


class FdLink:
    """A CAN socket of one struct can_frame per packet.

    shutdown: closes the socket; whoever opened it may have more to do than that.
    """

    def __init__(
        self,
        link_socket: socket.socket,
        shutdown: Callable[[], None],
        receiver: FrameReceiver,
        clock: Clock,
    ) -> None:
        link_socket.setblocking(False)
        self._shutdown = shutdown
        self._socket = link_socket
        self._receiver = receiver
        self._clock = clock
        self._buffer = bytearray(FRAME_BYTES)
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(link_socket.fileno(), self.drain)
        self._closed = False
        self._down = self._full = False
        self._down_ns = 0

    def send(self, can_id: int, data: bytes) -> bool:
        try:
            self._socket.send(CAN_FRAME.pack(can_id, len(data), data))
        except OSError as error:
            self._send_failed(error)
            return False
        if self._full or self._down:
            self._sent_again()
        return True

    def send_all(self, frames: Sequence[tuple[int, bytes]]) -> int:
        send, pack = self._socket.send, CAN_FRAME.pack
        taken = 0
        try:
            for can_id, data in frames:
                send(pack(can_id, len(data), data))
                taken += 1
        except OSError as error:
            self._send_failed(error)
            return taken
        if self._full or self._down:
            self._sent_again()
        return taken

    def read_in_cycle(self, on: bool) -> None:
        if self._closed:
            return
        if on:
            self._loop.remove_reader(self._socket.fileno())
        else:
            self._loop.add_reader(self._socket.fileno(), self.drain)

    def close(self) -> None:
        if not self._closed:
            self._closed = True
            self._loop.remove_reader(self._socket.fileno())
            self._shutdown()

    def drain(self) -> None:
        if self._closed:
            return
        t_ns = self._clock.now_ns()
        receive, buffer = self._socket.recv_into, self._buffer
        unpack, deliver = CAN_FRAME.unpack_from, self._receiver.frame_received
        try:
            for _ in range(_FRAMES_AT_ONCE):
                size = receive(buffer)
                if size != FRAME_BYTES:
                    self._odd_packet(size)
                    return
                can_id, length, data = unpack(buffer)
                if can_id & _NOT_DATA:
                    self._not_data(can_id, data)
                else:
                    deliver(can_id, data[:length], t_ns)
        except BlockingIOError:
            return
        except OSError as error:  # also where a receiver has closed the link
            self._receive_failed(error)

    def _not_data(self, can_id: int, data: bytes) -> None:
        if can_id & ERROR_FLAG:
            for condition, present, detail in conditions_of_error_frame(can_id, data):
                self._receiver.condition_seen(condition, present, detail)

    def _odd_packet(self, size: int) -> None:
        if size == _ERRNO_BYTES:
            number = int.from_bytes(self._buffer[:_ERRNO_BYTES], "little")
            self._receive_failed(OSError(number, os.strerror(number)))
        elif size == 0:
            self._lose(ConnectionResetError(errno.ECONNRESET, "the other end has closed"))
        else:
            self._lose(OSError(errno.EPROTO, f"{size} bytes are not a CAN frame"))

    def _send_failed(self, error: OSError) -> None:
        if error.errno in _FULL:
            if not self._full:
                self._full = True
                self._receiver.condition_seen(QUEUE_FULL, True, errno.errorcode[error.errno])
        elif error.errno == errno.ENETDOWN:
            self._interface_down()
        else:
            self._lose(error)

    def _receive_failed(self, error: OSError) -> None:
        if error.errno == errno.ENETDOWN:  # the same socket works again after `up`
            self._interface_down()
        else:
            self._lose(error)

    def _interface_down(self) -> None:
        self._down_ns = self._clock.now_ns()
        if not self._down:
            self._down = True
            self._receiver.condition_seen(DOWN, True, "ENETDOWN")

    def _sent_again(self) -> None:
        if self._full:
            self._full = False
            self._receiver.condition_seen(QUEUE_FULL, False, "")
        if self._down and self._clock.now_ns() - self._down_ns > _UP_AGAIN_NS:
            self._down = False
            self._receiver.condition_seen(DOWN, False, "")

    def _lose(self, error: OSError) -> None:
        if not self._closed:
            self.close()
            self._receiver.link_lost(error)
