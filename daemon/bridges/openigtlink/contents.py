"""The contents of the OpenIGTLink messages that are used here, to bytes and back.

OpenIGTLink protocol, version 3: http://openigtlink.org/developers/spec, page by type. Lengths are
mm. Numbers of places are 32-bit floats on the wire.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from daemon.bridges.openigtlink.framing import FramingError

Transform = NDArray[np.float64]
"""(3, 4): rotation, and translation in mm."""

_TRANSFORM: Final = struct.Struct(">12f")
_TOOL: Final = struct.Struct(">20sBB12f")
_START_TDATA: Final = struct.Struct(">i32s")
_POINT: Final = struct.Struct(">64s32s4B3ff20s")
_STATUS: Final = struct.Struct(">Hq20s")
_STRING: Final = struct.Struct(">HH")
_POLYDATA: Final = struct.Struct(">10I")
"""Points, then number and bytes of vertices, lines, polygons and strips, then attributes."""
_ATTRIBUTE: Final = struct.Struct(">BBI")
_US_ASCII: Final = 3
_POINT_SCALAR: Final = 0
_TYPE_BYTES: Final = 12


class ToolKind(IntEnum):
    """Of a tool in TDATA: how much of its pose is known."""

    TRACKER = 1
    SIX_DEGREES = 2
    ONLY_PLACE = 3
    FIVE_DEGREES = 4


class StatusCode(IntEnum):
    """Those of STATUS that a robot comes to; the protocol has more."""

    OK = 1
    UNKNOWN_ERROR = 2
    PANIC = 3
    """Emergency stop."""
    TIME_OUT = 7
    """Connection lost."""
    NOT_READY = 13
    HARDWARE_FAILURE = 18


@dataclass(frozen=True, eq=False)
class Tool:
    """One in TDATA."""

    name: str
    kind: ToolKind
    transform: Transform


@dataclass(frozen=True)
class Point:
    """One in POINT."""

    name: str
    group: str
    place_mm: tuple[float, float, float]
    diameter_mm: float
    colour: tuple[int, int, int, int] = (255, 255, 255, 255)
    owner: str = ""


@dataclass(frozen=True)
class StatusContent:
    """Of STATUS."""

    code: int
    name: str = ""
    """Of the error, at most 20 characters."""
    text: str = ""
    subcode: int = 0


@dataclass(frozen=True, eq=False)
class PolyLines:
    """Of POLYDATA, as far as lines and one number for each point go."""

    points_mm: NDArray[np.float64]
    """(n, 3)"""
    lines: tuple[tuple[int, ...], ...]
    """Each the numbers of its points."""
    scalars: NDArray[np.float64] | None = None
    """(n,)"""
    scalars_name: str = ""


def ascii_only(text: str, most: int | None = None) -> str:
    """As ASCII, with `?` for what is not; cut where there is no room."""
    return text.encode("ascii", errors="replace").decode("ascii").replace("\0", "?")[:most]


def pack_transform(transform: Transform) -> bytes:
    """Column by column; the translation is the last."""
    return _TRANSFORM.pack(*np.asarray(transform, np.float64).T.ravel().tolist())


def read_transform(content: bytes) -> Transform:
    """Raises FramingError."""
    return _as_transform(_unpacked(_TRANSFORM, content))


def pack_tracking_data(tools: Sequence[Tool]) -> bytes:
    """The content of TDATA."""
    return b"".join(
        _TOOL.pack(_ascii(tool.name), tool.kind, 0, *tool.transform.T.ravel().tolist())
        for tool in tools
    )


def read_tracking_data(content: bytes) -> list[Tool]:
    """Raises FramingError."""
    found = []
    for name, kind, _, *numbers in _each(_TOOL, content):
        try:
            found.append(Tool(_text(name), ToolKind(kind), _as_transform(numbers)))
        except ValueError:
            raise FramingError(f"there is no kind {kind} of tool") from None
    return found


def pack_start_tracking(resolution_ms: int, coordinates: str = "") -> bytes:
    """The content of STT_TDATA, which a client sends."""
    return _START_TDATA.pack(resolution_ms, _ascii(coordinates))


def read_start_tracking(content: bytes) -> int:
    """How many ms are to be between two TDATA; never below 0. Raises FramingError."""
    resolution_ms, _ = _unpacked(_START_TDATA, content)
    return max(0, int(resolution_ms))


def pack_points(points: Sequence[Point]) -> bytes:
    return b"".join(
        _POINT.pack(
            _ascii(point.name),
            _ascii(point.group),
            *point.colour,
            *point.place_mm,
            point.diameter_mm,
            _ascii(point.owner),
        )
        for point in points
    )


def read_points(content: bytes) -> list[Point]:
    """Raises FramingError."""
    return [
        Point(_text(name), _text(group), (x, y, z), diameter, (r, g, b, a), _text(owner))
        for name, group, r, g, b, a, x, y, z, diameter, owner in _each(_POINT, content)
    ]


def pack_poly_lines(body: PolyLines) -> bytes:
    """The content of POLYDATA."""
    count = len(body.points_mm)
    lines = b"".join(struct.pack(f">{len(one) + 1}I", len(one), *one) for one in body.lines)
    attributes = 0 if body.scalars is None else 1
    header = _POLYDATA.pack(count, 0, 0, len(body.lines), len(lines), 0, 0, 0, 0, attributes)
    content = header + np.asarray(body.points_mm, ">f4").tobytes() + lines
    if body.scalars is None:
        return content
    name = _ascii(body.scalars_name) + b"\0"
    name += b"\0" * (len(name) % 2)  # names are padded to an even number of bytes
    numbers = np.asarray(body.scalars, ">f4").tobytes()
    return content + _ATTRIBUTE.pack(_POINT_SCALAR, 1, count) + name + numbers


def read_poly_lines(content: bytes) -> PolyLines:
    """Of a POLYDATA with nothing but lines and at most one number for each point. Raises
    FramingError."""
    if len(content) < _POLYDATA.size:
        raise FramingError("POLYDATA is cut off")
    count, _, vertices, line_count, line_bytes, _, polygons, _, strips, attributes = (
        _POLYDATA.unpack_from(content)
    )
    if vertices or polygons or strips or attributes > 1:
        raise FramingError("POLYDATA with more than lines")
    at = _POLYDATA.size
    points = _floats(content, at, 3 * count).reshape(count, 3)
    at += 12 * count
    lines = _lines(content[at : at + line_bytes], line_count, line_bytes)
    at += line_bytes
    if not attributes:
        _ends(content, at)
        return PolyLines(points, lines)
    if len(content) < at + _ATTRIBUTE.size:
        raise FramingError("POLYDATA is cut off")
    _, components, numbers = _ATTRIBUTE.unpack_from(content, at)
    at += _ATTRIBUTE.size
    end = content.find(b"\0", at)
    if end < 0 or components != 1:
        raise FramingError("POLYDATA with an attribute that is no number with a name")
    name = _text(content[at:end])
    at = end + 1 + (end + 1 - at) % 2
    scalars = _floats(content, at, numbers)
    _ends(content, at + 4 * numbers)
    return PolyLines(points, lines, scalars, name)


def pack_status(status: StatusContent) -> bytes:
    name = ascii_only(status.name, 20).encode()
    text = ascii_only(status.text).encode() + b"\0"
    return _STATUS.pack(status.code, status.subcode, name) + text


def read_status(content: bytes) -> StatusContent:
    """Raises FramingError."""
    code, subcode, name = _unpacked(_STATUS, content[: _STATUS.size])
    return StatusContent(code, _text(name), _text(content[_STATUS.size :]), subcode)


def pack_string(text: str) -> bytes:
    """ASCII: what there is of clients does not read all that the protocol allows."""
    letters = ascii_only(text, 0xFFFF).encode()
    return _STRING.pack(_US_ASCII, len(letters)) + letters


def read_string(content: bytes) -> str:
    """Raises FramingError."""
    _, length = _unpacked(_STRING, content[: _STRING.size])
    _ends(content, _STRING.size + length)
    return content[_STRING.size :].decode("ascii", errors="replace")


def pack_capability(kinds: Sequence[str]) -> bytes:
    """The content of CAPABILITY: every kind of message that is sent, 12 bytes each."""
    return b"".join(kind.encode("ascii").ljust(_TYPE_BYTES, b"\0") for kind in kinds)


def _as_transform(numbers: Sequence[float]) -> Transform:
    return np.array(numbers, np.float64).reshape(4, 3).T


def _unpacked(layout: struct.Struct, content: bytes) -> tuple[Any, ...]:
    """Raises FramingError."""
    if len(content) != layout.size:
        raise FramingError(f"a content of {len(content)} bytes instead of {layout.size}")
    return layout.unpack(content)


def _each(layout: struct.Struct, content: bytes) -> list[tuple[Any, ...]]:
    """Raises FramingError."""
    if len(content) % layout.size:
        raise FramingError(f"a content of {len(content)} bytes: no multiple of {layout.size}")
    return list(layout.iter_unpack(content))


def _floats(content: bytes, at: int, count: int) -> NDArray[np.float64]:
    if len(content) < at + 4 * count:
        raise FramingError("numbers are cut off")
    return np.frombuffer(content, ">f4", count, at).astype(np.float64)


def _lines(content: bytes, count: int, size: int) -> tuple[tuple[int, ...], ...]:
    if len(content) != size or size % 4:
        raise FramingError("lines are cut off")
    numbers = np.frombuffer(content, ">u4").tolist()
    found, at = [], 0
    for _ in range(count):
        end = at + 1 + numbers[at] if at < len(numbers) else size
        if end > len(numbers):
            raise FramingError("a line is cut off")
        found.append(tuple(numbers[at + 1 : end]))
        at = end
    return tuple(found)


def _ends(content: bytes, at: int) -> None:
    if len(content) != at:
        raise FramingError(f"{len(content) - at} bytes too many")


def _ascii(text: str) -> bytes:
    return ascii_only(text).encode()


def _text(field_bytes: bytes) -> str:
    return field_bytes.partition(b"\0")[0].decode("ascii", errors="replace").rstrip()
