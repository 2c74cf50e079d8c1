"""Setting up one node: who it is, its safety reactions, its PDOs; everything is read back.

Nothing here energises a drive. A node whose settings are not what was written is not used.
"""

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final

from config.axis import Axis
from config.bus import Bus
from drivers.axis_scale import CountFactors, count_differences
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.pdo import (
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    TPDO_COMMUNICATION,
    PdoCobId,
    TransmissionType,
    decode_pdo_cob_id,
)
from drivers.canopen.object_dictionary import EdsError, ObjectDictionary
from drivers.canopen.sdo_client import (
    SdoAbortedError,
    SdoClient,
    SdoError,
    SdoTimeoutError,
    SdoViolatedError,
)
from drivers.cia402 import objects
from drivers.cia402.conditions import (
    BAD_EDS,
    COUNTS_DIFFER,
    CYCLIC_MODE_NOT_LISTED,
    EMERGENCIES_UNHEARD,
    NUMBER_TWICE,
    SAFETY_MISSING,
    SDO_SILENT,
    SETTING_REFUSED,
    WRONG_DEVICE,
)
from drivers.cia402.configuration import Need, Setting, node_settings, sync_settings
from drivers.cia402.pdo_plan import PdoPlan, axis_pdos
from drivers.conditions import Condition

_PDO_PARAMETERS: Final = RPDO_MAPPING - RPDO_COMMUNICATION
_PDO_OBJECTS: Final = range(RPDO_COMMUNICATION, TPDO_COMMUNICATION + 2 * _PDO_PARAMETERS)
_NOT_FOR_OTHERS: Final = (
    objects.STORE_PARAMETERS,
    objects.RESTORE_DEFAULTS,
    objects.EMERGENCY_COB_ID,
    objects.SYNC_COB_ID,
    objects.SYNC_COUNTER,
)
_NOT_VALID: Final = 1 << 31
_EVENT_TIMER: Final = 5
_DEADLINE: Final = "time-out of the set-points"
_ANSWERS_TWICE: Final = 2  # a single one may be left over from somebody who was here before
_MODE_WITHIN_S: Final = 1.0  # some drives take a mode up with the first SYNC, or later
_POLL_S: Final = 0.02
_FACTORS: Final = (objects.GEAR_RATIO, objects.FEED_CONSTANT, objects.VELOCITY_FACTOR)
_NO_OBJECT: Final = (AbortCode.NO_OBJECT, AbortCode.NO_SUBINDEX)

Remark = Callable[[Condition, str], None]


class BringUpError(RuntimeError):
    """The node cannot be used, and why."""

    def __init__(self, condition: Condition, detail: str) -> None:
        super().__init__(f"{condition.text}: {detail}")
        self.condition = condition
        self.detail = detail


@dataclass(frozen=True)
class Identity:
    """Who a node says it is."""

    device_type: int
    vendor_id: int
    product_code: int
    revision: int
    serial: int
    name: str


