"""Reads what objects a drive has from its EDS file (CiA 306)."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from canopen.objectdictionary import ODVariable
from canopen.objectdictionary.eds import import_eds

from drivers.canopen.codec.data_types import DataType, Value


class EmulatedEdsError(ValueError):
    """A file that is no EDS, or of a device that is no CiA 402 drive. Names the file."""


@dataclass(frozen=True, slots=True)
class ObjectDescription:
    """One object as the EDS describes it."""

    index: int
    subindex: int
    name: str
    data_type: DataType
    readable: bool
    writable: bool
    mappable: bool
    low: int | None
    high: int | None
    default: Value
    plus_node_id: bool
    """Whether the node ID is added to `default`."""

    @property
    def bits(self) -> int:
        """Length in a PDO; 0 where it has none."""
        if self.data_type is DataType.BOOLEAN:
            return 1
        return 8 * (self.data_type.size or 0)


@dataclass(frozen=True, slots=True)
class DeviceDescription:
    """All objects of a device, and which dummies it lets an RPDO map."""

    objects: tuple[ObjectDescription, ...]
    dummies: frozenset[DataType]


@lru_cache(maxsize=32)
def read_eds(path: Path) -> DeviceDescription:
    """The device that an EDS file describes. Raises EmulatedEdsError."""
    try:
        dictionary = import_eds(str(path), 0)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise EmulatedEdsError(f"{path}: {error.strerror}") from None
    except Exception as error:  # the library raises whatever its parsing happens to meet
        raise EmulatedEdsError(f"{path}: not a sound EDS file: {error}") from error
    variables = list(_variables(dictionary))
    objects = tuple(_description(v) for v in variables if v.index >= 0x1000)
    if not any(described.index == 0x6040 for described in objects):
        raise EmulatedEdsError(f"{path}: no controlword (0x6040): not a CiA 402 drive")
    dummies = frozenset(DataType(v.index) for v in variables if v.index < 0x1000)
    return DeviceDescription(objects, dummies)


def _variables(dictionary: Any) -> Iterator[Any]:
    for entry in dictionary.values():
        if isinstance(entry, ODVariable):
            yield entry
        else:
            yield from entry.subindices.values()


def _description(variable: Any) -> ObjectDescription:
    try:
        data_type = DataType(variable.data_type)
    except ValueError:
        data_type = DataType.DOMAIN
    return ObjectDescription(
        variable.index,
        variable.subindex,
        variable.name,
        data_type,
        variable.readable,
        variable.writable,
        variable.pdo_mappable and data_type.size is not None,
        variable.min,
        variable.max,
        _default(data_type, variable.default),
        bool(variable.relative),
    )


def _default(data_type: DataType, default: object) -> Value:
    if data_type.size is not None:
        return default if isinstance(default, int) else 0
    if isinstance(default, str):
        return default.encode("latin-1", "replace")
    return default if isinstance(default, bytes) else b""
