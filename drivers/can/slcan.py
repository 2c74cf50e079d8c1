"""SLCAN, the ASCII protocol of serial CAN adapters (Lawicel CANUSB/CAN232), both directions.

A line is a letter, its digits, and CR. The adapter answers each with CR (done) or BEL (refused),
and sends what it receives from the bus as lines of the same form.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from drivers.can.frame import (
    ERROR_FLAG,
    EXTENDED_FLAG,
    EXTENDED_ID_MASK,
    REMOTE_FLAG,
    STANDARD_ID_MASK,
    CanFrame,
)

CR: Final = b"\r"
BEL: Final = b"\a"

MAX_LINE_BYTES: Final = 30
"""`T`, 8 digits of ID, length, 16 digits of data, 4 of time stamp."""

TIMESTAMP_MODULUS_MS: Final = 60_000

BIT_RATE_OF_CODE: Final = {
    0: 10_000,
    1: 20_000,
    2: 50_000,
    3: 100_000,
    4: 125_000,
    5: 250_000,
    6: 500_000,
    7: 800_000,
    8: 1_000_000,
}
"""What `S0` to `S8` set, in bit/s."""


class SlcanError(ValueError):
    """A line that is not SLCAN. Shows the line."""


# What the host tells the adapter.


@dataclass(frozen=True, slots=True)
class Transmit:
    """`t`, `T`, `r`, `R`: send a frame."""

    frame: CanFrame


@dataclass(frozen=True, slots=True)
class SetBitRate:
    """`S`: bit rate in bit/s, before opening."""

    bit_s: int


@dataclass(frozen=True, slots=True)
class SetBitTiming:
    """`s`: the bit timing registers of an SJA1000, before opening."""

    btr0: int
    btr1: int


@dataclass(frozen=True, slots=True)
class Open:
    """`O`, or `L` to listen without ever driving the bus."""

    listen_only: bool = False


@dataclass(frozen=True, slots=True)
class Close:
    """`C`: leave the bus."""


@dataclass(frozen=True, slots=True)
class ReadStatus:
    """`F`: send the status flags, and clear them."""


@dataclass(frozen=True, slots=True)
class ReadVersion:
    """`V`: send hardware and software version."""


@dataclass(frozen=True, slots=True)
class ReadSerialNumber:
    """`N`: send the serial number."""


@dataclass(frozen=True, slots=True)
class SetTimestamps:
    """`Z`: time stamps on received frames, on or off, before opening."""

    on: bool


@dataclass(frozen=True, slots=True)
class Empty:
    """A CR of its own: hosts send some to flush the adapter's line buffer."""


SlcanCommand = (
    Transmit
    | SetBitRate
    | SetBitTiming
    | Open
    | Close
    | ReadStatus
    | ReadVersion
    | ReadSerialNumber
    | SetTimestamps
    | Empty
)

# What the adapter tells the host.


@dataclass(frozen=True, slots=True)
class Received:
    """A frame from the bus. `timestamp_ms` counts to 59999 and starts again; None: switched off."""

    frame: CanFrame
    timestamp_ms: int | None = None


@dataclass(frozen=True, slots=True)
class Done:
    """CR: the last command was carried out."""


@dataclass(frozen=True, slots=True)
class Refused:
    """BEL: the last command was not carried out."""


@dataclass(frozen=True, slots=True)
class Queued:
    """`z` or `Z`: the last frame, standard or extended, was taken for sending."""

    extended: bool = False


@dataclass(frozen=True, slots=True)
class AdapterStatus:
    """`F`: a set of `StatusFlag`."""

    flags: int


@dataclass(frozen=True, slots=True)
class Version:
    """`V`: hardware and software version, two digits each: 1013 is 1.0 and 1.3."""

    hardware: int
    software: int


@dataclass(frozen=True, slots=True)
class SerialNumber:
    """`N`: four characters."""

    text: str


Reply = Received | Done | Refused | Queued | AdapterStatus | Version | SerialNumber


class StatusFlag:
    """Bits of the status that `F` asks for. Bus-off has none of its own."""

    RECEIVE_QUEUE_FULL: Final = 1 << 0
    TRANSMIT_QUEUE_FULL: Final = 1 << 1
    ERROR_WARNING: Final = 1 << 2
    DATA_OVERRUN: Final = 1 << 3
    ERROR_PASSIVE: Final = 1 << 5
    ARBITRATION_LOST: Final = 1 << 6
    BUS_ERROR: Final = 1 << 7


