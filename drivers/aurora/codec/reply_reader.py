"""Bytes in, whole replies out, in whatever pieces the bytes come."""

import re

from drivers.aurora.codec.crc import crc16
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.replies import (
    BINARY_HEADER,
    BINARY_START,
    CHECKSUM,
    MAX_BODY_BYTES,
    MAX_TEXT_BYTES,
    RESET,
    BinaryReply,
    DamagedReply,
    Reply,
    TextReply,
    decode_text_reply,
    encode_text_reply,
)

_TEXT = re.compile(rb"[\n\x20-\x7e]*")
_START_OF_REPLY = re.compile(rb"[\x20-\x7e\xc4]")
_CR = 0x0D
_RESET_LINE = encode_text_reply(RESET)


class ReplyReader:
    """Cuts a stream into replies. Holds at most one reply, so never more than MAX_REPLY_BYTES.

    The first byte decides: 0xC4 begins a binary reply, whose length says where it ends (it may
    hold any byte, CR too); a printable one begins a text reply, which ends with CR. What can be
    part of neither is noise, and is skipped. A device that restarts says so in the middle of
    anything.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._scanned = 0
        self.noise_bytes = 0

    @property
    def pending(self) -> int:
        """Bytes of the reply that has begun."""
        return len(self._buffer)

    def clear(self) -> None:
        """Forget a reply that has begun."""
        self._drop(len(self._buffer))

    def feed(self, data: bytes) -> list[Reply]:
        """Take some bytes; returns the replies they complete."""
        self._buffer += data
        replies: list[Reply] = []
        while self._buffer:
            before = len(self._buffer)
            reply = self._binary() if self._buffer[0] == BINARY_START[0] else self._text()
            if reply is not None:
                replies.append(reply)
            elif len(self._buffer) == before:
                break
        return replies

    def _binary(self) -> Reply | None:
        buffer = self._buffer
        if len(buffer) > 1 and buffer[1] != BINARY_START[1]:
            self._noise(1)
            return None
        if len(buffer) < BINARY_HEADER.size:
            return None
        _, length, header_crc = BINARY_HEADER.unpack_from(buffer)
        if length > MAX_BODY_BYTES or crc16(bytes(buffer[:4])) != header_crc:
            self._noise(1)
            return None
        end = BINARY_HEADER.size + length + CHECKSUM.size
        if len(buffer) < end:
            return self._restarted()
        body = bytes(buffer[BINARY_HEADER.size : end - CHECKSUM.size])
        if CHECKSUM.unpack_from(buffer, end - CHECKSUM.size)[0] != crc16(body):
            raw = self._drop(end - _restart_at_end_of(buffer[:end]))
            return DamagedReply("the reply's checksum is wrong", raw)
        self._drop(end)
        return BinaryReply(body)

    def _text(self) -> Reply | None:
        match = _TEXT.match(self._buffer, self._scanned)
        assert match is not None
        end = match.end()
        if end == len(self._buffer):
            self._scanned = end
            if end > MAX_TEXT_BYTES:
                return DamagedReply("a reply without an end", self._drop(end))
            return None
        if end == 0 or self._buffer[end] != _CR:
            start = _START_OF_REPLY.search(self._buffer, end if end else 1)
            self._noise(start.start() if start else len(self._buffer))
            return None
        raw = self._drop(end + 1)
        try:
            return TextReply(decode_text_reply(raw[:-1]))
        except CodecError as error:
            return TextReply(RESET) if raw.endswith(_RESET_LINE) else DamagedReply(str(error), raw)

    def _restarted(self) -> Reply | None:
        if not self._buffer.endswith(_RESET_LINE):
            return None
        self.clear()
        return TextReply(RESET)

    def _noise(self, count: int) -> None:
        self._drop(count)
        self.noise_bytes += count

    def _drop(self, count: int) -> bytes:
        dropped = bytes(self._buffer[:count])
        del self._buffer[:count]
        self._scanned = 0
        return dropped


def _restart_at_end_of(data: bytearray) -> int:
    """How many bytes at the end are the beginning of a restart; a single one says nothing."""
    for count in range(len(_RESET_LINE), 1, -1):
        if data.endswith(_RESET_LINE[:count]):
            return count
    return 0
