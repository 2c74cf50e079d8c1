"""Who the emulated tracker says it is."""

from drivers.aurora.codec.tool_information import (
    Fields,
    Identity,
    PortLocation,
    SensorLocation,
    Sensors,
    ToolInformation,
)
from drivers.aurora.codec.versions import ApiRevision
from drivers.aurora.codec.volumes import Volume
from sim_backends.devices.aurora.measurement import CENTRE_MM, HALF_WIDTH_MM
from sim_backends.devices.aurora.rack import Handle

API_REVISION = ApiRevision("D", 2, 5)
CONTROL_UNIT_SERIAL = "SCd-00001"

_LOW, _HIGH = CENTRE_MM - HALF_WIDTH_MM, CENTRE_MM + HALF_WIDTH_MM
CUBE = Volume(
    "cube",
    (*(float(edge) for pair in zip(_LOW, _HIGH, strict=True) for edge in pair), 0.0, 0.0, 0.0, 0.0),
)
FEATURES = 1 << 16 | 1 << 19
"""Magnetic ports, field generator present."""

_PROBE = 0x02


def version_lines(kind: str, freeze_tag: str) -> list[str]:
    """The lines of VER:0, VER:4 and VER:7."""
    if kind == "7":
        return [
            "Field Generator S/N: FGe-00001",
            "Model: Planar",
            "Characterization Date: 01/02/20",
        ]
    return [
        "Aurora emulation",
        f"NDI S/N: {CONTROL_UNIT_SERIAL}",
        "Characterization Date: 01/02/20",
        f"Freeze Tag: {freeze_tag}{'.000' if kind == '4' else ''}",
        "Freeze Date: 01/02/20",
        "tentacled",
    ]


def combined_firmware(freeze_tag: str) -> str:
    """Three digits, as VER:5 gives them."""
    return freeze_tag.rpartition(" ")[2]


def tool_information(handle: Handle, fields: Fields, serial: str) -> ToolInformation | None:
    """What PHINF tells of the tool behind a handle; None: it is gone."""
    if handle.gone:
        return None
    tool = handle.socket.tool
    location = SensorLocation(0, 1, tool.port, tool.channel)
    coils = 1 if tool.degrees_of_freedom == 5 else 2
    return ToolInformation(
        identity=Identity(_PROBE, "000000", "tentacled", "001", serial, handle.status)
        if Fields.IDENTITY in fields
        else None,
        part_number=tool.part_number if Fields.PART_NUMBER in fields else None,
        accessories=0 if Fields.ACCESSORIES in fields else None,
        port=PortLocation("SCd00001", tool.port, tool.channel) if Fields.PORT in fields else None,
        switches="0000" if Fields.SWITCHES in fields else None,
        sensors=Sensors(tool.degrees_of_freedom, (location,) * coils)
        if Fields.SENSORS in fields
        else None,
    )