class LineReader:
    """Cuts a stream into lines, each without its CR; a BEL is a line of its own.

    Keeps at most one line. Of one that is too long only the beginning is kept: decoding it fails.
    """

    def __init__(self) -> None:
        self._line = bytearray()

    def feed(self, data: bytes) -> Iterator[bytes]:
        """The lines that are complete with `data`."""
        start = 0
        for end in _ENDS.finditer(data):
            self._keep(data[start : end.start()])
            start = end.end()
            if end[0] == BEL:
                self._line.clear()
                yield BEL
            else:
                line = bytes(self._line)
                self._line.clear()
                yield line
        self._keep(data[start:])

    def clear(self) -> None:
        """Forget the line that has begun."""
        self._line.clear()

    def _keep(self, piece: bytes) -> None:
        self._line += piece[: MAX_LINE_BYTES + 1 - len(self._line)]


_ENDS = re.compile(rb"[\r\a]")

_FRAME = re.compile(
    rb"""([tr])([0-7][0-9A-Fa-f]{2})([0-8])((?:[0-9A-Fa-f]{2})*)
    |    ([TR])([01][0-9A-Fa-f]{7})([0-8])((?:[0-9A-Fa-f]{2})*)""",
    re.VERBOSE,
)
_STAMP_DIGITS: Final = 4
_SHORTEST_FRAME: Final = 5
_PREFIX: Final = b"xX"
"""Python's own `int` takes it before hex digits; on the line it is an 8 with a wrong bit."""
_ZERO: Final = ord("0")


def encode_frame(frame: CanFrame) -> bytes:
    """The line that sends `frame`, and that tells of it, with its CR. Raises SlcanError."""
    can_id, data = frame
    if can_id & ERROR_FLAG or len(data) > 8:
        raise SlcanError(f"{frame} is no frame that SLCAN can carry")
    remote = bool(can_id & REMOTE_FLAG)
    digits = "" if remote else data.hex().upper()
    if can_id & EXTENDED_FLAG:
        letter = "R" if remote else "T"
        return f"{letter}{can_id & EXTENDED_ID_MASK:08X}{len(data)}{digits}\r".encode()
    letter = "r" if remote else "t"
    return f"{letter}{can_id & STANDARD_ID_MASK:03X}{len(data)}{digits}\r".encode()


def encode_command(command: SlcanCommand) -> bytes:
    """A command as the host sends it. Raises SlcanError."""
    match command:
        case Transmit(frame):
            return encode_frame(frame)
        case SetBitRate(bit_s):
            return b"S%d\r" % _bit_rate_code(bit_s)
        case SetBitTiming(btr0, btr1):
            return b"s%02X%02X\r" % (btr0, btr1)
        case Open(listen_only):
            return b"L\r" if listen_only else b"O\r"
        case SetTimestamps(on):
            return b"Z%d\r" % on
        case Close():
            return b"C\r"
        case ReadStatus():
            return b"F\r"
        case ReadVersion():
            return b"V\r"
        case ReadSerialNumber():
            return b"N\r"
        case Empty():
            return CR


def decode_command(line: bytes) -> SlcanCommand:
    """The command in a line without its CR. Raises SlcanError."""
    if line in _PLAIN_COMMANDS:
        return _PLAIN_COMMANDS[line]
    letter, digits = line[:1], line[1:]
    if letter in _FRAME_LETTERS:
        frame, rest = _decode_frame(line)
        if rest:
            raise SlcanError(f"more data than its length says: {_shown(line)}")
        return Transmit(frame)
    if letter == b"S" and len(digits) == 1 and digits.isdigit() and int(digits) in BIT_RATE_OF_CODE:
        return SetBitRate(BIT_RATE_OF_CODE[int(digits)])
    if letter == b"s" and re.fullmatch(rb"[0-9A-Fa-f]{4}", digits):
        return SetBitTiming(int(digits[:2], 16), int(digits[2:], 16))
    raise SlcanError(f"not an SLCAN command: {_shown(line)}")


