"""The emergency producer: EMCY, error register (0x1001) and history (0x1003)."""

from collections import deque
from collections.abc import Sequence
from typing import Final

from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import NO_ERROR, Emergency, ErrorRegister
from sim_backends.devices.can.port import Port
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.timers import Timers

SHORT_EMERGENCY_BYTES: Final = 3
"""Of products whose EMCY messages end after the error register."""

_NOT_VALID: Final = 1 << 31
_PENDING: Final = 8
_HISTORY: Final = 8


class EmergencyProducer:
    """Tells of errors as they come and go."""

    def __init__(self, objects: ObjectDictionary, timers: Timers, port: Port, node_id: int) -> None:
        self._timers = timers
        self._timer = timers.timer(self._send_next)
        self._port = port
        default_id = cob_ids.emergency(node_id)
        self._cob_id = objects.own(0x1014, 0, DataType.UNSIGNED32, default_id)
        self._cob_id.check = self._check_cob_id
        self._register = objects.own(0x1001, 0, DataType.UNSIGNED8)
        self._inhibit = objects.own(0x1015, 0, DataType.UNSIGNED16)
        self._count = objects.own(0x1003, 0, DataType.UNSIGNED8)
        self._count.on_write = lambda _: self._keep(())
        self._history = [
            objects.own(0x1003, subindex, DataType.UNSIGNED32)
            for subindex in range(1, _HISTORY + 1)
        ]
        self._errors: dict[tuple[int, int], int] = {}
        self._pending: deque[Emergency] = deque(maxlen=_PENDING)
        self._not_before_ns = 0
        self.allowed = False
        """Whether the NMT state lets the drive send; what comes before waits."""
        self.bytes_sent = 8
        """Fewer than 8 for a sloppy device."""

    def stop(self) -> None:
        """As without power."""
        self._errors.clear()
        self._pending.clear()
        self._register.value = 0
        self._keep(())

    def allow(self, allowed: bool, t_ns: int) -> None:
        """The NMT state lets the drive send from now on, or no longer."""
        self.allowed = allowed
        if allowed and self._pending:
            self._send_next(t_ns)

    def raise_error(self, code: int, t_ns: int, source: int = 0) -> None:
        """An error has come up. `source`: the axis, from 0. Nothing happens where it holds."""
        if (code, source) in self._errors:
            return
        self._errors[code, source] = _register_bits(code)
        self._keep((code | source << 16, *self._kept()))
        self._tell(Emergency(code, self._update_register(), bytes((source,))), t_ns)

    def note_error(self, code: int, t_ns: int) -> None:
        """An error that is over already: it is told and remembered, but does not hold."""
        self._keep((code, *self._kept()))
        self._tell(Emergency(code, self._update_register() | _register_bits(code)), t_ns)

    def clear_error(self, code: int, t_ns: int, source: int = 0) -> None:
        """An error is gone: told by code 0, with the register of those that remain."""
        if self._errors.pop((code, source), None) is not None:
            self._tell(Emergency(NO_ERROR, self._update_register()), t_ns)

    def send(self, emergency: Emergency, t_ns: int, length: int) -> None:
        """Hand the first `length` bytes of an EMCY to the CAN controller."""
        if not self._cob_id.number & _NOT_VALID:
            self._port.send(self._cob_id.number, emergency.encode()[:length], t_ns)

    def _check_cob_id(self, value: int) -> None:
        """What 0x1014 takes: valid or not, an identifier of 11 bits below those of the PDOs, and
        while it is valid no other one."""
        before, wanted = self._cob_id.number, value & ~_NOT_VALID
        moves = not before & _NOT_VALID and wanted != before
        if moves or wanted not in range(0x081, 0x100):
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

    def _update_register(self) -> int:
        register = 0
        for bits in self._errors.values():
            register |= bits
        self._register.value = register
        return register

    def _kept(self) -> list[int]:
        return [entry.number for entry in self._history[: self._count.number]]

    def _keep(self, newest_first: Sequence[int]) -> None:
        kept = list(newest_first)[:_HISTORY]
        self._count.value = len(kept)
        for entry, value in zip(self._history, kept + [0] * (_HISTORY - len(kept)), strict=True):
            entry.value = value

    def _tell(self, emergency: Emergency, t_ns: int) -> None:
        self._pending.append(emergency)
        if self.allowed and not self._timer.running:
            self._send_next(t_ns)

    def _send_next(self, t_ns: int) -> None:
        if not self.allowed or not self._pending:
            return
        if t_ns < self._not_before_ns:
            self._timer.set(self._not_before_ns)
            return
        self.send(self._pending.popleft(), t_ns, self.bytes_sent)
        self._not_before_ns = t_ns + self._timers.host_ns(self._inhibit.number * 1e-4)
        if self._pending:
            self._timer.set(self._not_before_ns)


def _register_bits(code: int) -> int:
    """Which bits of the error register an error sets (CiA 301, table 26 and 7.5.2.2)."""
    return ErrorRegister.GENERIC | _BIT_OF_KIND.get(code >> 12, _BIT_OF_PROTOCOL.get(code >> 8, 0))


_BIT_OF_KIND: Final = {
    0x2: ErrorRegister.CURRENT,
    0x3: ErrorRegister.VOLTAGE,
    0x4: ErrorRegister.TEMPERATURE,
    0xF: ErrorRegister.MANUFACTURER,
}

_BIT_OF_PROTOCOL: Final = {
    0x81: ErrorRegister.COMMUNICATION,
    0x82: ErrorRegister.COMMUNICATION,
    0x83: ErrorRegister.DEVICE_PROFILE,
    0x84: ErrorRegister.DEVICE_PROFILE,
    0x85: ErrorRegister.DEVICE_PROFILE,
    0x86: ErrorRegister.DEVICE_PROFILE,
    0x87: ErrorRegister.COMMUNICATION,
}
