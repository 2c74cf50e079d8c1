"""PHINF: what is plugged in behind a port handle. The options asked for say which fields come."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.fields import FieldReader
from drivers.aurora.codec.status_bits import PortStatus

# PHSR: which port handles there are, and in what state.


class HandleList(IntEnum):
    """The handles that PHSR can be asked for."""

    ALL = 0
    TO_FREE = 1
    TO_INITIALISE = 2
    TO_ENABLE = 3
    ENABLED = 4


class PortHandle(NamedTuple):
    """One port handle and its status."""

    handle: int
    status: PortStatus


def decode_port_handles(text: str) -> tuple[PortHandle, ...]:
    """The handles in a reply to PHSR. Raises CodecError."""
    reader = FieldReader(text, "PHSR")
    handles = tuple(
        PortHandle(reader.hex(2), PortStatus(reader.hex(3))) for _ in range(reader.hex(2))
    )
    reader.end()
    return handles


def encode_port_handles(handles: Sequence[PortHandle]) -> str:
    """The reply to PHSR that lists `handles`. Only the low twelve status bits have room."""
    if len(handles) > 0xFF:
        raise CodecError("PHSR: at most 255 handles")
    entries = [f"{handle:02X}{status & 0xFFF:03X}" for handle, status in handles]
    return f"{len(handles):02X}" + "".join(entries)


NO_SERIAL = "00000000"
"""What some units report for a moment after a tool was initialised."""

_UNOCCUPIED = "UNOCCUPIED"


class Fields(IntFlag):
    """The options of PHINF. Their fields come in the order of the bits."""

    IDENTITY = 0x0001
    PART_NUMBER = 0x0004
    ACCESSORIES = 0x0008
    PORT = 0x0020
    SWITCHES = 0x0040
    SENSORS = 0x0080


@dataclass(frozen=True)
class Identity:
    """Who made the tool, and which one it is."""

    main_type: int
    """1 reference, 2 probe, 3 button box, 4 software-defined, 7 calibration, 0x0B catheter."""
    type_tail: str
    """The six digits after the main type: switches, LEDs, two reserved, subtype."""
    manufacturer: str
    revision: str
    serial: str
    """Eight upper-case hex digits."""
    status: PortStatus


@dataclass(frozen=True)
class PortLocation:
    """Where the tool is plugged in."""

    control_unit_serial: str
    port: int
    channel: int


@dataclass(frozen=True)
class SensorLocation:
    """Where one sensor of the tool is connected."""

    control_unit: int
    control_unit_port: int
    port: int
    channel: int


@dataclass(frozen=True)
class Sensors:
    """The tool's sensors."""

    degrees_of_freedom: int
    """5, 6, or 0 for a tool without sensors."""
    locations: tuple[SensorLocation, ...]


@dataclass(frozen=True)
class ToolInformation:
    """The fields that were asked for; the others are None."""

    identity: Identity | None = None
    part_number: str | None = None
    accessories: int | None = None
    port: PortLocation | None = None
    switches: str | None = None
    sensors: Sensors | None = None


def decode_tool_information(text: str, fields: Fields) -> ToolInformation | None:
    """The content of a reply to PHINF with these options; None: the tool is gone.

    Raises CodecError.
    """
    if text == _UNOCCUPIED:
        return None
    reader = FieldReader(text, f"PHINF:{fields:04X}")
    information = ToolInformation(
        identity=_identity(reader) if Fields.IDENTITY in fields else None,
        part_number=reader.text(20).rstrip() if Fields.PART_NUMBER in fields else None,
        accessories=reader.hex(2) if Fields.ACCESSORIES in fields else None,
        port=_port(reader) if Fields.PORT in fields else None,
        switches=reader.text(4) if Fields.SWITCHES in fields else None,
        sensors=_sensors(reader) if Fields.SENSORS in fields else None,
    )
    reader.end()
    return information


def _identity(reader: FieldReader) -> Identity:
    return Identity(
        main_type=reader.hex(2),
        type_tail=reader.text(6),
        manufacturer=reader.text(12).rstrip(),
        revision=reader.text(3),
        serial=f"{reader.hex(8):08X}",
        status=PortStatus(reader.hex(2)),
    )


def _port(reader: FieldReader) -> PortLocation:
    serial = reader.text(8)
    reader.text(2)
    return PortLocation(serial, port=reader.hex(2), channel=reader.hex(2))


def _sensors(reader: FieldReader) -> Sensors:
    degrees_of_freedom, count = reader.hex(2), reader.hex(2)
    return Sensors(
        degrees_of_freedom,
        tuple(
            SensorLocation(reader.hex(2), reader.hex(2), reader.hex(2), reader.hex(2))
            for _ in range(count)
        ),
    )


def encode_tool_information(information: ToolInformation | None) -> str:
    """The reply to PHINF with the fields that `information` has. Raises CodecError."""
    if information is None:
        return _UNOCCUPIED
    parts = [
        _encode_identity(information.identity),
        "" if information.part_number is None else _padded(information.part_number, 20),
        "" if information.accessories is None else f"{information.accessories:02X}",
        _encode_port(information.port),
        "" if information.switches is None else _padded(information.switches, 4),
        _encode_sensors(information.sensors),
    ]
    return "".join(parts)


def _encode_identity(identity: Identity | None) -> str:
    if identity is None:
        return ""
    return (
        f"{identity.main_type:02X}{_padded(identity.type_tail, 6)}"
        f"{_padded(identity.manufacturer, 12)}{_padded(identity.revision, 3)}"
        f"{_padded(identity.serial, 8)}{identity.status & 0xFF:02X}"
    )


def _encode_port(port: PortLocation | None) -> str:
    if port is None:
        return ""
    return f"{_padded(port.control_unit_serial, 8)}00{port.port:02X}{port.channel:02X}"


def _encode_sensors(sensors: Sensors | None) -> str:
    if sensors is None:
        return ""
    places = [
        f"{s.control_unit:02X}{s.control_unit_port:02X}{s.port:02X}{s.channel:02X}"
        for s in sensors.locations
    ]
    return f"{sensors.degrees_of_freedom:02X}{len(places):02X}" + "".join(places)


def _padded(text: str, width: int) -> str:
    if len(text) > width:
        raise CodecError(f"'{text}' does not fit {width} characters")
    return text.ljust(width)
