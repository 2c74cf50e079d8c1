"""When bytes came over the loopback interface for a port, or from it, as the kernel dates them.

What a client has to do before its first byte leaves is not in these times, and neither is how long
it waits for its turn on a busy machine: they are what a client elsewhere would see.
"""

import ctypes
import select
import socket
import struct
import threading
import time
from contextlib import suppress
from types import TracebackType
from typing import Final

_INTERFACE: Final = "lo"
_ALL_PROTOCOLS: Final = 0x0003
_IPV4: Final = 0x0800
_OUTGOING: Final = 4
"""Packets of the loopback interface are seen twice: as they leave, and as they come."""
_SO_ATTACH_FILTER: Final = 26
_SO_TIMESTAMPNS: Final = 35
_TIMESPEC: Final = struct.Struct("@qq")
_LOOK_EVERY_S: Final = 0.1
_BUFFER_BYTES: Final = 1 << 22
_WHOLE_PACKET: Final = 0x40000


def _filter(port: int, answers: bool) -> bytes:
    """TCP over IPv4 to that port, or from it, with bytes in it: for the kernel's packet filter.

    Steps as linux/bpf.h has them: code, operand, and whether the packet is dropped where a
    comparison fails, or holds.
    """
    half, byte, half_behind, header_length = 0x28, 0x30, 0x48, 0xB1  # loads; the last one into X
    equal, and_, shift_right, add_x, subtract_x = 0x15, 0x54, 0x74, 0x0C, 0x1C
    to_x, keep, fails, holds = 0x07, 0x06, "fails", "holds"
    steps: list[tuple[int, int, str]] = [
        (half, 12, ""),
        (equal, _IPV4, fails),
        (byte, 23, ""),
        (equal, socket.IPPROTO_TCP, fails),
        (header_length, 14, ""),
        (half_behind, 14 if answers else 16, ""),
        (equal, port, fails),
        (0x50, 26, ""),  # a byte behind the IP header: the length of TCP's is in its upper half
        (and_, 0xF0, ""),
        (shift_right, 2, ""),
        (add_x, 0, ""),
        (to_x, 0, ""),
        (half, 16, ""),  # of the whole packet
        (subtract_x, 0, ""),
        (equal, 0, holds),
        (keep, _WHOLE_PACKET, ""),
        (keep, 0, ""),  # drops it
    ]
    code = b""
    for place, (operation, operand, dropped) in enumerate(steps):
        to_end = len(steps) - 2 - place
        jumps = (to_end if dropped == holds else 0, to_end if dropped == fails else 0)
        code += struct.pack("HBBI", operation, *jumps, operand)
    return code


class WireTap:
    """Listens from `with` to its end, in a thread. Raises PermissionError: it takes root."""

    def __init__(self, port: int, *, answers: bool = False) -> None:
        """answers: listens for what comes from the port, instead of what goes to it."""
        self._packets_ns: list[int] = []
        self._ended = threading.Event()
        self._socket = socket.socket(
            socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ALL_PROTOCOLS)
        )
        code = _filter(port, answers)
        self._code = ctypes.create_string_buffer(code)
        program = struct.pack("HL", len(code) // 8, ctypes.addressof(self._code))
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, program)
        self._socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER_BYTES)
        self._socket.bind((_INTERFACE, 0))
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> "WireTap":
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def between(self, from_ns: int, to_ns: int) -> list[int]:
        """When those came that came then, in order, on the monotonic clock."""
        return [t_ns for t_ns in tuple(self._packets_ns) if from_ns <= t_ns <= to_ns]

    def _listen(self) -> None:
        while not self._ended.is_set():
            if select.select([self._socket], [], [], _LOOK_EVERY_S)[0]:
                with suppress(OSError):
                    self._take()

    def _take(self) -> None:
        _, ancillary, _, address = self._socket.recvmsg(1, 256)
        if address[2] == _OUTGOING:
            return
        offset_ns = time.monotonic_ns() - time.time_ns()
        for level, kind, value in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESPEC.unpack(value[: _TIMESPEC.size])
                self._packets_ns.append(seconds * 1_000_000_000 + nanoseconds + offset_ns)
