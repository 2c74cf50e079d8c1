"""The SYNC consumer (CiA 301, 7.2.5): passes SYNC on, and notices when it is late or missing."""

from collections.abc import Callable
from typing import Final

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import SYNC_LENGTH
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.sync import decode_sync
from sim_backends.devices.drive.node.emergency import EmergencyProducer
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.timers import Timers

LATE_S: Final = 0.75e-3


class SyncConsumer:
    """on_sync(counter, t_ns): a SYNC. on_lost(t_ns): none for `lost_after_periods` of 0x1006.

    on_late(late, t_ns): the last one came more than 0.75 ms after its time, or did not.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        timers: Timers,
        emergency: EmergencyProducer,
        on_sync: Callable[[int | None, int], None],
        on_lost: Callable[[int], None],
        on_late: Callable[[bool, int], None] | None,
        lost_after_periods: float,
    ) -> None:
        self._timers = timers
        self._timer = timers.watch(on_lost)
        self._emergency = emergency
        self._on_sync = on_sync
        self._on_late = on_late
        self._lost_after_periods = lost_after_periods
        self.cob_id = objects.own(0x1005, 0, DataType.UNSIGNED32, 0x80)
        self._period_us = objects.own(0x1006, 0, DataType.UNSIGNED32)
        self._overflow = objects.own(0x1019, 0, DataType.UNSIGNED8)
        self.cob_id.check = _check_cob_id
        self._overflow.check = self._check_overflow
        self._period_us.on_write = lambda _: self.restart()
        self._period_ns = self._lost_after_ns = 0
        self._last_ns: int | None = None
        self._wrong_length = False
        self.deaf = False
        """By a fault."""

    def restart(self) -> None:
        """Watch anew, from the next SYNC on."""
        self._period_ns = self._timers.host_ns(self._period_us.number * 1e-6)
        self._lost_after_ns = int(self._lost_after_periods * self._period_ns)
        self._timer.cancel()
        self._last_ns = None

    def received(self, _can_id: int, data: bytes, t_ns: int) -> None:
        """A SYNC was on the bus."""
        if self.deaf:
            return
        counter = None
        if data or self._overflow.value or self._wrong_length:
            if not self._length_checked(data, t_ns):
                return
            counter = data[0] if data else None
        if self._period_ns:
            self._timer.set(t_ns + self._lost_after_ns)
            if self._on_late is not None:
                self._check_lateness(self._on_late, t_ns)
        self._on_sync(counter, t_ns)

    def _check_lateness(self, on_late: Callable[[bool, int], None], t_ns: int) -> None:
        if self._last_ns is not None:
            late_ns = t_ns - self._last_ns - self._period_ns
            on_late(late_ns > self._timers.host_ns(LATE_S), t_ns)
        self._last_ns = t_ns

    def _length_checked(self, data: bytes, t_ns: int) -> bool:
        """A counter where none is expected, or the other way round, is told once."""
        try:
            counted = decode_sync(data) is not None
        except CodecError:
            return False
        wrong = counted != bool(self._overflow.number)
        if wrong and not self._wrong_length:
            self._emergency.raise_error(SYNC_LENGTH, t_ns)
        elif not wrong and self._wrong_length:
            self._emergency.clear_error(SYNC_LENGTH, t_ns)
        self._wrong_length = wrong
        return not wrong

    def _check_overflow(self, value: int) -> None:
        if value == 1:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
        if self._period_us.number:
            raise SdoAbortError(AbortCode.DEVICE_STATE)


def _check_cob_id(value: int) -> None:
    generates, extended = value >> 30 & 1, value >> 29 & 1
    if generates or extended or not value & 0x7FF >= 0x080:
        raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
