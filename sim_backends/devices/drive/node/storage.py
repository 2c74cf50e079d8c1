"""Storing parameters and restoring defaults (0x1010, 0x1011), over a loss of power."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType, Value
from sim_backends.devices.drive.node.object_dictionary import (
    Key,
    ObjectDictionary,
    SdoAbortError,
)

SAVE: Final = int.from_bytes(b"save", "little")
LOAD: Final = int.from_bytes(b"load", "little")

_ON_COMMAND: Final = 1  # what the objects read: stores and restores when told
_ALL, _COMMUNICATION, _APPLICATION = 1, 2, 3
STORE_S: Final = 0.3

# Commands to the drive, not settings.
_NOT_STORED: Final = range(0x1003, 0x1004), range(0x1010, 0x1012)


class Storage:
    """The drive's non-volatile memory.

    busy(seconds): the SDO server is kept waiting. locked(): whether the present state forbids it.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        busy: Callable[[float], None],
        locked: Callable[[], bool],
    ) -> None:
        self._objects = objects
        self._busy = busy
        self._locked = locked
        self._stored: dict[bool, dict[Key, Value]] = {True: {}, False: {}}
        for subindex in (_ALL, _COMMUNICATION, _APPLICATION):
            self._bind(0x1010, subindex, SAVE, self._save)
            self._bind(0x1011, subindex, LOAD, self._forget)

    def load(self, *, communication: bool) -> None:
        """Set the objects to what is stored, or to the defaults."""
        self._objects.reset(communication, self._stored[communication])

    def _save(self, communication: bool) -> None:
        settings = self._objects.settings(communication)
        self._stored[communication] = {
            key: value
            for key, value in settings.items()
            if not any(key[0] in commands for commands in _NOT_STORED)
        }

    def _forget(self, communication: bool) -> None:
        """In effect after the next reset."""
        self._stored[communication] = {}

    def _bind(self, index: int, subindex: int, signature: int, act: Callable[[bool], None]) -> None:
        entry = self._objects.own(index, subindex, DataType.UNSIGNED32, _ON_COMMAND)

        def check(value: int) -> None:
            if value != signature:
                raise SdoAbortError(AbortCode.CANNOT_STORE)
            if self._locked():
                raise SdoAbortError(AbortCode.DEVICE_STATE)

        def written(_t_ns: int) -> None:
            entry.value = _ON_COMMAND
            for communication in _areas(subindex):
                act(communication)
            self._busy(STORE_S)

        entry.check = check
        entry.on_write = written


def _areas(subindex: int) -> tuple[bool, ...]:
    """Which areas a sub-index means: communication (True), application (False)."""
    return {_ALL: (True, False), _COMMUNICATION: (True,), _APPLICATION: (False,)}[subindex]
