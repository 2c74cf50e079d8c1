"""The python-can interface `tentacled`: the emulated bus for anything that uses python-can."""

import errno
import os
import select
import socket
from typing import Any, Final

import can

from drivers.can.frame import (
    CAN_FRAME,
    ERROR_FLAG,
    EXTENDED_FLAG,
    EXTENDED_ID_MASK,
    FRAME_BYTES,
    REMOTE_FLAG,
    STANDARD_ID_MASK,
)
from sim_backends.devices.can.socket_server import ERRNO

_SO_TIMESTAMPNS: Final = 35
_TIMESTAMP_BYTES: Final = 64
_SEND_BUFFER_BYTES: Final = 16384
"""About twenty frames: what one cycle sends at once, and hardly more that could grow stale."""


class EmulatedCanBus(can.BusABC):
    """A client of the emulated bus. `channel`: path of the bus' socket."""

    carries_can_frames = True
    """Its socket carries one struct can_frame per packet, so that frames can be read directly."""

    def __init__(
        self, channel: Any, can_filters: can.typechecking.CanFilters | None = None, **kwargs: Any
    ) -> None:
        self.channel_info = f"emulated CAN bus at {channel}"
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            self.socket.connect(str(channel))
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
            self.socket.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
        except OSError as error:
            self.socket.close()
            raise can.CanInitializationError(
                f"no emulated bus at {channel}: {error.strerror}. Is the emulated lab running?",
                error.errno,
            ) from error
        self.socket.setblocking(False)
        super().__init__(channel=channel, can_filters=can_filters, **kwargs)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Hand a frame to the emulated controller.

        Raises CanOperationError with ENOBUFS where its transmit queue is full, and stays so for
        `timeout` seconds.
        """
        if msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError("the emulated bus is classical CAN", errno.EINVAL)
        packet = _pack(msg)
        if self._send_now(packet):
            return
        if timeout and select.select([], [self.socket], [], timeout)[1] and self._send_now(packet):
            return
        raise can.CanOperationError("Transmit buffer full", errno.ENOBUFS)

    def _send_now(self, packet: bytes) -> bool:
        try:
            self.socket.send(packet)
        except BlockingIOError:
            return False
        except OSError as error:
            raise can.CanOperationError(
                f"Failed to transmit: {error.strerror}", error.errno
            ) from error
        return True

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            if not select.select([self.socket], [], [], timeout)[0]:
                return None, False
            packet, ancillary, _, _ = self.socket.recvmsg(FRAME_BYTES, _TIMESTAMP_BYTES)
        except BlockingIOError:
            return None, False
        except (OSError, ValueError) as error:
            number = error.errno if isinstance(error, OSError) else errno.EBADF
            raise can.CanOperationError(f"Error receiving: {error}", number) from error
        return _unpack(packet, _timestamp_s(ancillary), str(self.channel_info)), False

    def fileno(self) -> int:
        return self.socket.fileno()

    def shutdown(self) -> None:
        super().shutdown()
        self.socket.close()


def _pack(msg: can.Message) -> bytes:
    can_id = msg.arbitration_id
    if msg.is_extended_id:
        can_id |= EXTENDED_FLAG
    if msg.is_remote_frame:
        return CAN_FRAME.pack(can_id | REMOTE_FLAG, msg.dlc, b"")
    return CAN_FRAME.pack(can_id, msg.dlc, bytes(msg.data))


def _unpack(packet: bytes, timestamp_s: float, channel: str) -> can.Message:
    """Raises CanOperationError where the packet says that the interface is down, or gone."""
    if len(packet) == ERRNO.size:
        (number,) = ERRNO.unpack(packet)
        raise can.CanOperationError(f"Error receiving: {os.strerror(number)}", number)
    if len(packet) != FRAME_BYTES:
        raise can.CanOperationError("the emulated adapter has been pulled out", errno.ENODEV)
    can_id, length, data = CAN_FRAME.unpack(packet)
    extended = bool(can_id & EXTENDED_FLAG)
    error = bool(can_id & ERROR_FLAG)
    remote = bool(can_id & REMOTE_FLAG)
    return can.Message(
        timestamp=timestamp_s,
        channel=channel,
        arbitration_id=can_id & (EXTENDED_ID_MASK if extended or error else STANDARD_ID_MASK),
        is_extended_id=extended,
        is_remote_frame=remote,
        is_error_frame=error,
        dlc=length,
        data=None if remote else data[:length],
    )


def _timestamp_s(ancillary: list[tuple[int, int, bytes]]) -> float:
    """When the kernel had the packet, as seconds since 1970."""
    for level, kind, data in ancillary:
        if (level, kind) == (socket.SOL_SOCKET, _SO_TIMESTAMPNS):
            seconds = int.from_bytes(data[:8], "little", signed=True)
            return seconds + int.from_bytes(data[8:16], "little") * 1e-9
    return 0.0
