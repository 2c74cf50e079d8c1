"""Replies as the wire frames them: text with a checksum, or binary with two."""

import re
import struct
from dataclasses import dataclass
from functools import lru_cache

from drivers.aurora.codec.crc import crc16
from drivers.aurora.codec.errors import CodecError

OKAY = "OKAY"
RESET = "RESET"

BINARY_START = b"\xc4\xa5"
BINARY_HEADER = struct.Struct("<2sHH")
"""Start, length of the body, checksum of those four bytes."""
CHECKSUM = struct.Struct("<H")

BINARY_FRAMING_BYTES = BINARY_HEADER.size + CHECKSUM.size
TEXT_FRAMING_BYTES = 5

MAX_HANDLES = 255
MAX_BODY_BYTES = 3 + 42 * MAX_HANDLES
MAX_TEXT_BYTES = 20_000
MAX_REPLY_BYTES = MAX_TEXT_BYTES
"""No reply of the device is longer; whoever reads never holds more than this."""

_ERROR = re.compile(r"(ERROR|WARNING)([0-9A-F]{2})")


@dataclass(frozen=True, slots=True)
class TextReply:
    """A text reply whose checksum was right, without checksum and CR."""

    text: str


@dataclass(frozen=True, slots=True)
class BinaryReply:
    """The body of a binary reply whose checksums were right."""

    body: bytes


@dataclass(frozen=True, slots=True)
class DamagedReply:
    """A whole reply that must not be believed."""

    reason: str
    raw: bytes


Reply = TextReply | BinaryReply | DamagedReply


@dataclass(frozen=True)
class CodedReply:
    """`ERRORhh`: refused. `WARNINGhh`: done, with a remark."""

    code: int
    is_warning: bool


def encode_text_reply(text: str) -> bytes:
    """The bytes of a text reply, with its checksum and the closing CR."""
    covered = text.encode("ascii")
    return covered + b"%04X\r" % crc16(covered)


def decode_text_reply(line: bytes) -> str:
    """The text of a line without its CR. Raises CodecError."""
    covered, digits = line[:-4], line[-4:]
    if b"%04X" % crc16(covered) != digits:
        raise CodecError("the reply's checksum is wrong", bad_crc=True)
    try:
        return covered.decode("ascii")
    except UnicodeDecodeError:
        raise CodecError("a text reply holds bytes that are not ASCII") from None


def encode_binary_reply(body: bytes) -> bytes:
    """The bytes of a binary reply around `body`. Raises CodecError where it is too long."""
    if len(body) > MAX_BODY_BYTES:
        raise CodecError(f"a binary reply's body has at most {MAX_BODY_BYTES} bytes")
    return _binary_header(len(body)) + body + CHECKSUM.pack(crc16(body))


@lru_cache(maxsize=16)
def _binary_header(length: int) -> bytes:
    start = BINARY_START + CHECKSUM.pack(length)
    return start + CHECKSUM.pack(crc16(start))


def encode_error(code: int) -> bytes:
    """The bytes of `ERRORhh`."""
    return encode_text_reply(f"ERROR{code:02X}")


def coded_reply(text: str) -> CodedReply | None:
    """The code, if the text is an error or a warning."""
    match = _ERROR.fullmatch(text)
    return None if match is None else CodedReply(int(match[2], 16), match[1] == "WARNING")
