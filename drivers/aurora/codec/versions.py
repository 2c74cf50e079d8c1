"""APIREV and VER: which interface and which firmware the device has."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from drivers.aurora.codec.errors import CodecError

AURORA_FAMILY = "D"

_REVISION = re.compile(r"([A-Z])\.(\d{3})\.(\d{3})", re.ASCII)


@dataclass(frozen=True, order=True)
class ApiRevision:
    """Revision of the interface: `D.002.005`. The family says what kind of device it is."""

    family: str
    major: int
    minor: int

    @classmethod
    def decode(cls, text: str) -> Self:
        """From a reply to APIREV. Raises CodecError."""
        match = _REVISION.fullmatch(text)
        if match is None:
            raise CodecError(f"APIREV: '{text}' is not a revision")
        return cls(match[1], int(match[2]), int(match[3]))

    def __str__(self) -> str:
        return f"{self.family}.{self.major:03d}.{self.minor:03d}"


@dataclass(frozen=True)
class VersionText:
    """The lines of VER:0, VER:4 or VER:7, some of them `Name: value`."""

    lines: tuple[str, ...]

    @classmethod
    def decode(cls, text: str) -> Self:
        """From a reply to VER. Raises CodecError."""
        if not text:
            raise CodecError("VER: the reply is empty")
        return cls(tuple(text.removesuffix("\n").split("\n")))

    def value(self, name: str) -> str:
        """What follows `name:`, or nothing."""
        for line in self.lines:
            head, separator, tail = line.partition(":")
            if separator and head.strip() == name:
                return tail.strip()
        return ""


def encode_version_text(lines: Sequence[str]) -> str:
    """The reply to VER that holds `lines`."""
    return "".join(f"{line}\n" for line in lines)
