"""SFLIST: the measurement volumes that the field generator offers."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from drivers.aurora.codec.errors import CodecError

Shape = Literal["cube", "dome"]

_SHAPES: dict[str, Shape] = {"9": "cube", "A": "dome"}
_CODES = {shape: code for code, shape in _SHAPES.items()}
_PARAMETERS = 10
_VOLUME = re.compile(rf"([0-9A-Fa-f])((?:[+-]\d{{6}}){{{_PARAMETERS}}})(.)([012])", re.ASCII)


@dataclass(frozen=True)
class Volume:
    """One measurement volume.

    parameters_mm: ten lengths. A cube has x, y, z as (lowest, highest) pairs and four zeros.
    """

    shape: Shape
    parameters_mm: tuple[float, ...]
    metal_resistant: bool | None = None


def decode_volumes(text: str) -> tuple[Volume, ...]:
    """The volumes in a reply to SFLIST:03. Raises CodecError."""
    lines = text[1:].split("\n")
    if len(lines) < 2 or lines.pop() != "" or f"{len(lines):X}" != text[0].upper():
        raise CodecError("SFLIST: the number of volumes and of lines differ")
    return tuple(_decode_volume(line) for line in lines)


def _decode_volume(line: str) -> Volume:
    match = _VOLUME.fullmatch(line)
    if match is None or match[1].upper() not in _SHAPES:
        raise CodecError(f"SFLIST: '{line}' is not a volume")
    numbers = (match[2][7 * i : 7 * i + 7] for i in range(_PARAMETERS))
    return Volume(
        _SHAPES[match[1].upper()],
        tuple(int(number) / 100.0 for number in numbers),
        {"0": None, "1": True, "2": False}[match[4]],
    )


def encode_volumes(volumes: Sequence[Volume]) -> str:
    """The reply to SFLIST:03. Raises CodecError where a value does not fit its field."""
    if not 1 <= len(volumes) <= 15:
        raise CodecError("SFLIST: 1 to 15 volumes")
    return f"{len(volumes):X}" + "".join(_encode_volume(volume) for volume in volumes)


def _encode_volume(volume: Volume) -> str:
    numbers = "".join(f"{round(100.0 * value):+07d}" for value in volume.parameters_mm)
    if len(numbers) != 7 * _PARAMETERS:
        raise CodecError("SFLIST: a volume has ten parameters of at most 9999.99 mm")
    metal = {None: "0", True: "1", False: "2"}[volume.metal_resistant]
    return f"{_CODES[volume.shape]}{numbers}0{metal}\n"
