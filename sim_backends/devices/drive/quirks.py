"""Ways of real products, as switches: what a master has to get along with."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields

from config.emulation.lab import Quirk
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.pdo import TPDO_COMMUNICATION
from sim_backends.devices.drive.axis.cyclic import CyclicPosition, InterpolationPeriod
from sim_backends.devices.drive.node.communication import CommunicationQuirks
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.pdo_parameters import MappingRules

_MILLISECONDS = -3
_CYCLIC_POSITION_BIT = 1 << CyclicPosition.code - 1
_STAY, _STOP = 1, 2
_FLOODING_PDOS = (2, 3)
_FLOOD_PERIOD_MS = 2
_NOT_VALID = 1 << 31


@dataclass(frozen=True)
class Quirks:
    """Which of them a drive has."""

    boots_twice: bool = False
    """A boot loader sends a boot-up message of its own first (Nanotec)."""

    csp_not_listed: bool = False
    """0x6502 does not list cyclic synchronous position, which works all the same (EPOS4)."""

    emcy_short: bool = False
    """EMCY messages end after the error register: 3 bytes instead of 8."""

    fixed_mapping_count: bool = False
    """Sub-index 0 of the PDO mapping cannot be written; entries that are not used are zeroed."""

    even_mapping_only: bool = False
    """A mapping whose length is odd is refused with abort code 0x06040043."""

    no_dummy_mapping: bool = False
    """Data types cannot be mapped as placeholders (EPOS4)."""

    factory_pdos_flood: bool = False
    """Leaves the factory with TPDO 3 and 4 valid, every 2 ms."""

    guarding_excludes_heartbeat: bool = False
    """With node guarding on, a heartbeat is refused, and the other way round (Nanotec)."""

    interpolation_index_fixed: bool = False
    """0x60C2:2 takes nothing but -3: periods are whole milliseconds (Nanotec, Elmo)."""

    interpolation_while_inactive: bool = False
    """0x60C2 can be written only while the mode that uses it is not active (Elmo)."""

    late_sync_holds: bool = False
    """A SYNC that is 0.75 ms late sets bit 15 of the statusword; until the next one that is in
    time the last target is held (isel)."""

    no_encoder: bool = False
    """A stepper that takes its demand for its position: no following error, stalls unnoticed
    (Trinamic without encoder)."""

    communication_error_stops: bool = False
    """0x1029 knows only 'stay' (1) and 'stop' (2, as delivered), not pre-operational (Trinamic)."""

    tells_reference: bool = False
    """Bit 15 of the statusword says whether the drive knows its zero (EPOS4)."""

    counts_modulo_turn: bool = False
    """Leaves the factory as a rotary table: positions begin anew after each turn of the motor
    (0x607B), and a target is gone to by the shorter way."""

    @classmethod
    def of(cls, names: Iterable[Quirk]) -> "Quirks":
        """Those with these names."""
        present = set(names)
        return cls(**{field.name: field.name in present for field in fields(cls)})

    @property
    def communication(self) -> CommunicationQuirks:
        """What they say about the node's services."""
        mapping_rules = MappingRules(
            fixed_count=self.fixed_mapping_count,
            even_bytes_only=self.even_mapping_only,
            dummies=not self.no_dummy_mapping,
        )
        return CommunicationQuirks(
            self.emcy_short, self.guarding_excludes_heartbeat, self.late_sync_holds, mapping_rules
        )

    def leave_factory(self, objects: ObjectDictionary, axis_offsets: Iterable[int]) -> None:
        """Change what the drive is delivered with."""
        if self.communication_error_stops:
            objects.own(0x1029, 1, DataType.UNSIGNED8).deliver(_STOP)
        if self.counts_modulo_turn:
            for offset in axis_offsets:
                turn = objects.own(offset + 0x608F, 1, DataType.UNSIGNED32).number
                objects.own(offset + 0x607B, 1, DataType.INTEGER32).deliver(0)
                objects.own(offset + 0x607B, 2, DataType.INTEGER32).deliver(turn - 1)
        if self.csp_not_listed:
            for offset in axis_offsets:
                modes = objects.own(offset + 0x6502, 0, DataType.UNSIGNED32)
                modes.deliver(modes.number & ~_CYCLIC_POSITION_BIT)
        if self.factory_pdos_flood:
            for number in _FLOODING_PDOS:
                cob_id = objects.own(TPDO_COMMUNICATION + number, 1, DataType.UNSIGNED32)
                cob_id.deliver(cob_id.number & ~_NOT_VALID)
                objects.own(TPDO_COMMUNICATION + number, 3, DataType.UNSIGNED16).deliver(0)
                event = objects.own(TPDO_COMMUNICATION + number, 5, DataType.UNSIGNED16)
                event.deliver(_FLOOD_PERIOD_MS)

    def restrict_communication_error(self, objects: ObjectDictionary) -> None:
        """What 0x1029 takes."""
        if self.communication_error_stops:
            objects.own(0x1029, 1, DataType.UNSIGNED8).check = _only(_STAY, _STOP)

    def restrict_interpolation(
        self, period: InterpolationPeriod, active: Callable[[], bool]
    ) -> None:
        """What 0x60C2 takes; active(): whether the axis follows a mode that uses it."""

        def check_inactive(_value: int) -> None:
            if self.interpolation_while_inactive and active():
                raise SdoAbortError(AbortCode.DEVICE_STATE)

        def check_exponent(value: int) -> None:
            check_inactive(value)
            if self.interpolation_index_fixed and value != _MILLISECONDS:
                raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

        period.value.check = check_inactive
        period.exponent.check = check_exponent


def _only(*values: int) -> Callable[[int], None]:
    def check(value: int) -> None:
        if value not in values:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

    return check
