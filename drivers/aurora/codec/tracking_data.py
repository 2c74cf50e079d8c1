"""Tracking replies: BX in binary, TX in text, with the same content."""

import re
import struct
from collections.abc import Sequence
from typing import NamedTuple

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.fields import FieldReader, hex_number
from drivers.aurora.codec.replies import MAX_HANDLES
from drivers.aurora.codec.status_bits import HandleState

TRANSFORMS = 0x0001
OUT_OF_VOLUME_TOO = 0x0800
"""Report poses outside the measurement volume as well; their port status says so."""

FRAME_MODULUS = 1 << 32

Quaternion = tuple[float, float, float, float]
Position = tuple[float, float, float]


class ToolReading(NamedTuple):
    """What a reply says about one port handle. A disabled one has no status and no frame number."""

    handle: int
    state: HandleState
    quaternion: Quaternion | None = None
    """Scalar first, sensor to field generator; as sent, so not of exact unit length."""
    position_mm: Position | None = None
    indicator: float = 0.0
    """0 to 9.9, larger is a worse fit; always 0 for a sensor with 5 degrees of freedom."""
    port_status: int = 0
    frame_number: int | None = None


class TrackingData(NamedTuple):
    """One tracking reply."""

    readings: tuple[ToolReading, ...]
    system_status: int


# One reading by its state: handle, state, and what follows.
_VALID_READING = struct.Struct("<BB8fII")
_MISSING_READING = struct.Struct("<BBII")
_DISABLED_READING = struct.Struct("<BB")
_SYSTEM_STATUS = struct.Struct("<H")
_VALID, _MISSING, _DISABLED = HandleState.VALID, HandleState.MISSING, HandleState.DISABLED


def decode_bx(body: bytes) -> TrackingData:
    """The content of a binary reply's body. Raises CodecError."""
    readings = []
    at = 1
    try:
        for _ in range(body[0]):
            state = body[at + 1]
            if state == _VALID:
                handle, _, q0, qx, qy, qz, x, y, z, fit, status, frame = _VALID_READING.unpack_from(
                    body, at
                )
                at += _VALID_READING.size
                q, p = (q0, qx, qy, qz), (x, y, z)
                readings.append(ToolReading(handle, _VALID, q, p, fit, status, frame))
            elif state == _MISSING:
                handle, _, status, frame = _MISSING_READING.unpack_from(body, at)
                at += _MISSING_READING.size
                readings.append(ToolReading(handle, _MISSING, None, None, 0.0, status, frame))
            elif state == _DISABLED:
                readings.append(ToolReading(body[at], _DISABLED))
                at += _DISABLED_READING.size
            else:
                raise CodecError(f"BX: handle {body[at]:02X} has the unknown state {state:02X}")
        (system_status,) = _SYSTEM_STATUS.unpack_from(body, at)
    except (struct.error, IndexError):
        raise CodecError(f"BX: ends after {len(body)} bytes, in the middle of a field") from None
    if at + _SYSTEM_STATUS.size != len(body):
        raise CodecError(f"BX: {len(body) - at - _SYSTEM_STATUS.size} bytes too many")
    return TrackingData(tuple(readings), system_status)


def encode_bx(data: TrackingData) -> bytes:
    """The body of a binary reply. Raises CodecError where a value does not fit its field."""
    parts = [bytes([_count(data.readings)])]
    try:
        for reading in data.readings:
            handle, state, _, _, indicator, status, frame = reading
            if state is _VALID:
                q, p = _pose(reading)
                parts.append(_VALID_READING.pack(handle, state, *q, *p, indicator, status, frame))
            elif state is _MISSING:
                parts.append(_MISSING_READING.pack(handle, state, status, frame))
            else:
                parts.append(_DISABLED_READING.pack(handle, state))
        parts.append(_SYSTEM_STATUS.pack(data.system_status))
    except (struct.error, OverflowError) as error:
        raise CodecError(f"BX: {error}") from None
    return b"".join(parts)


