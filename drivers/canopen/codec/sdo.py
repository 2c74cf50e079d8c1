"""SDO frames (CiA 301, 7.2.4.3): expedited and segmented, upload (read) and download (write).

Each kind of frame is a value with `encode()`. Which frame may follow which is the business of
client and server. Block transfers have frames of their own; decoding one is an error, and a server
answers it with abort code 0x05040001.
"""

from dataclasses import dataclass
from struct import Struct
from typing import Final

from drivers.canopen.codec.abort_codes import abort_text
from drivers.canopen.codec.error import CodecError

FRAME_BYTES: Final = 8
EXPEDITED_BYTES: Final = 4
SEGMENT_BYTES: Final = 7

_INITIATE = Struct("<BHB4s")
_INITIATE_NUMBER = Struct("<BHBI")

# Command specifiers, in the top three bits of the first byte. Client and server use the same
# numbers for different things.
_CLIENT_DOWNLOAD_SEGMENT: Final = 0x00
_CLIENT_INITIATE_DOWNLOAD: Final = 0x20
_CLIENT_INITIATE_UPLOAD: Final = 0x40
_CLIENT_UPLOAD_SEGMENT: Final = 0x60
_SERVER_UPLOAD_SEGMENT: Final = 0x00
_SERVER_DOWNLOAD_SEGMENT: Final = 0x20
_SERVER_INITIATE_UPLOAD: Final = 0x40
_SERVER_INITIATE_DOWNLOAD: Final = 0x60
_ABORT: Final = 0x80
_SPECIFIER: Final = 0xE0

_TOGGLE: Final = 0x10
_EXPEDITED: Final = 0x02
_SIZED: Final = 0x01
_LAST: Final = 0x01


@dataclass(frozen=True, slots=True)
class Abort:
    """Either side ends the transfer."""

    index: int
    subindex: int
    code: int

    def encode(self) -> bytes:
        return _INITIATE_NUMBER.pack(_ABORT, self.index, self.subindex, self.code)

    def __str__(self) -> str:
        where = f"0x{self.index:04X}:{self.subindex:02X}"
        return f"{where}: 0x{self.code:08X} ({abort_text(self.code)})"


# What the client sends.


@dataclass(frozen=True, slots=True)
class UploadRequest:
    """Read an object."""

    index: int
    subindex: int

    def encode(self) -> bytes:
        return _INITIATE_NUMBER.pack(_CLIENT_INITIATE_UPLOAD, self.index, self.subindex, 0)


@dataclass(frozen=True, slots=True)
class UploadSegmentRequest:
    """Read the next segment. `toggle` begins with False."""

    toggle: bool

    def encode(self) -> bytes:
        return _padded(_CLIENT_UPLOAD_SEGMENT | _toggle_bit(self.toggle))


@dataclass(frozen=True, slots=True)
class ExpeditedDownload:
    """Write an object of up to 4 bytes. Not `sized`: 4 bytes, and the object knows how many."""

    index: int
    subindex: int
    data: bytes
    sized: bool = True

    def encode(self) -> bytes:
        return _expedited(
            _CLIENT_INITIATE_DOWNLOAD, self.index, self.subindex, self.data, self.sized
        )


@dataclass(frozen=True, slots=True)
class DownloadRequest:
    """Write an object in segments. `size` None: not told beforehand."""

    index: int
    subindex: int
    size: int | None

    def encode(self) -> bytes:
        return _segmented(_CLIENT_INITIATE_DOWNLOAD, self.index, self.subindex, self.size)


@dataclass(frozen=True, slots=True)
class DownloadSegment:
    """Write the next segment, up to 7 bytes. `toggle` begins with False."""

    toggle: bool
    data: bytes
    last: bool

    def encode(self) -> bytes:
        return _segment(_CLIENT_DOWNLOAD_SEGMENT, self.toggle, self.data, self.last)


Request = (
    UploadRequest
    | UploadSegmentRequest
    | ExpeditedDownload
    | DownloadRequest
    | DownloadSegment
    | Abort
)

# What the server sends.


@dataclass(frozen=True, slots=True)
class ExpeditedUpload:
    """The object that was read, up to 4 bytes. Not `sized`: 4 bytes, not all of them may count."""

    index: int
    subindex: int
    data: bytes
    sized: bool = True

    def encode(self) -> bytes:
        return _expedited(_SERVER_INITIATE_UPLOAD, self.index, self.subindex, self.data, self.sized)


@dataclass(frozen=True, slots=True)
class UploadResponse:
    """The object that was read comes in segments. `size` None: not told beforehand."""

    index: int
    subindex: int
    size: int | None

    def encode(self) -> bytes:
        return _segmented(_SERVER_INITIATE_UPLOAD, self.index, self.subindex, self.size)


@dataclass(frozen=True, slots=True)
class UploadSegment:
    """The next segment, up to 7 bytes. `toggle` repeats the request's."""

    toggle: bool
    data: bytes
    last: bool

    def encode(self) -> bytes:
        return _segment(_SERVER_UPLOAD_SEGMENT, self.toggle, self.data, self.last)


