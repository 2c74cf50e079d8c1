"""Commands of the Combined API, `WORD:argumentsCRC` or `WORD arguments`, as bytes and back."""

import re
from dataclasses import dataclass
from functools import lru_cache

from drivers.aurora.codec.crc import crc16
from drivers.aurora.codec.errors import CodecError

MAX_COMMAND_BYTES = 1024

_WORD = re.compile(rb"[A-Za-z][A-Za-z0-9]*")
_CRC_DIGITS = re.compile(rb"[0-9A-Fa-f]{4}")
_PRINTABLE = re.compile(rb"[\x20-\x7e]*")

BAUD_CODES = {
    9600: "0",
    14400: "1",
    19200: "2",
    38400: "3",
    57600: "4",
    115200: "5",
    921600: "6",
    230400: "A",
}


@dataclass(frozen=True)
class AuroraCommand:
    """One command. The word is upper case; arguments keep the case they were sent in."""

    word: str
    arguments: str = ""


@lru_cache(maxsize=64)
def encode_command(word: str, arguments: str = "") -> bytes:
    """The bytes of a command with its checksum and the closing CR. Most are sent again soon."""
    covered = f"{word}:{arguments}".encode("ascii")
    return covered + b"%04X\r" % crc16(covered)


@lru_cache(maxsize=64)
def decode_command(line: bytes) -> AuroraCommand:
    """The command in a line without its CR, with a checksum or, after a space, without one.

    Raises CodecError; `bad_crc` is set where only the checksum is wrong.
    """
    if len(line) > MAX_COMMAND_BYTES:
        raise CodecError(f"a command has at most {MAX_COMMAND_BYTES} bytes")
    word = _WORD.match(line)
    if word is None or _PRINTABLE.fullmatch(line) is None:
        raise CodecError("a command starts with a word and is printable throughout")
    separator, rest = line[word.end() : word.end() + 1], line[word.end() + 1 :]
    if separator == b":":
        if _CRC_DIGITS.fullmatch(rest[-4:]) is None:
            raise CodecError("a command with ':' ends with four hex digits", bad_crc=True)
        if crc16(line[:-4]) != int(rest[-4:], 16):
            raise CodecError("the command's checksum is wrong", bad_crc=True)
        rest = rest[:-4]
    elif separator != b" ":
        raise CodecError("a command's word is followed by ':' or a space")
    return AuroraCommand(word[0].decode("ascii").upper(), rest.decode("ascii"))


class CommandReader:
    """Cuts a stream into command lines, on the device's side.

    A line that never ends is cut short; decode_command refuses it for its length.
    """

    def __init__(self) -> None:
        self._line = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """Take some bytes; returns the lines they complete, without CR."""
        if not self._line and 0 <= data.find(b"\r") == len(data) - 1 < MAX_COMMAND_BYTES:
            return [data[:-1]]  # one whole line, as most are
        *complete, last = data.split(b"\r")
        lines = []
        for piece in complete:
            self._extend(piece)
            lines.append(bytes(self._line))
            self._line.clear()
        self._extend(last)
        return lines

    def clear(self) -> None:
        """Forget a line that has begun."""
        self._line.clear()

    @property
    def pending(self) -> int:
        """Bytes of the line that has begun."""
        return len(self._line)

    def _extend(self, piece: bytes) -> None:
        self._line += piece[: MAX_COMMAND_BYTES + 1 - len(self._line)]


@dataclass(frozen=True)
class LineSettings:
    """The arguments of COMM."""

    baud_rate: int
    data_bits: int = 8
    parity: str = "none"
    stop_bits: int = 1
    hardware_handshake: bool = False


_PARITIES = ("none", "odd", "even")
_BAUD_RATES = {code: rate for rate, code in BAUD_CODES.items()}


def encode_line_settings(settings: LineSettings) -> str:
    """The arguments of COMM for `settings`."""
    return (
        BAUD_CODES[settings.baud_rate]
        + ("1" if settings.data_bits == 7 else "0")
        + str(_PARITIES.index(settings.parity))
        + ("1" if settings.stop_bits == 2 else "0")
        + ("1" if settings.hardware_handshake else "0")
    )


def decode_line_settings(arguments: str) -> LineSettings:
    """What COMM with these arguments asks for. Raises CodecError."""
    match = re.fullmatch(r"([0-9A-Fa-f])([01])([0-2])([01])([01])", arguments)
    if match is None or match[1].upper() not in _BAUD_RATES:
        raise CodecError(f"COMM: there are no line settings '{arguments}'")
    return LineSettings(
        baud_rate=_BAUD_RATES[match[1].upper()],
        data_bits=7 if match[2] == "1" else 8,
        parity=_PARITIES[int(match[3])],
        stop_bits=2 if match[4] == "1" else 1,
        hardware_handshake=match[5] == "1",
    )
