"""What a node's EDS file says of its objects: which there are, and of what type."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import canopen.objectdictionary as eds_reader

from drivers.canopen.codec.data_types import DataType, Value, decode_value, encode_value
from drivers.canopen.codec.error import CodecError


class EdsError(ValueError):
    """An EDS file that cannot be used; the text says why."""


class ObjectDictionary:
    """The objects of one kind of node."""

    def __init__(self, path: Path) -> None:
        """Raises EdsError."""
        self._path = path
        try:
            self._objects = _objects(path, path.stat().st_mtime_ns)
        except Exception as error:  # the reader raises whatever its parsers do
            raise EdsError(f"{path}: not an EDS file: {error}") from error

    def has(self, index: int, subindex: int = 0) -> bool:
        """Whether the node has this object."""
        return self._variable(index, subindex) is not None

    def size(self, index: int, subindex: int) -> int | None:
        """Bytes of a value; None where it may have any length. Raises EdsError."""
        return self._type(index, subindex).size

    def encode(self, index: int, subindex: int, value: Value) -> bytes:
        """A value as the node takes it. Raises EdsError, CodecError."""
        with _at(index, subindex):
            return encode_value(self._type(index, subindex), value)

    def decode(self, index: int, subindex: int, data: bytes) -> Value:
        """A value as the node gives it. Raises EdsError, CodecError."""
        with _at(index, subindex):
            return decode_value(self._type(index, subindex), data)

    def _type(self, index: int, subindex: int) -> DataType:
        variable = self._variable(index, subindex)
        if variable is None:
            raise EdsError(f"{self._path}: there is no object 0x{index:04X}:{subindex:02X}")
        try:
            return DataType(variable.data_type)
        except ValueError:
            kind = f"0x{variable.data_type:02X}"
            raise EdsError(
                f"{self._path}: object 0x{index:04X}:{subindex:02X} is of unknown type {kind}"
            ) from None

    def _variable(self, index: int, subindex: int) -> Any:
        entry = self._objects.get(index)
        if entry is None:
            return None
        if isinstance(entry, eds_reader.ODVariable):
            return entry if subindex == 0 else None
        try:
            return entry[subindex]
        except KeyError:
            return None


@contextmanager
def _at(index: int, subindex: int) -> Iterator[None]:
    """What does not fit an object's type names the object."""
    try:
        yield
    except CodecError as error:
        raise CodecError(f"0x{index:04X}:{subindex:02X}: {error}, as its EDS file has it") from None


@lru_cache(maxsize=32)
def _objects(path: Path, modified_ns: int) -> Any:
    """Nodes of one kind share a file, and reading it takes a while. Which node it is does not
    matter: that only changes default values."""
    del modified_ns
    # The plain dictionary of it: the reader's own takes long to say what is not there.
    return eds_reader.import_od(str(path)).indices