@dataclass(frozen=True, slots=True)
class DownloadResponse:
    """Written; or, of a segmented download, go on."""

    index: int
    subindex: int

    def encode(self) -> bytes:
        return _INITIATE_NUMBER.pack(_SERVER_INITIATE_DOWNLOAD, self.index, self.subindex, 0)


@dataclass(frozen=True, slots=True)
class DownloadSegmentResponse:
    """Segment taken. `toggle` repeats the request's."""

    toggle: bool

    def encode(self) -> bytes:
        return _padded(_SERVER_DOWNLOAD_SEGMENT | _toggle_bit(self.toggle))


Response = (
    ExpeditedUpload
    | UploadResponse
    | UploadSegment
    | DownloadResponse
    | DownloadSegmentResponse
    | Abort
)


def decode_request(data: bytes) -> Request:
    """What a client asks. Raises CodecError."""
    command = _command(data)
    match command & _SPECIFIER:
        case 0x00:
            return DownloadSegment(*_segment_of(data))
        case 0x20:
            index, subindex, payload, sized = _initiate_of(data)
            if command & _EXPEDITED:
                return ExpeditedDownload(index, subindex, payload, sized)
            return DownloadRequest(index, subindex, _size_of(data))
        case 0x40:
            return UploadRequest(*_multiplexer(data))
        case 0x60:
            return UploadSegmentRequest(bool(command & _TOGGLE))
        case 0x80:
            return _abort_of(data)
    raise CodecError(f"no SDO request begins with 0x{command:02X}: '{data.hex()}'")


def decode_response(data: bytes) -> Response:
    """What a server answers. Raises CodecError."""
    command = _command(data)
    match command & _SPECIFIER:
        case 0x00:
            return UploadSegment(*_segment_of(data))
        case 0x20:
            return DownloadSegmentResponse(bool(command & _TOGGLE))
        case 0x40:
            index, subindex, payload, sized = _initiate_of(data)
            if command & _EXPEDITED:
                return ExpeditedUpload(index, subindex, payload, sized)
            return UploadResponse(index, subindex, _size_of(data))
        case 0x60:
            return DownloadResponse(*_multiplexer(data))
        case 0x80:
            return _abort_of(data)
    raise CodecError(f"no SDO response begins with 0x{command:02X}: '{data.hex()}'")


def _expedited(specifier: int, index: int, subindex: int, data: bytes, sized: bool) -> bytes:
    length = len(data)
    if not (1 <= length <= EXPEDITED_BYTES and (sized or length == EXPEDITED_BYTES)):
        raise CodecError(f"an expedited transfer carries 1 to 4 bytes, not {length}")
    command = specifier | _EXPEDITED
    if sized:
        command |= EXPEDITED_BYTES - length << 2 | _SIZED
    return _INITIATE.pack(command, index, subindex, data)


def _segmented(specifier: int, index: int, subindex: int, size: int | None) -> bytes:
    if size is None:
        return _INITIATE_NUMBER.pack(specifier, index, subindex, 0)
    return _INITIATE_NUMBER.pack(specifier | _SIZED, index, subindex, size)


def _segment(specifier: int, toggle: bool, data: bytes, last: bool) -> bytes:
    if len(data) > SEGMENT_BYTES:
        raise CodecError(f"a segment carries up to {SEGMENT_BYTES} bytes, not {len(data)}")
    unused = SEGMENT_BYTES - len(data) << 1
    return _padded(specifier | _toggle_bit(toggle) | unused | (_LAST if last else 0), data)


def _toggle_bit(toggle: bool) -> int:
    return _TOGGLE if toggle else 0


def _padded(command: int, data: bytes = b"") -> bytes:
    return bytes((command,)) + data.ljust(SEGMENT_BYTES, b"\0")


def _command(data: bytes) -> int:
    if len(data) != FRAME_BYTES:
        raise CodecError(f"an SDO frame has {FRAME_BYTES} bytes, not {len(data)}: '{data.hex()}'")
    return data[0]


def _multiplexer(data: bytes) -> tuple[int, int]:
    _, index, subindex, _ = _INITIATE.unpack(data)
    return index, subindex


def _initiate_of(data: bytes) -> tuple[int, int, bytes, bool]:
    command, index, subindex, payload = _INITIATE.unpack(data)
    if command & _SIZED:
        return index, subindex, payload[: EXPEDITED_BYTES - (command >> 2 & 3)], True
    return index, subindex, payload, False


def _size_of(data: bytes) -> int | None:
    command, _, _, size = _INITIATE_NUMBER.unpack(data)
    return int(size) if command & _SIZED else None


def _segment_of(data: bytes) -> tuple[bool, bytes, bool]:
    command = data[0]
    length = SEGMENT_BYTES - (command >> 1 & 7)
    return bool(command & _TOGGLE), data[1 : 1 + length], bool(command & _LAST)


def _abort_of(data: bytes) -> Abort:
    _, index, subindex, code = _INITIATE_NUMBER.unpack(data)
    return Abort(index, subindex, code)