class NodeSetUp:
    """Sets up one node over its SDO channel."""

    def __init__(
        self,
        bus: Bus,
        axes: Sequence[Axis],
        dictionary: ObjectDictionary,
        sdo: SdoClient,
        remark: Remark,
    ) -> None:
        self._bus = bus
        self._axes = axes
        self._dictionary = dictionary
        self._sdo = sdo
        self._remark = remark
        self._applied: dict[tuple[int, int], Setting] = {}

    async def run(self) -> Identity:
        """Do it all, with the node in pre-operational. Raises BringUpError."""
        before = self._sdo.unasked
        try:
            identity = await self._run()
        except BringUpError as error:
            self._check_alone(before, f"; {error}")
            raise
        self._check_alone(before)
        return identity

    def _check_alone(self, unasked_before: int, therefore: str = "") -> None:
        """Two drives of one number would both go where one of them is sent."""
        twice = self._sdo.unasked - unasked_before
        if twice >= _ANSWERS_TWICE:
            raise BringUpError(NUMBER_TWICE, f"{twice} answers came twice{therefore}")

    async def _run(self) -> Identity:
        self._applied.clear()
        try:
            identity = await self._identify()
            await self._check_modes()
            for setting in node_settings(self._bus, self._axes):
                await self._apply(setting)
            await self._check_counts()
            await self._set_up_pdos()
        except SdoTimeoutError as error:
            raise BringUpError(SDO_SILENT, str(error)) from error
        except SdoError as error:
            raise BringUpError(SETTING_REFUSED, str(error)) from error
        except EdsError as error:
            raise BringUpError(BAD_EDS, str(error)) from error
        except CodecError as error:
            raise BringUpError(WRONG_DEVICE, str(error)) from error
        return identity

    async def differences(self) -> list[str]:
        """Read back what the node's safety depends on; what differs from what was set.

        Raises SdoError, EdsError, CodecError.
        """
        differences = []
        for setting in self._applied.values():
            if setting.need is Need.OPTIONAL:
                continue
            read = await self._number(setting.index, setting.subindex)
            if read not in setting.values:
                wanted = " or ".join(map(str, setting.values))
                differences.append(f"{setting} reads {read}, not {wanted}")
        return differences

    async def tells_errors_elsewhere(self) -> bool:
        """Whether its emergencies do not come where they are listened to: where nodes send them
        unless they were told otherwise."""
        index = objects.EMERGENCY_COB_ID
        if not self._dictionary.has(index):
            return False
        try:
            return await self._number(index) not in self._errors_told_here.values
        except (SdoError, EdsError, CodecError):
            return False

    async def have_errors_told_here(self) -> None:
        """Of a node that is not operational: some take no other place meanwhile. Raises SdoError,
        EdsError, CodecError."""
        setting, index, refusal = self._errors_told_here, objects.EMERGENCY_COB_ID, ""
        (wanted,) = setting.values
        try:
            # While it is in use it takes no other place either.
            await self._write(index, 0, _NOT_VALID | await self._number(index))
            await self._write(index, 0, wanted)
        except SdoAbortedError as error:
            refusal = f"; it refused: {error}"
        read = await self._number(index)
        if read == wanted:
            self._applied[index, 0] = setting
        else:
            detail = f"{setting} reads 0x{read:X}, not 0x{wanted:X}{refusal}"
            self._remark(EMERGENCIES_UNHEARD, detail)

    @property
    def _errors_told_here(self) -> Setting:
        wanted = cob_ids.emergency(self._axes[0].drive.node)
        return Setting(objects.EMERGENCY_COB_ID, 0, (wanted,), "where it tells its errors")

    async def have_our_sync_taken(self) -> None:
        """For a node that sends no state. Raises BringUpError, SdoError, EdsError, CodecError."""
        for setting in sync_settings(self._bus):
            await self._apply(setting)

    async def error_code(self, axis: Axis) -> int:
        """Which error an axis had last; 0: none, or it does not say. Raises SdoError."""
        return await self._number(objects.of_axis(objects.ERROR_CODE, axis.drive.axis), missing=0)

    async def mode_refusals(self) -> list[str]:
        """Axes that show another mode than they were told, a while after the node was started.
        Raises SdoError."""
        refusals = []
        for axis in self._axes:
            number = objects.MODES[axis.drive.mode].number
            index = objects.of_axis(objects.MODE_DISPLAY, axis.drive.axis)
            try:
                async with asyncio.timeout(_MODE_WITHIN_S):
                    while (shown := await self._number(index)) != number:
                        await asyncio.sleep(_POLL_S)
            except TimeoutError:
                refusals.append(f"{axis.name}: told {number}, shows {shown}")
        return refusals

    def meaning_of(self, index: int, subindex: int) -> str | None:
        """What an object is that is as we need it; None for one that may be anything."""
        setting = self._applied.get((index, subindex))
        if setting is not None:
            return str(setting)
        if index in _PDO_OBJECTS or index in _NOT_FOR_OTHERS:
            return f"0x{index:04X}:{subindex:02X}"
        return None

    async def _identify(self) -> Identity:
        device_type = await self._number(objects.DEVICE_TYPE)
        numbers = [await self._number(objects.IDENTITY, place, missing=0) for place in range(1, 5)]
        text = await self._name()
        vendor, product, revision, serial = numbers
        identity = Identity(device_type, vendor, product, revision, serial, text)
        drive = self._axes[0].drive
        for what, wanted, found in (
            ("device profile", objects.DEVICE_PROFILE_402, identity.device_type & 0xFFFF),
            ("vendor ID", drive.vendor_id, identity.vendor_id),
            ("product code", drive.product_code, identity.product_code),
        ):
            if wanted is not None and wanted != found:
                raise BringUpError(WRONG_DEVICE, f"{what} is 0x{found:X}, not 0x{wanted:X}")
        return identity

    async def _name(self) -> str:
        """What it calls itself. Nothing depends on it."""
        if not self._dictionary.has(objects.DEVICE_NAME):
            return ""
        try:
            name = await self._sdo.read(objects.DEVICE_NAME)
        except SdoViolatedError:
            raise
        except SdoAbortedError:
            return ""
        return name.decode("ascii", "replace").strip("\0 ")

    async def _check_modes(self) -> None:
        for axis in self._axes:
            index = objects.of_axis(objects.SUPPORTED_MODES, axis.drive.axis)
            mode = objects.MODES[axis.drive.mode]
            if self._dictionary.has(index):
                listed = await self._number(index, missing=-1)
                if not listed >> (mode.number - 1) & 1:
                    self._remark(CYCLIC_MODE_NOT_LISTED, f"{axis.name}: {mode.text}")

    async def _check_counts(self) -> None:
        differences = []
        for axis in self._axes:
            factors = CountFactors(*[await self._ratio(index, axis) for index in _FACTORS])
            found = count_differences(factors, axis.drive)
            differences += [f"{axis.name}: {difference}" for difference in found]
        if differences:
            self._remark(COUNTS_DIFFER, "; ".join(differences))

    async def _ratio(self, index: int, axis: Axis) -> Fraction | None:
        """Numerator and divisor of a factor; None where the node does not show both."""
        index = objects.of_axis(index, axis.drive.axis)
        if not (self._dictionary.has(index, 1) and self._dictionary.has(index, 2)):
            return None
        try:
            numerator, divisor = [await self._number(index, place) for place in (1, 2)]
        except SdoViolatedError:
            raise
        except SdoAbortedError:
            return None
        return Fraction(numerator, divisor) if numerator and divisor else None

    async def _apply(self, setting: Setting) -> None:
        """Write a setting and read it back."""
        if not self._dictionary.has(setting.index, setting.subindex):
            self._without(setting, "not in its EDS file")
            return
        refusal = ""
        for value in setting.values:
            try:
                await self._write(setting.index, setting.subindex, value)
                break
            except SdoAbortedError as error:
                if error.code in _NO_OBJECT:
                    self._without(setting, "the node does not have it")
                    return
                refusal = f"; it refused: {error}"
        read = await self._number(setting.index, setting.subindex)
        if read not in setting.values:
            wrote = " or ".join(map(str, setting.values))
            raise BringUpError(SETTING_REFUSED, f"{setting}: wrote {wrote}, reads {read}{refusal}")
        self._applied[setting.index, setting.subindex] = setting

    def _without(self, setting: Setting, why: str) -> None:
        if setting.need is Need.REQUIRED:
            raise BringUpError(SETTING_REFUSED, f"{setting}: {why}")
        if setting.need is Need.SAFETY:
            self._remark(SAFETY_MISSING, f"{setting}: {why}")

    async def _set_up_pdos(self) -> None:
        used = set()
        for axis in self._axes:
            pdos = axis_pdos(axis.drive)
            for plan in (pdos.rpdo, pdos.tpdo):
                used.add(plan.communication)
                await self._set_up_pdo(plan)
        # Event-driven PDOs that the maker left on would flood the bus.
        for first in (RPDO_COMMUNICATION, TPDO_COMMUNICATION):
            for index in range(first, first + _PDO_PARAMETERS):
                if index not in used and self._dictionary.has(index, 1):
                    await self._switch_off_pdo(index)

    async def _set_up_pdo(self, plan: PdoPlan) -> None:
        # Whether remote requests are allowed is the node's: some refuse to have that changed.
        remote = decode_pdo_cob_id(await self._number(plan.communication, 1)).remote_allowed
        off, on = PdoCobId(plan.can_id, False, remote), PdoCobId(plan.can_id, True, remote)
        await self._write(plan.communication, 1, off.encode())
        await self._write(plan.communication, 2, TransmissionType.EVERY_SYNC)
        if plan.deadline_ms:
            values = (plan.deadline_ms,)
            await self._apply(Setting(plan.communication, _EVENT_TIMER, values, _DEADLINE))
        fixed_entries = await self._clear_mapping(plan)
        entries = [entry.encode() for entry in plan.entries]
        padded = entries + [0] * (fixed_entries - len(entries))
        for subindex, value in enumerate(padded, start=1):
            await self._write(plan.mapping, subindex, value)
        if not fixed_entries:
            await self._write(plan.mapping, 0, len(entries))
        await self._write(plan.communication, 1, on.encode())
        await self._verify_pdo(plan, padded, fixed_entries or len(entries))

    async def _clear_mapping(self, plan: PdoPlan) -> int:
        """Switch the mapping off. Returns how many entries it has where that number is fixed."""
        try:
            await self._write(plan.mapping, 0, 0)
        except SdoAbortedError as error:
            if error.code not in (AbortCode.READ_ONLY, AbortCode.UNSUPPORTED_ACCESS):
                raise
            return await self._number(plan.mapping, 0)
        return 0

    async def _verify_pdo(self, plan: PdoPlan, entries: Sequence[int], count: int) -> None:
        wanted = [(plan.mapping, 0, count), (plan.communication, 2, TransmissionType.EVERY_SYNC)]
        wanted += [(plan.mapping, place, entry) for place, entry in enumerate(entries, start=1)]
        for index, subindex, value in wanted:
            read = await self._number(index, subindex)
            if read != value:
                where = f"0x{index:04X}:{subindex:02X}"
                raise BringUpError(
                    SETTING_REFUSED, f"{where} (PDO): wrote 0x{value:X}, reads 0x{read:X}"
                )
        cob_id = await self._number(plan.communication, 1)
        if cob_id & 0xBFFFFFFF != plan.can_id:  # bit 30, no remote request, is the node's choice
            where = f"0x{plan.communication:04X}:01 (PDO)"
            raise BringUpError(
                SETTING_REFUSED, f"{where}: wrote 0x{plan.can_id:X}, reads 0x{cob_id:X}"
            )

    async def _switch_off_pdo(self, index: int) -> None:
        try:
            cob_id = await self._number(index, 1)
            if not cob_id & _NOT_VALID:
                await self._write(index, 1, cob_id | _NOT_VALID)
        except SdoAbortedError as error:
            if error.code not in _NO_OBJECT:
                raise

    async def _write(self, index: int, subindex: int, value: int) -> None:
        await self._sdo.write(index, subindex, self._dictionary.encode(index, subindex, value))

    async def _number(self, index: int, subindex: int = 0, missing: int | None = None) -> int:
        """A number that the node has; `missing` where it has none."""
        known = self._dictionary.has(index, subindex)
        size = self._dictionary.size(index, subindex) if known else None
        try:
            data = await self._sdo.read(index, subindex, size)
        except SdoAbortedError as error:
            if missing is not None and error.code in _NO_OBJECT:
                return missing
            raise
        if known:
            value = self._dictionary.decode(index, subindex, data)
            if isinstance(value, int):
                return value
        return int.from_bytes(data, "little")