_VALID_LINE = re.compile(
    r"([+-]\d{5})([+-]\d{5})([+-]\d{5})([+-]\d{5})"
    r"([+-]\d{6})([+-]\d{6})([+-]\d{6})([+-]\d{5})"
    r"([0-9A-Fa-f]{8})([0-9A-Fa-f]{8})",
    re.ASCII,
)
_MISSING_LINE = re.compile(r"MISSING([0-9A-Fa-f]{8})([0-9A-Fa-f]{8})", re.ASCII)
_DISABLED_LINE = re.compile(r"(DISABLED|UNOCCUPIED)([0-9A-Fa-f]{16})?", re.ASCII)
"""Some firmware appends status and frame number to a disabled handle."""


def decode_tx(text: str) -> TrackingData:
    """The content of a text reply. Raises CodecError."""
    reader = FieldReader(text, "TX")
    count = reader.hex(2)
    *lines, system_status = reader.rest().split("\n")
    if len(lines) != count or len(system_status) != 4:
        raise CodecError(f"TX: {len(lines)} lines for {count} handles")
    readings = tuple(_decode_line(line) for line in lines)
    return TrackingData(readings, hex_number(system_status, "TX"))


def _decode_line(line: str) -> ToolReading:
    handle, rest = hex_number(line[:2], "TX"), line[2:]
    if match := _VALID_LINE.fullmatch(rest):
        q0, qx, qy, qz, x, y, z, indicator = (int(field) for field in match.groups()[:8])
        return ToolReading(
            handle,
            _VALID,
            (q0 * 1e-4, qx * 1e-4, qy * 1e-4, qz * 1e-4),
            (x * 1e-2, y * 1e-2, z * 1e-2),
            indicator * 1e-4,
            int(match[9], 16),
            int(match[10], 16),
        )
    if match := _MISSING_LINE.fullmatch(rest):
        return ToolReading(handle, _MISSING, None, None, 0.0, int(match[1], 16), int(match[2], 16))
    if _DISABLED_LINE.fullmatch(rest):
        return ToolReading(handle, _DISABLED)
    raise CodecError(f"TX: handle {handle:02X} has no readable line")


def encode_tx(data: TrackingData) -> str:
    """The text of a text reply. Raises CodecError where a value does not fit its field."""
    lines = [f"{_count(data.readings):02X}"]
    for reading in data.readings:
        head = f"{_fitting(reading.handle, 0xFF):02X}"
        if reading.state is _DISABLED:
            lines.append(f"{head}DISABLED\n")
            continue
        tail = f"{_fitting(reading.port_status, 0xFFFFFFFF):08X}{_frame(reading):08X}\n"
        lines.append(head + _encode_pose(reading) + tail)
    return "".join(lines) + f"{_fitting(data.system_status, 0xFFFF):04X}"


def _encode_pose(reading: ToolReading) -> str:
    if reading.state is _MISSING:
        return "MISSING"
    quaternion, position_mm = _pose(reading)
    fields = [_decimal(value, 4, 5) for value in quaternion]
    fields += [_decimal(value, 2, 6) for value in position_mm]
    return "".join(fields) + _decimal(reading.indicator, 4, 5)


def _decimal(value: float, decimals: int, digits: int) -> str:
    try:
        scaled = round(value * 10**decimals)
    except (ValueError, OverflowError):
        raise CodecError(f"TX: {value} is not a finite number") from None
    text = f"{scaled:+0{digits + 1}d}"
    if len(text) > digits + 1:
        raise CodecError(f"TX: {value} does not fit {digits} digits")
    return text


def _pose(reading: ToolReading) -> tuple[Quaternion, Position]:
    if reading.quaternion is None or reading.position_mm is None:
        raise CodecError(f"a valid reading of handle {reading.handle:02X} needs a pose")
    return reading.quaternion, reading.position_mm


def _frame(reading: ToolReading) -> int:
    if reading.frame_number is None:
        raise CodecError(f"a reading of handle {reading.handle:02X} needs a frame number")
    return _fitting(reading.frame_number, FRAME_MODULUS - 1)


def _fitting(value: int, largest: int) -> int:
    if not 0 <= value <= largest:
        raise CodecError(f"{value} does not fit its field")
    return value


def _count(readings: Sequence[ToolReading]) -> int:
    if len(readings) > MAX_HANDLES:
        raise CodecError(f"a tracking reply has at most {MAX_HANDLES} handles")
    return len(readings)
