"""The faults that an emulated drive can be told to have."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, Protocol

from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import NO_ERROR, Emergency
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.drive.axis.axis import AXIS_OFFSET, Axis
from sim_backends.devices.drive.node.communication import Communication
from sim_backends.devices.drive.node.emergency import SHORT_EMERGENCY_BYTES
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.faults import FOREVER_S, FaultError, FaultKind, Parameter, Value


def _lasting(name: str, text: str) -> FaultKind:
    return FaultKind(name, text, (Parameter("duration", "duration_s", FOREVER_S),))


DRIVE_FAULTS: Final = (
    FaultKind("power_cycle", "loses its supply", (Parameter("off_time", "duration_s", 1.0),)),
    FaultKind("reset", "starts anew while running, and says so by a boot-up message"),
    FaultKind("boots_twice", "starts anew, with a boot-up message of its boot loader first"),
    FaultKind(
        "wrong_identity", "is another product: starts anew with another product code (0x1018:2)"
    ),
    _lasting("dead", "is cut off from the bus: hears nothing, says nothing"),
    _lasting("heartbeat_stop", "sends no heartbeat"),
    _lasting("tpdo_stop", "sends no TPDO"),
    _lasting("sync_loss", "hears no SYNC"),
    FaultKind("emergency", "has a fault", (Parameter("code", "code"),)),
    FaultKind("short_emergency", "sends an EMCY of 3 bytes", (Parameter("code", "code", 0x1000),)),
    FaultKind(
        "setting",
        "one of its objects is changed over its own service port, not over the bus",
        (
            Parameter("index", "code"),
            Parameter("subindex", "code", 0),
            Parameter("value", "number", 0.0),
        ),
    ),
    _lasting("warning", "shows the warning bit"),
    _lasting("blocked", "its shaft is jammed"),
    _lasting("over_temperature", "is too hot: fault 0x4310"),
    _lasting("under_voltage", "its motor supply has broken down: fault 0x3220, coasts"),
    _lasting("sto", "its safe-torque-off input is open: no torque, no fault"),
    _lasting("encoder", "its encoder has failed: fault 0x7305, coasts, its zero is lost"),
    _lasting("sdo_silent", "does not answer SDOs"),
    FaultKind(
        "sdo_late",
        "answers SDOs late",
        (Parameter("delay", "duration_s", 0.5), Parameter("duration", "duration_s", FOREVER_S)),
    ),
    FaultKind(
        "sdo_abort",
        "aborts SDO requests",
        (Parameter("code", "code"), Parameter("count", "count", 1)),
    ),
    FaultKind(
        "sdo_toggle", "sends segments with a wrong toggle bit", (Parameter("count", "count", 1),)
    ),
    _lasting("stuck_statusword", "its statusword stays as it is"),
    _lasting("refuses_enable", "stays in switched on when told to enable operation"),
)

OVER_TEMPERATURE: Final = 0x4310
UNDER_VOLTAGE: Final = 0x3220
ENCODER: Final = 0x7305

_HOT: Final = 950  # 0.1 degrees
_TEMPERATURE: Final = (0x2000, 0)
_DC_LINK: Final = 0x6079
_BROKEN_DOWN_MV: Final = 9_000


class FaultyDrive(Protocol):
    """What the faults need of the drive that has them."""

    node_id: int
    powered: bool
    cut_off: bool
    objects: ObjectDictionary
    communication: Communication

    @property
    def axes(self) -> Sequence[Axis]:
        """All of them."""
        ...

    def power_on(self, t_ns: int) -> None:
        """Supply voltage comes."""
        ...

    def power_off(self, t_ns: int) -> None:
        """Supply voltage goes; motors stand still."""
        ...

    def connect(self) -> None:
        """Be on the bus or not, as supply and plug have it."""
        ...

    def restart(self, t_ns: int, *, boots_twice: bool = False) -> None:
        """The drive starts anew, as by its own watchdog."""
        ...


class DriveFaults:
    """Carries the faults of one drive out. One that lasts is prolonged by injecting it again."""

    def __init__(self, drive: FaultyDrive, bus: CanBus) -> None:
        self._drive = drive
        self._bus = bus
        queue = bus.queue
        self._causes: set[int] = set()
        self._power_timer = queue.timer(drive.power_on)
        self._late_timer = queue.timer(self._in_time_again)
        self._switches: dict[str, Callable[[bool, int], None]] = {
            "dead": self._dead,
            "heartbeat_stop": self._heartbeat_stop,
            "tpdo_stop": self._tpdo_stop,
            "sync_loss": self._sync_loss,
            "warning": self._warning,
            "blocked": self._blocked,
            "over_temperature": self._over_temperature,
            "under_voltage": self._under_voltage,
            "sto": self._sto,
            "encoder": self._encoder,
            "sdo_silent": self._sdo_silent,
            "stuck_statusword": self._stuck_statusword,
            "refuses_enable": self._refuses_enable,
        }
        self._ends = {name: queue.timer(partial(self._end, name)) for name in self._switches}
        self._events: dict[str, Callable[[Mapping[str, Value], int], None]] = {
            "power_cycle": self._power_cycle,
            "reset": self._reset,
            "boots_twice": self._boots_twice,
            "wrong_identity": self._wrong_identity,
            "emergency": self._emergency,
            "short_emergency": self._short_emergency,
            "setting": self._setting,
            "sdo_late": self._sdo_late,
            "sdo_abort": self._sdo_abort,
            "sdo_toggle": self._sdo_toggle,
        }

    def lasts(self, code: int) -> bool:
        """Whether the cause of this fault code is still there."""
        return code in self._causes

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        """Raises FaultError."""
        self._bus.advance(t_ns)
        if not self._drive.powered:
            raise FaultError(f"node {self._drive.node_id} is off: it can do nothing wrong now")
        if fault in self._events:
            self._events[fault](arguments, t_ns)
            return
        end = self._ends[fault]
        if not end.running:
            self._switches[fault](True, t_ns)
        end.set(t_ns + nanoseconds(arguments["duration"]))

    def _end(self, fault: str, t_ns: int) -> None:
        self._switches[fault](False, t_ns)

    # What happens once

    def _power_cycle(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        self._drive.power_off(t_ns)
        self._power_timer.set(t_ns + nanoseconds(arguments["off_time"]))

    def _reset(self, _arguments: Mapping[str, Value], t_ns: int) -> None:
        self._drive.restart(t_ns)

    def _boots_twice(self, _arguments: Mapping[str, Value], t_ns: int) -> None:
        self._drive.restart(t_ns, boots_twice=True)

    def _wrong_identity(self, _arguments: Mapping[str, Value], t_ns: int) -> None:
        product_code = self._drive.objects.own(0x1018, 2, DataType.UNSIGNED32)
        product_code.deliver(product_code.number + 1 & 0xFFFFFFFF)
        self._drive.restart(t_ns)

    def _emergency(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        code = int(arguments["code"])
        if not NO_ERROR < code <= 0xFFFF:
            raise FaultError(f"an emergency code is 0x0001 to 0xFFFF, not 0x{code:04X}")
        for axis in self._drive.axes:
            axis.fault(code, t_ns)

    def _short_emergency(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        code = int(arguments["code"]) & 0xFFFF
        emergency = self._drive.communication.emergency
        emergency.send(Emergency(code), t_ns, SHORT_EMERGENCY_BYTES)

    def _setting(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        index, subindex = int(arguments["index"]), int(arguments["subindex"])
        try:
            self._drive.objects.look_up(index, subindex).write(int(arguments["value"]), t_ns)
        except SdoAbortError as error:
            raise FaultError(f"0x{index:04X}:{subindex:02X}: {error}") from None

    def _sdo_late(self, arguments: Mapping[str, Value], t_ns: int) -> None:
        self._drive.communication.sdo.trouble.late_ns = nanoseconds(arguments["delay"])
        self._late_timer.set(t_ns + nanoseconds(arguments["duration"]))

    def _in_time_again(self, _t_ns: int) -> None:
        self._drive.communication.sdo.trouble.late_ns = 0

    def _sdo_abort(self, arguments: Mapping[str, Value], _t_ns: int) -> None:
        self._drive.communication.sdo.trouble.abort_code = int(arguments["code"]) & 0xFFFFFFFF
        self._drive.communication.sdo.trouble.aborts = int(arguments["count"])

    def _sdo_toggle(self, arguments: Mapping[str, Value], _t_ns: int) -> None:
        self._drive.communication.sdo.trouble.toggle_errors = int(arguments["count"])

    # What lasts

    def _dead(self, on: bool, _t_ns: int) -> None:
        self._drive.cut_off = on
        self._drive.connect()

    def _heartbeat_stop(self, on: bool, _t_ns: int) -> None:
        self._drive.communication.error_control.producer.silent = on

    def _tpdo_stop(self, on: bool, _t_ns: int) -> None:
        self._drive.communication.pdos.silence(on)

    def _sync_loss(self, on: bool, _t_ns: int) -> None:
        self._drive.communication.sync.deaf = on

    def _sdo_silent(self, on: bool, _t_ns: int) -> None:
        self._drive.communication.sdo.trouble.silent = on

    def _warning(self, on: bool, t_ns: int) -> None:
        for axis in self._drive.axes:
            axis.warning = on
            axis.refresh(t_ns)

    def _blocked(self, on: bool, t_ns: int) -> None:
        for axis in self._drive.axes:
            axis.block(on, t_ns)

    def _over_temperature(self, on: bool, t_ns: int) -> None:
        temperature = self._drive.objects.own(*_TEMPERATURE, DataType.INTEGER16)
        temperature.value = _HOT if on else temperature.default
        self._fault_while(OVER_TEMPERATURE, on, t_ns, coast=False)

    def _under_voltage(self, on: bool, t_ns: int) -> None:
        for number, axis in enumerate(self._drive.axes):
            dc_link = (AXIS_OFFSET * number + _DC_LINK, 0)
            voltage = self._drive.objects.own(*dc_link, DataType.UNSIGNED32)
            voltage.value = _BROKEN_DOWN_MV if on else voltage.default
            axis.power.trouble.no_voltage = on
            axis.power.settled = False
            axis.refresh(t_ns)
        self._fault_while(UNDER_VOLTAGE, on, t_ns, coast=True)

    def _sto(self, on: bool, t_ns: int) -> None:
        for axis in self._drive.axes:
            axis.advance(t_ns)
            axis.power.trouble.torque_off = on
            if on:
                axis.power.torque_lost(t_ns)
            axis.power.settled = False
            axis.refresh(t_ns)

    def _encoder(self, on: bool, t_ns: int) -> None:
        self._fault_while(ENCODER, on, t_ns, coast=True)
        for axis in self._drive.axes:
            axis.lose_zero()

    def _stuck_statusword(self, on: bool, t_ns: int) -> None:
        for axis in self._drive.axes:
            axis.frozen_statusword = None
            axis.frozen_statusword = axis.statusword(t_ns) if on else None

    def _refuses_enable(self, on: bool, _t_ns: int) -> None:
        for axis in self._drive.axes:
            axis.power.trouble.refuses_enable = on
            axis.power.settled = False

    def _fault_while(self, code: int, on: bool, t_ns: int, *, coast: bool) -> None:
        """A fault that cannot be reset while its cause is there."""
        if not on:
            self._causes.discard(code)
            return
        self._causes.add(code)
        for axis in self._drive.axes:
            axis.fault(code, t_ns, coast=coast)


def nanoseconds(seconds: Value) -> int:
    """A duration as a fault's argument gives it; `forever` stays within the queue's reach."""
    return round(float(seconds) * 1e9)
