"""The communication and mapping parameters of a PDO, and the rules for changing them.

CiA 301, 7.5.2.35 to 7.5.2.38.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from drivers.canopen.codec import pdo
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.pdo import MappingEntry, PdoCobId, TransmissionType
from sim_backends.devices.drive.node.object_dictionary import Entry, ObjectDictionary, SdoAbortError

MAX_MAPPED: Final = 8

# Identifiers that no PDO may have (CiA 301, table 40).
_RESTRICTED: Final = (
    range(0x080),
    range(0x101, 0x181),
    range(0x581, 0x600),
    range(0x601, 0x680),
    range(0x6E0, 0x800),
)


@dataclass(frozen=True)
class MappingRules:
    """How a product differs from the standard in what it lets a master map."""

    fixed_count: bool = False
    """Sub-index 0 cannot be written; unused entries are 0."""
    even_bytes_only: bool = False
    dummies: bool = True


@dataclass(frozen=True, slots=True)
class Mapped:
    """One object in a PDO; a dummy has no `entry`."""

    entry: Entry | None
    field: pdo.Field


class PdoParameters:
    """The parameters of one PDO. `on_change(t_ns)` is called when one of them has been written."""

    def __init__(
        self,
        objects: ObjectDictionary,
        offset: int,
        receive: bool,
        rules: MappingRules,
        on_change: Callable[[int], None],
    ) -> None:
        self._objects = objects
        self._receive = receive
        self._rules = rules
        communication = (pdo.RPDO_COMMUNICATION if receive else pdo.TPDO_COMMUNICATION) + offset
        mapping = (pdo.RPDO_MAPPING if receive else pdo.TPDO_MAPPING) + offset
        self._cob_id = objects.own(communication, 1, DataType.UNSIGNED32, 1 << 31)
        self._type = objects.own(communication, 2, DataType.UNSIGNED8, 255)
        self._inhibit = objects.own(communication, 3, DataType.UNSIGNED16)
        self._event = objects.own(communication, 5, DataType.UNSIGNED16)
        self._start = objects.own(communication, 6, DataType.UNSIGNED8)
        self._count = objects.own(mapping, 0, DataType.UNSIGNED8)
        self._entries = [
            objects.own(mapping, subindex, DataType.UNSIGNED32)
            for subindex in range(1, MAX_MAPPED + 1)
        ]
        if rules.fixed_count:
            self._count.deliver(MAX_MAPPED)
        self._cob_id.check = self._check_cob_id
        self._type.check = self._check_type
        self._inhibit.check = self._start.check = self._check_not_valid
        self._count.check = self._check_count
        for place, entry in enumerate(self._entries):
            entry.check = partial(self._check_entry, place)
        for entry in (self._cob_id, self._type, self._inhibit, self._event, self._start):
            entry.on_write = on_change
        for entry in (self._count, *self._entries):
            entry.on_write = on_change

    @property
    def cob_id(self) -> PdoCobId:
        """Identifier and whether the PDO is valid. Raises CodecError."""
        return pdo.decode_pdo_cob_id(self._cob_id.number)

    @property
    def transmission_type(self) -> int:
        """When it is sent or applied."""
        return self._type.number

    @property
    def synchronous(self) -> bool:
        """Whether it goes with SYNC."""
        return self._type.number <= pdo.HIGHEST_SYNCHRONOUS_TYPE

    @property
    def inhibit_s(self) -> float:
        """Least time between two of it."""
        return self._inhibit.number * 1e-4

    @property
    def event_s(self) -> float:
        """Most time between two of it; 0: any."""
        return self._event.number * 1e-3

    @property
    def sync_start(self) -> int:
        """The SYNC counter with which counting begins; 0: at once."""
        return self._start.number

    def mapping(self) -> list[Mapped]:
        """What is mapped now, without entries that are 0. Raises SdoAbortError."""
        entries = self._entries[: self._count.number]
        numbers = [entry.number for entry in entries if entry.number]
        return [self._mapped(pdo.decode_mapping_entry(number)) for number in numbers]

    @property
    def usable(self) -> bool:
        """Whether it is valid, and sound: defaults from an EDS need not be."""
        try:
            pdo.PdoLayout(mapped.field for mapped in self.mapping())
            return self.cob_id.valid
        except (SdoAbortError, CodecError):
            return False

    # What a master may write

    @property
    def _valid(self) -> bool:
        return not self._cob_id.number & 1 << 31

    def _check_cob_id(self, value: int) -> None:
        try:
            new = pdo.decode_pdo_cob_id(value)
        except CodecError:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE) from None
        if new.extended:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
        if new.valid and any(new.can_id in forbidden for forbidden in _RESTRICTED):
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
        if self._valid and new.valid and value != self._cob_id.number:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _check_type(self, value: int) -> None:
        remote = (TransmissionType.REMOTE_SYNCHRONOUS, TransmissionType.REMOTE)
        reserved = value in range(pdo.HIGHEST_SYNCHRONOUS_TYPE + 1, min(remote))
        if reserved or (self._receive and value in remote):
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

    def _check_not_valid(self, _value: int) -> None:
        if self._valid:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _check_count(self, value: int) -> None:
        if self._rules.fixed_count:
            raise SdoAbortError(AbortCode.READ_ONLY)
        self._check_not_valid(value)
        self._check_length([entry.number for entry in self._entries[:value]])

    def _check_length(self, numbers: list[int]) -> None:
        if not self._rules.fixed_count and 0 in numbers:
            raise SdoAbortError(AbortCode.NOT_MAPPABLE)
        bits = sum(number & 0xFF for number in numbers)
        if bits > pdo.MAX_BITS:
            raise SdoAbortError(AbortCode.MAPPING_TOO_LONG)
        if self._rules.even_bytes_only and bits % 16:
            raise SdoAbortError(AbortCode.PARAMETER_INCOMPATIBLE)

    def _check_entry(self, place: int, value: int) -> None:
        self._check_not_valid(value)
        if value:
            self._mapped(pdo.decode_mapping_entry(value))
        if self._rules.fixed_count:
            numbers = [entry.number for entry in self._entries]
            self._check_length([*numbers[:place], value, *numbers[place + 1 :]])
        elif self._count.number:
            raise SdoAbortError(AbortCode.DEVICE_STATE)

    def _mapped(self, wanted: MappingEntry) -> Mapped:
        """The object that a mapping entry means. Raises SdoAbortError."""
        if wanted.index < 0x1000:
            return self._dummy(wanted)
        entry = self._objects.look_up(wanted.index, wanted.subindex)
        described = entry.description
        direction = described.writable if self._receive else described.readable
        if not (described.mappable and direction and wanted.bits == described.bits):
            raise SdoAbortError(AbortCode.NOT_MAPPABLE)
        return Mapped(entry, pdo.Field(described.bits, described.data_type.signed))

    def _dummy(self, wanted: MappingEntry) -> Mapped:
        """A data type as a placeholder, which only an RPDO may have (CiA 301, 7.4.7.1)."""
        if wanted.index not in self._objects.dummies or wanted.subindex:
            raise SdoAbortError(AbortCode.NO_OBJECT)
        bits = 8 * (DataType(wanted.index).size or 0)
        if not (self._receive and self._rules.dummies and wanted.bits == bits):
            raise SdoAbortError(AbortCode.NOT_MAPPABLE)
        return Mapped(None, pdo.Field(bits))
