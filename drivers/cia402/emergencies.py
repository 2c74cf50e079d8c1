"""The errors that a node tells of (EMCY), and what else they explain."""

from collections.abc import Sequence
from typing import Final

from drivers.canopen.codec.emcy import Emergency, decode_emergency
from drivers.canopen.codec.error import CodecError
from drivers.cia402 import conditions as c
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.power_state import PowerState
from drivers.conditions import Conditions

_NOT_TOLD_NS: Final = 100_000_000  # judgement: in ten cycles an error is on the bus
_TOLD_EVERY_NS: Final = 50_000_000  # a bus carries thousands a second, and to tell one is work
_EXPLAINS_NS: Final = 1_000_000_000  # judgement: drives tell error and fault within some cycles
_FOLLOWING_ERROR: Final = 0x8611
_CLASS: Final = 0xFF00
_SENSOR: Final = 0x7300
"""Speed and position sensors: positions may count from anywhere afterwards."""


class Emergencies:
    """Of one node, which does not say of which of its axes it tells."""

    def __init__(
        self, subject: str, channels: Sequence[AxisChannel], conditions: Conditions
    ) -> None:
        self.last: Emergency | None = None
        self._subject = subject
        self._channels = channels
        self._conditions = conditions
        self._last_ns = self._told_ns = -_EXPLAINS_NS
        self._untold = False
        self._faults_ns: dict[str, int] = {}
        """Axes whose fault nothing has explained yet, and when it was told."""

    def received(self, data: bytes, t_ns: int) -> None:
        """A frame of the node's."""
        try:
            emergency = decode_emergency(data)
        except CodecError as error:
            self._conditions.note(c.EMERGENCY, self._subject, t_ns, str(error))
            return
        self.last = emergency
        if emergency.error_gone:
            self._untold = False
            self._conditions.clear(c.EMERGENCY, self._subject, t_ns)
            return
        self._last_ns = t_ns
        self._tell(emergency, t_ns)
        self._follow(emergency, self._subject, self._channels, t_ns)
        self._explain_faults(emergency, t_ns)

    def watch(self, t_ns: int) -> None:
        """Tell what came too soon after another. Called again and again."""
        if self._untold and self.last is not None:
            self._tell(self.last, t_ns)

    def status_changed(self, channel: AxisChannel, t_ns: int) -> None:
        """Keep the axis' fault told, with the error that came before it, if any has."""
        name = channel.axis.name
        if channel.state not in (PowerState.FAULT, PowerState.FAULT_REACTION):
            self._faults_ns.pop(name, None)
            self._conditions.clear(c.FAULT, name, t_ns)
        elif not self._conditions.holds(c.FAULT, name):
            detail = self.explanation(t_ns)
            if not detail:
                self._faults_ns[name] = t_ns
            self._conditions.set(c.FAULT, name, t_ns, detail)

    def unexplained(self, t_ns: int) -> list[AxisChannel]:
        """Axes whose fault no error has explained in time."""
        told_ns = self._faults_ns
        return [
            channel
            for channel in self._channels
            if t_ns - told_ns.get(channel.axis.name, t_ns) >= _NOT_TOLD_NS
        ]

    def explained(self, channel: AxisChannel, code: int, t_ns: int) -> None:
        """The drive was asked why the axis has a fault. code: 0 if it does not say."""
        name = channel.axis.name
        told_ns = self._faults_ns.pop(name, None)
        emergency = Emergency(code)
        if told_ns is None or emergency.error_gone:
            return  # it is explained or over already, or will not be
        self._follow(emergency, name, [channel], t_ns)
        self._conditions.clear(c.FAULT, name, t_ns)
        self._conditions.set(c.FAULT, name, t_ns, str(emergency))

    def explanation(self, t_ns: int) -> str:
        """The error that has just come; empty: none, and one of long ago explains nothing."""
        last = self.last
        recent = last is not None and t_ns - self._last_ns <= _EXPLAINS_NS
        return str(last) if recent and last is not None and not last.error_gone else ""

    def _follow(
        self, emergency: Emergency, subject: str, channels: Sequence[AxisChannel], t_ns: int
    ) -> None:
        """What some errors mean beside themselves, for the axes that may have them."""
        if emergency.code & _CLASS == _SENSOR:
            for channel in channels:
                channel.zero_lost, channel.zero_found = True, False
        if emergency.code == _FOLLOWING_ERROR:
            self._conditions.note(c.FOLLOWING_ERROR, subject, t_ns, str(emergency))

    def _tell(self, emergency: Emergency, t_ns: int) -> None:
        self._untold = t_ns - self._told_ns < _TOLD_EVERY_NS
        if not self._untold:
            self._told_ns = t_ns
            self._conditions.clear(c.EMERGENCY, self._subject, t_ns)
            self._conditions.set(c.EMERGENCY, self._subject, t_ns, str(emergency))

    def _explain_faults(self, emergency: Emergency, t_ns: int) -> None:
        """Some drives send their state first, and then what is the matter."""
        for name, told_ns in self._faults_ns.items():
            if t_ns - told_ns <= _EXPLAINS_NS:
                self._conditions.clear(c.FAULT, name, t_ns)
                self._conditions.set(c.FAULT, name, t_ns, str(emergency))
        self._faults_ns.clear()