def encode_reply(reply: Reply) -> bytes:
    """A reply as the adapter sends it. Raises SlcanError."""
    match reply:
        case Received(frame, timestamp_ms):
            line = encode_frame(frame)
            if timestamp_ms is None:
                return line
            return line[:-1] + b"%04X\r" % (timestamp_ms % TIMESTAMP_MODULUS_MS)
        case Queued(extended):
            return b"Z\r" if extended else b"z\r"
        case AdapterStatus(flags):
            return b"F%02X\r" % (flags & 0xFF)
        case Version(hardware, software):
            return b"V%02d%02d\r" % (hardware, software)
        case SerialNumber(text):
            return b"N" + text.encode() + CR
        case Done():
            return CR
        case Refused():
            return BEL


def decode_data_frame(line: bytes) -> CanFrame | None:
    """A plain data frame with an 11-bit ID, which is nearly every line; None for all others."""
    if line[:1] != b"t" or len(line) < _SHORTEST_FRAME:
        return None
    try:
        can_id, length = int(line[1:4], 16), line[4] - _ZERO
        data = bytes.fromhex(line[5:].decode("ascii"))
    except ValueError:
        return None
    if length > 8 or len(data) != length or can_id > STANDARD_ID_MASK or not line.isalnum():
        return None
    if line[2] in _PREFIX:
        return None
    return CanFrame(can_id, data)


def decode_reply(line: bytes) -> Reply:
    """The reply in a line without its CR, or in a BEL. Raises SlcanError."""
    if line in _PLAIN_REPLIES:
        return _PLAIN_REPLIES[line]
    letter, digits = line[:1], line[1:]
    if letter in _FRAME_LETTERS:
        frame, rest = _decode_frame(line)
        if not rest:
            return Received(frame)
        if len(rest) == _STAMP_DIGITS:
            return Received(frame, int(rest, 16))
    elif letter == b"F" and re.fullmatch(rb"[0-9A-Fa-f]{2}", digits):
        return AdapterStatus(int(digits, 16))
    elif letter == b"V" and re.fullmatch(rb"[0-9]{4}", digits):
        return Version(int(digits[:2]), int(digits[2:]))
    elif letter == b"N" and re.fullmatch(rb"[0-9A-Za-z]{1,8}", digits):
        return SerialNumber(digits.decode())
    raise SlcanError(f"not an SLCAN reply: {_shown(line)}")


_FRAME_LETTERS: Final = (b"t", b"T", b"r", b"R")

_PLAIN_COMMANDS: Final[dict[bytes, SlcanCommand]] = {
    b"": Empty(),
    b"O": Open(),
    b"L": Open(listen_only=True),
    b"C": Close(),
    b"F": ReadStatus(),
    b"V": ReadVersion(),
    b"N": ReadSerialNumber(),
    b"Z0": SetTimestamps(False),
    b"Z1": SetTimestamps(True),
}

_PLAIN_REPLIES: Final[dict[bytes, Reply]] = {
    b"": Done(),
    BEL: Refused(),
    b"z": Queued(),
    b"Z": Queued(extended=True),
}


def _decode_frame(line: bytes) -> tuple[CanFrame, bytes]:
    """The frame at the start of a line, and the digits after it."""
    match = _FRAME.fullmatch(line)
    if match is None:
        raise SlcanError(f"not an SLCAN frame: {_shown(line)}")
    letter, number, length_digit, digits = (
        match.group(1, 2, 3, 4) if match[1] else match.group(5, 6, 7, 8)
    )
    length = int(length_digit)
    flags = (EXTENDED_FLAG if letter in b"TR" else 0) | (REMOTE_FLAG if letter in b"rR" else 0)
    can_id = int(number, 16) | flags
    if flags & REMOTE_FLAG:
        return CanFrame(can_id, bytes(length)), digits
    if len(digits) < 2 * length:
        raise SlcanError(f"less data than its length says: {_shown(line)}")
    return CanFrame(can_id, bytes.fromhex(digits[: 2 * length].decode())), digits[2 * length :]


def _bit_rate_code(bit_s: int) -> int:
    for code, rate in BIT_RATE_OF_CODE.items():
        if rate == bit_s:
            return code
    rates = ", ".join(map(str, BIT_RATE_OF_CODE.values()))
    raise SlcanError(f"SLCAN has no bit rate of {bit_s} bit/s: it has {rates}")


def _shown(line: bytes) -> str:
    more = "..." if len(line) > MAX_LINE_BYTES else ""
    return repr(line[:MAX_LINE_BYTES])[1:] + more
