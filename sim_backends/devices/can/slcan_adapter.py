"""The bus through a serial CAN adapter that speaks SLCAN, on a pseudo-terminal."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from drivers.can.bus_lock import door_of
from drivers.can.frame import EXTENDED_FLAG, CanFrame
from drivers.can.slcan import (
    AdapterStatus,
    Close,
    Done,
    Empty,
    LineReader,
    Open,
    Queued,
    ReadSerialNumber,
    ReadStatus,
    ReadVersion,
    Received,
    Refused,
    Reply,
    SerialNumber,
    SetBitRate,
    SetBitTiming,
    SetTimestamps,
    SlcanCommand,
    SlcanError,
    StatusFlag,
    Transmit,
    Version,
    decode_command,
    encode_reply,
)
from drivers.clock import Clock
from drivers.exclusive_name import OtherName
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.port import ControllerState, Port
from sim_backends.devices.device import Pump
from sim_backends.devices.pty import Pty

_QUEUE_FRAMES: Final = 32
_VERSION: Final = Version(10, 13)
_SERIAL_NUMBER: Final = SerialNumber("EM01")

_ERROR_FLAGS: Final = {
    ControllerState.ACTIVE: 0,
    ControllerState.WARNING: StatusFlag.ERROR_WARNING,
    ControllerState.PASSIVE: StatusFlag.ERROR_WARNING | StatusFlag.ERROR_PASSIVE,
    ControllerState.OFF: (
        StatusFlag.ERROR_WARNING | StatusFlag.ERROR_PASSIVE | StatusFlag.BUS_ERROR
    ),
}


class SlcanAdapter:
    """An adapter and its serial port. Lives in the running event loop until closed.

    It does not come back from bus-off by itself: close and open it again (`C`, `O`).
    """

    def __init__(
        self,
        bus: CanBus,
        pump: Pump,
        clock: Clock,
        link: Path | None = None,
        door_of_bus: str = "",
    ) -> None:
        """link: a name that leads to the serial port while it is there. door_of_bus: a name for the
        bus, if there are several ways to it."""
        self._link = link
        self._door_of_bus = door_of_bus
        self._door: OtherName | None = None
        self._bus = bus
        self._pump = pump
        self._clock = clock
        self._reader = LineReader()
        self._opened: Open | None = None
        self._bit_rate_bit_s: int | None = None
        self._timestamps = False
        self._latched_flags = 0
        self._unsent = b""  # the rest of a line that the pty could not take whole
        self._port = bus.attach("slcan adapter", _QUEUE_FRAMES)
        self._port.connect(False)
        self._port.listen({}, self._frame)
        self._port.on_state = self._state_changed
        self._pty = self._plug_in() if bus.plugged else None
        bus.adapters.append(self)

    @property
    def path(self) -> Path:
        """The serial port. Raises FileNotFoundError while it is pulled out."""
        if self._pty is None:
            raise FileNotFoundError("the adapter is pulled out")
        return self._pty.path

    def close(self) -> None:
        """Away with it."""
        self.set_plugged(False)
        self._bus.adapters.remove(self)
        self._bus.detach(self._port)

    # As an adapter

    def ports(self) -> Iterator[Port]:
        return iter((self._port,))

    def set_up(self, up: bool) -> None:
        """A serial adapter is no network interface: it is set up by its own commands."""

    def set_plugged(self, plugged: bool) -> None:
        if plugged and self._pty is None:
            self._pty = self._plug_in()
        elif not plugged and self._pty is not None:
            self._leave()
            self._pty.close()
            self._pty = None
            if self._door is not None:
                self._door.release()
                self._door = None
            self._reader.clear()
            self._unsent = b""
            self._bit_rate_bit_s, self._timestamps = None, False

    def _plug_in(self) -> Pty:
        port = Pty(self._received, link=self._link)
        if self._door_of_bus:
            self._door = door_of(port.path, self._door_of_bus)
        return port

    # The serial side

    def _received(self, data: bytes) -> None:
        for line in self._reader.feed(data):
            try:
                reply = self._obey(decode_command(line))
            except SlcanError:
                reply = Refused()
            self._write(encode_reply(reply))
        self._pump.touch()

    def _obey(self, command: SlcanCommand) -> Reply:
        match command:
            case Transmit(frame):
                return self._transmit(frame)
            case Open():
                return self._enter(command)
            case Close():
                return self._leave()
            case SetBitRate(bit_s):
                return self._configure(bit_s)
            case SetBitTiming():
                # Register values of a crystal we do not have: taken for the bus' own rate.
                return self._configure(self._bus.bit_rate_bit_s)
            case SetTimestamps(on):
                if self._opened:
                    return Refused()
                self._timestamps = on
                return Done()
            case ReadStatus():
                return self._status()
            case ReadVersion():
                return _VERSION
            case ReadSerialNumber():
                return _SERIAL_NUMBER
            case Empty():
                return Done()

    def _enter(self, command: Open) -> Reply:
        if self._opened or self._bit_rate_bit_s is None:
            return Refused()
        self._opened = command
        self._port.listens_only = command.listen_only
        self._port.wrong_bit_rate = self._bit_rate_bit_s != self._bus.bit_rate_bit_s
        self._port.connect(True)
        return Done()

    def _leave(self) -> Reply:
        if not self._opened:
            return Refused()
        self._opened = None
        self._port.connect(False)
        return Done()

    def _configure(self, bit_s: int) -> Reply:
        if self._opened:
            return Refused()
        self._bit_rate_bit_s = bit_s
        return Done()

    def _transmit(self, frame: CanFrame) -> Reply:
        if not self._opened or self._opened.listen_only:
            return Refused()
        if not self._port.send(frame.can_id, frame.data, self._clock.now_ns()):
            self._latched_flags |= StatusFlag.TRANSMIT_QUEUE_FULL
            return Refused()
        return Queued(extended=bool(frame.can_id & EXTENDED_FLAG))

    def _status(self) -> Reply:
        if not self._opened:
            return Refused()
        flags = self._latched_flags | _ERROR_FLAGS[self._port.state]
        self._latched_flags = 0
        return AdapterStatus(flags)

    # The bus side

    def _frame(self, can_id: int, data: bytes, t_ns: int) -> None:
        stamp_ms = t_ns // 1_000_000 if self._timestamps else None
        line = encode_reply(Received(CanFrame(can_id, data), stamp_ms))
        if not self._write(line):
            self._port.received_lost += 1
            self._latched_flags |= StatusFlag.RECEIVE_QUEUE_FULL | StatusFlag.DATA_OVERRUN

    def _state_changed(self, state: ControllerState, _t_ns: int) -> None:
        self._latched_flags |= _ERROR_FLAGS[state]

    def _write(self, line: bytes) -> bool:
        """Whole lines or nothing: what did not fit goes first the next time."""
        if self._pty is None:
            return False
        if self._unsent:
            self._unsent = self._unsent[self._pty.write(self._unsent) :]
        if self._unsent:
            return False
        taken = self._pty.write(line)
        self._unsent = line[taken:] if taken else b""
        return taken > 0
