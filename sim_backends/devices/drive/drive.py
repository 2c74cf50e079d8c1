"""An emulated CiA 402 drive on the modelled bus: its parts, put together, and its life."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from config.emulation.lab import EmulatedDrives
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import HEARTBEAT_LOST
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.device import DeviceClock
from sim_backends.devices.drive.axis.axis import AXIS_OFFSET, Axis, AxisOptions
from sim_backends.devices.drive.axis.mechanics import AxisMechanics
from sim_backends.devices.drive.faults import DRIVE_FAULTS, DriveFaults
from sim_backends.devices.drive.node.communication import Communication, NmtSlave
from sim_backends.devices.drive.node.eds import read_eds
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary
from sim_backends.devices.drive.node.storage import Storage
from sim_backends.devices.drive.node.timers import Timers
from sim_backends.devices.drive.quirks import Quirks
from sim_backends.faults import FaultKind, Value

_MAILBOXES: Final = 16
_BUS_OFF_RECOVERY_BITS: Final = 128 * 11
_MAX_AXES: Final = 8

_PROCESSING_NS: Final = (25_000, 60_000)
"""From SYNC until the first TPDO is ready: least and most, each drive has its own."""

_SDO_SPREAD: Final = (0.6, 1.4)
"""How much the time for an SDO answer varies."""

_COMMUNICATION_RESET_SHARE: Final = 0.3
"""Of the boot time: what a reset of the communication takes."""


class EmulatedDrive:
    """A node with one axis or several. It has no `advance` of its own: the bus keeps it alive.

    mechanics: one for each axis; a lone one is for all of them. seed: of everything random. It
    must be switched on. Raises EdsError, and ValueError where the axes and `mechanics` differ.
    """

    def __init__(
        self,
        bus: CanBus,
        node_id: int,
        eds: Path,
        options: EmulatedDrives | None = None,
        *,
        seed: int = 0,
        clock: DeviceClock | None = None,
        mechanics: Sequence[AxisMechanics] = (AxisMechanics(),),
    ) -> None:
        self.node_id = node_id
        self._options = options or EmulatedDrives()
        self._quirks = quirks = Quirks.of(self._options.quirks)
        self._random = np.random.default_rng((seed, node_id))
        self.powered = False
        self.cut_off = False
        """By a fault: its plug is out of the bus."""
        self.port = bus.attach(f"node {node_id}", _MAILBOXES, mailboxes=True)
        self.port.connect(False)
        self.port.restart_after_ns = _BUS_OFF_RECOVERY_BITS * bus.bit_ns
        timers = Timers(bus, clock or DeviceClock())
        self._timers = timers
        self._boot_timer = timers.timer(self._booted)
        self._loader_timer = timers.timer(self._boot_loader_done)
        self._resets_application = True
        self.objects = ObjectDictionary(read_eds(eds), node_id)
        sync_delay_ns = int(self._random.integers(*_PROCESSING_NS))
        self.communication = Communication(
            self.objects,
            timers,
            self.port,
            node_id,
            quirks.communication,
            self,
            self._sdo_delay_ns,
            sync_delay_ns,
            self._options.sync_lost_after_periods,
        )
        self.axes = self._build_axes(mechanics, eds)
        self._storage = Storage(self.objects, self._sdo_busy, self._any_axis_energised)
        self._faults = DriveFaults(self, bus)
        self._leave_factory()

    @property
    def nmt(self) -> NmtSlave:
        """The node's NMT state."""
        return self.communication.nmt

    # Faults

    @property
    def faults(self) -> Sequence[FaultKind]:
        """What it can be told to do wrong."""
        return DRIVE_FAULTS

    def inject(self, fault: str, arguments: Mapping[str, Value], t_ns: int) -> None:
        """Misbehave from `t_ns` on; the bus must be advanced afterwards. Raises FaultError."""
        self._faults.inject(fault, arguments, t_ns)

    # Life

    def power_on(self, t_ns: int) -> None:
        """Supply voltage comes."""
        if not self.powered:
            self.powered = True
            self.connect()
            self._boot(1.0, t_ns)

    def power_off(self, t_ns: int) -> None:
        """Supply voltage goes; motors stand still."""
        self.powered = False
        self._stop(t_ns)

    def connect(self) -> None:
        """Be on the bus or not, as supply and plug have it, with nothing left to send."""
        self.port.connect(self.powered and not self.cut_off)

    def restart(self, t_ns: int, *, boots_twice: bool = False) -> None:
        """The drive starts anew, as by its own watchdog."""
        self._stop(t_ns)
        self._boot(1.0, t_ns, boots_twice=boots_twice)

    def _boot(self, share: float, t_ns: int, *, boots_twice: bool = False) -> None:
        """Nothing is heard or said until the drive has booted, `share` of the whole boot time."""
        boot_ns = round(self._timers.host_ns(self._options.boot_time_s) * share)
        self._boot_timer.set(t_ns + boot_ns)
        if self._resets_application and (boots_twice or self._quirks.boots_twice):
            self._loader_timer.set(t_ns + boot_ns // 2)

    def _boot_loader_done(self, t_ns: int) -> None:
        self.communication.send_boot_up(t_ns)

    def _booted(self, t_ns: int) -> None:
        self._storage.load(communication=True)
        if self._resets_application:
            self._storage.load(communication=False)
            for axis in self.axes:
                axis.boot(t_ns)
        self._resets_application = True
        self.communication.boot_up(t_ns)

    def _stop(self, t_ns: int) -> None:
        for axis in self.axes:
            axis.off(t_ns)
        self.communication.fall_silent(t_ns)
        self.communication.emergency.stop()
        self._timers.cancel_all()
        self._resets_application = True
        self.connect()

    # What the communication tells

    def reset_requested(self, application: bool, t_ns: int) -> None:
        if application:
            self.restart(t_ns)
            return
        self.communication.fall_silent(t_ns)
        self.connect()
        self._resets_application = False
        self._boot(_COMMUNICATION_RESET_SHARE, t_ns)

    def connection_ended(self, code: int, t_ns: int) -> None:
        for axis in self.axes:
            axis.connection_lost(code, t_ns)

    def sync_lost(self, t_ns: int) -> None:
        for axis in self.axes:
            axis.sync_lost(t_ns)

    def sync_late(self, late: bool, t_ns: int) -> None:
        for axis in self.axes:
            axis.sync_late(late, t_ns)

    # What the axes tell

    def axis_fault(self, axis: int, code: int, t_ns: int) -> None:
        self.communication.emergency.raise_error(code, t_ns, axis)

    def axis_faults_reset(self, axis: int, codes: tuple[int, ...], t_ns: int) -> None:
        for code in codes:
            self.communication.emergency.clear_error(code, t_ns, axis)

    def cause_remains(self, code: int) -> bool:
        if code == HEARTBEAT_LOST:
            return self.communication.error_control.lost
        return self._faults.lasts(code)

    def status_changed(self, t_ns: int) -> None:
        self.communication.pdos.changed(t_ns)

    # Construction

    def _build_axes(self, mechanics: Sequence[AxisMechanics], eds: Path) -> tuple[Axis, ...]:
        count = 0
        while count < _MAX_AXES and (0x6040 + AXIS_OFFSET * count, 0) in self.objects:
            count += 1
        each = list(mechanics) * count if len(mechanics) == 1 else list(mechanics)
        if len(each) != count:
            raise ValueError(f"{eds}: {count} axes, but {len(each)} descriptions of mechanics")
        options = AxisOptions(
            lag_s=self._options.response_time_s,
            motor_torque_nmm=self._options.motor_torque_nmm,
            brake_release_s=self._options.brake_release_s,
            no_encoder=self._quirks.no_encoder,
            tells_reference=self._quirks.tells_reference,
        )
        axes = tuple(
            Axis(self.objects, number, built, options, self._timers, self)
            for number, built in enumerate(each)
        )
        for axis in axes:
            self._quirks.restrict_interpolation(axis.period, axis.in_synchronous_mode)
        return axes

    def _leave_factory(self) -> None:
        serial_number = int(self._random.integers(1, 1 << 31))
        self.objects.own(0x1018, 4, DataType.UNSIGNED32).deliver(serial_number)
        offsets = [AXIS_OFFSET * number for number in range(len(self.axes))]
        self._quirks.leave_factory(self.objects, offsets)
        self._quirks.restrict_communication_error(self.objects)

    def _sdo_delay_ns(self) -> int:
        return self._timers.host_ns(self._options.sdo_delay_s * self._random.uniform(*_SDO_SPREAD))

    def _sdo_busy(self, seconds: float) -> None:
        self.communication.sdo.extra_delay_ns += self._timers.host_ns(seconds)

    def _any_axis_energised(self) -> bool:
        return any(axis.shaft.energised for axis in self.axes)
