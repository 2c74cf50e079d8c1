"""One axis of a drive: the power state machine, its modes of operation, and the motor behind them.

Its objects stand at +0x800 for each axis of a module.
"""

from dataclasses import dataclass
from typing import Final, Protocol

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from drivers.canopen.codec.emcy import FOLLOWING_ERROR, SYNC_CONTROLLER
from sim_backends.devices.drive.axis.cyclic import (
    CyclicPosition,
    CyclicVelocity,
    InterpolationPeriod,
)
from sim_backends.devices.drive.axis.homing import METHODS, HomingMode
from sim_backends.devices.drive.axis.limits import Limits
from sim_backends.devices.drive.axis.mechanics import AxisMechanics, Units
from sim_backends.devices.drive.axis.mode import FOLLOWING_ERROR as FOLLOWING_ERROR_BIT
from sim_backends.devices.drive.axis.mode import TARGET_REACHED, AxisParts, Mode
from sim_backends.devices.drive.axis.power import State
from sim_backends.devices.drive.axis.power_control import PowerControl
from sim_backends.devices.drive.axis.profile import ProfilePosition, ProfileVelocity
from sim_backends.devices.drive.axis.readings import FollowingErrorWatch, Readings
from sim_backends.devices.drive.axis.shaft import Shaft
from sim_backends.devices.drive.node.object_dictionary import ObjectDictionary, SdoAbortError
from sim_backends.devices.drive.node.timers import Timers

AXIS_OFFSET: Final = 0x800

_VOLTAGE_ENABLED: Final = 1 << 4
_WARNING: Final = 1 << 7
_REMOTE: Final = 1 << 9
_INTERNAL_LIMIT: Final = 1 << 11
_SYNC_LATE: Final = 1 << 15
_REFERENCED: Final = 1 << 15
"""Of another make than the one above."""

_NO_MODE: Final = 0
_SYNCHRONOUS_MODES: Final = (CyclicPosition.code, CyclicVelocity.code)
_POSITION_MODES: Final = (ProfilePosition.code, CyclicPosition.code)
_TICK_S: Final = 0.002
_SILENCE_S: Final = 0.05


class AxisEvents(Protocol):
    """What the drive is told. Errors are numbered as in EMCY, axes from 0."""

    def axis_fault(self, axis: int, code: int, t_ns: int) -> None:
        """The axis has a fault."""
        ...

    def axis_faults_reset(self, axis: int, codes: tuple[int, ...], t_ns: int) -> None:
        """The master has reset these faults."""
        ...

    def cause_remains(self, code: int) -> bool:
        """Whether what made this fault is still there."""
        ...

    def status_changed(self, t_ns: int) -> None:
        """The statusword may be another one."""
        ...


@dataclass(frozen=True)
class AxisOptions:
    """How this make of drive is built."""

    lag_s: float = 0.004
    motor_torque_nmm: float = 400.0
    brake_release_s: float = 0.05
    no_encoder: bool = False
    tells_reference: bool = False


class Axis:
    """One axis."""

    def __init__(
        self,
        objects: ObjectDictionary,
        number: int,
        mechanics: AxisMechanics,
        options: AxisOptions,
        timers: Timers,
        events: AxisEvents,
    ) -> None:
        base = AXIS_OFFSET * number
        self._number = number
        self.shaft = Shaft(
            mechanics.start_counts,
            mechanics.low_stop_counts,
            mechanics.high_stop_counts,
            options.lag_s,
        )
        self.units = Units(objects, base, mechanics.counts_per_turn, self._configure)
        self.limits = Limits(objects, base, self.units, mechanics)
        parts = AxisParts(
            objects,
            base,
            self.shaft,
            self.units,
            self.limits,
            mechanics,
            timers,
            self._zero_found,
        )
        self._parts = parts
        self._motor_torque_nmm = options.motor_torque_nmm
        self._events = events
        self.t_ns = 0
        """How far it was advanced."""
        self.power = PowerControl(parts, self, options.brake_release_s)
        self.period = InterpolationPeriod(parts)
        self._cyclic_position = CyclicPosition(parts, self.period)
        modes: tuple[Mode, ...] = (
            ProfilePosition(parts),
            ProfileVelocity(parts),
            HomingMode(parts),
            self._cyclic_position,
            CyclicVelocity(parts, self.period),
        )
        self._modes = {mode.code: mode for mode in modes}
        self.mode = modes[0]
        self._tick_timer = timers.timer(self._tick)
        self._tick_ns = timers.host_ns(_TICK_S)
        self._silence_timer = timers.timer(self._nothing_commanded)
        self._silence_ns = timers.host_ns(_SILENCE_S)
        self.homed = False
        self._kept_zero = 0.0
        """Of an absolute encoder."""
        self._tells_reference = options.tells_reference
        self.warning = False
        self.frozen_statusword: int | None = None
        """What it shows instead of the truth, by a fault."""
        self._following_error = FollowingErrorWatch(parts, no_encoder=options.no_encoder)
        self._followed_badly = False
        self._status = 0
        self._bind_commands()
        self._bind_settings()
        trouble = self.power.trouble
        self._readings = Readings(
            parts, self, lambda: trouble.torque_off, no_encoder=options.no_encoder
        )

    # For the lab. The bus must have been advanced to the present.

    @property
    def position_counts(self) -> float:
        """Where the shaft really is."""
        self.advance(self._parts.timers.now_ns())
        return self.shaft.position

    def set_load(self, torque_nmm: float) -> None:
        """What the axis has to hold from now on; positive pushes towards lower positions."""
        self.advance(self._parts.timers.now_ns())
        self.shaft.set_load(torque_nmm)

    def drag_to(self, counts: float) -> bool:
        """Turn the shaft by hand. False: the motor holds it."""
        self.advance(self._parts.timers.now_ns())
        if self.shaft.energised:
            return False
        self.shaft.drag_to(counts)
        return True

    # Life

    def boot(self, t_ns: int) -> None:
        """Power is there and the objects are reset; an incremental encoder begins with 0."""
        self.advance(t_ns)
        self.homed = self._parts.mechanics.absolute_encoder
        self.units.zero = self._kept_zero if self.homed else self.shaft.position
        self._configure(t_ns)
        self.period.configure()
        self.mode = self._modes.get(self._mode_wanted.number, self.mode)
        self._mode_shown.value = self.mode.code
        self.power.boot(t_ns)

    def off(self, t_ns: int) -> None:
        """No power, or a reset."""
        self.advance(t_ns)
        self._following_error.forget()
        self._followed_badly = False
        self.power.off()

    def advance(self, t_ns: int) -> None:
        """Let time pass until `t_ns`."""
        if t_ns <= self.t_ns:
            return
        self.t_ns = t_ns
        shaft, watch = self.shaft, self._following_error
        shaft.advance(t_ns)
        follows = -watch.window <= shaft.demand - shaft.position <= watch.window
        if follows and watch.since_ns is None:
            return
        if watch.too_long(t_ns):
            self._followed_too_badly(t_ns)
        elif watch.since_ns == t_ns:
            self._look_after(t_ns)

    def statusword(self, t_ns: int) -> int:
        """0x6041 now."""
        if self.frozen_statusword is not None:
            return self.frozen_statusword
        if t_ns > self.t_ns:
            self.advance(t_ns)
        mode = self.mode
        if self.power.following:
            bits = mode.status()
            return self._status | (bits | _INTERNAL_LIMIT if mode.limited else bits)
        if self.power.state is State.OPERATION_ENABLED:
            return self._status | self._status_while_stopping()
        return self._status

    def refresh(self, t_ns: int) -> None:
        """Something that the statusword shows may have changed, other than by motion."""
        trouble = self.power.trouble
        self._status = (
            self.power.state.value
            | _REMOTE
            | (0 if trouble.no_voltage or trouble.torque_off else _VOLTAGE_ENABLED)
            | (FOLLOWING_ERROR_BIT if self._followed_badly else 0)
            | (_WARNING if self.warning else 0)
            | (_SYNC_LATE if self._cyclic_position.holding else 0)
            | (_REFERENCED if self._tells_reference and self.homed else 0)
        )
        self._events.status_changed(t_ns)

    def fault(self, code: int, t_ns: int, *, coast: bool = False) -> None:
        """Something is wrong. coast: so much that the motor cannot even brake."""
        self.advance(t_ns)
        self._events.axis_fault(self._number, code, t_ns)
        self.power.fault(code, t_ns, coast=coast)

    def connection_lost(self, code: int, t_ns: int) -> None:
        """Communication is lost: 0x6007 says what to do."""
        self.advance(t_ns)
        if self.power.faults_without_connection:
            self.fault(code, t_ns)
        else:
            self.power.connection_lost(t_ns)

    def block(self, blocked: bool, t_ns: int) -> None:
        """The shaft jams, or no longer."""
        self.advance(t_ns)
        self.shaft.block(blocked)

    def lose_zero(self) -> None:
        """The encoder counts from here now."""
        self.units.zero = self.shaft.position
        self.homed = False
        self.limits.configure()
        self.refresh(self.t_ns)

    def in_synchronous_mode(self) -> bool:
        """Whether it follows a mode that interpolates between targets."""
        return self.power.following and self.mode.code in _SYNCHRONOUS_MODES

    def sync_lost(self, t_ns: int) -> None:
        """SYNC is missing: no mode that needs it can go on."""
        if self.power.state is State.OPERATION_ENABLED and self.mode.code in _SYNCHRONOUS_MODES:
            self.fault(SYNC_CONTROLLER, t_ns)

    def sync_late(self, late: bool, t_ns: int) -> None:
        """A SYNC came too late, or in time again."""
        holding = late and self.power.following and self.mode is self._cyclic_position
        if holding != self._cyclic_position.holding:
            self._cyclic_position.holding = holding
            self.refresh(t_ns)

    # What the power state machine tells

    def state_changed(self, t_ns: int) -> None:
        self._cyclic_position.holding = False
        self._look_after(t_ns)
        self.refresh(t_ns)

    def follows(self, resumed: bool, t_ns: int) -> None:
        if resumed:
            self.mode.resume()
        else:
            self.mode.start()
            self.mode.controlled(self.power.control, self.power.enabled_with)
        self._look_after(t_ns)

    def cause_remains(self, code: int) -> bool:
        return self._events.cause_remains(code)

    def fault_reset(self, codes: tuple[int, ...], t_ns: int) -> None:
        self._followed_badly = False
        self._events.axis_faults_reset(self._number, codes, t_ns)

    # Commands

    def _bind_commands(self) -> None:
        own = self._parts.own
        base = self._parts.base
        self._parts.objects.show(base + 0x6041, 0, DataType.UNSIGNED16, self.statusword)
        self._control = own(0x6040, 0, DataType.UNSIGNED16)
        for index, data_type in ((0x607A, DataType.INTEGER32), (0x60FF, DataType.INTEGER32)):
            own(index, 0, data_type).on_write = self._commanded
        self._control.on_write = self._commanded
        self._mode_wanted = own(0x6060, 0, DataType.INTEGER8, 1)
        self._mode_shown = own(0x6061, 0, DataType.INTEGER8, 1)
        self._mode_wanted.check = self._check_mode
        self._mode_wanted.on_write = self._mode_selected
        own(0x6098, 0, DataType.INTEGER8, 37).check = _check_homing_method

    def _commanded(self, t_ns: int) -> None:
        """Controlword or targets have been written, by PDO or SDO."""
        if t_ns > self.t_ns:
            self.advance(t_ns)
        power = self.power
        control, previous = self._control.number, power.control
        if control != previous or not power.settled:
            power.obey(control, t_ns)
            if power.following and control != previous:
                self.mode.controlled(control, previous)
            self._events.status_changed(t_ns)
        if power.following:
            self.mode.commanded()
            if self.mode.busy:
                self._look_after(t_ns)
            else:
                self._silence_timer.set(t_ns + self._silence_ns)

    def _check_mode(self, value: int) -> None:
        if value != _NO_MODE and value not in self._modes:
            raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

    def _mode_selected(self, t_ns: int) -> None:
        mode = self._modes.get(self._mode_wanted.number, self.mode)
        if mode is self.mode:
            return
        self.advance(t_ns)
        self._cyclic_position.holding = False
        self.mode = mode
        self._mode_shown.value = mode.code
        if self.power.following:
            self.power.slow_down(t_ns)
            mode.start()
            self._look_after(t_ns)
        self.refresh(t_ns)

    # Settings

    def _bind_settings(self) -> None:
        own = self._parts.own
        self._max_torque = own(0x6072, 0, DataType.UNSIGNED16, 1000)
        self._rated = own(0x6076, 0, DataType.UNSIGNED32, 400)
        self._rated.deliver(round(self._parts.mechanics.rated_torque_nmm))
        for entry in (self._following_error.entry, self._max_torque, self._rated):
            entry.on_write = self._configure
        self._configure(0)

    def _configure(self, t_ns: int) -> None:
        """Take over units, limits and torques as the objects have them now."""
        self.advance(t_ns)
        self.units.configure()
        self.limits.configure()
        self._following_error.configure()
        torque_nmm = self._max_torque.number / 1000 * self._rated.number
        self.shaft.set_limit(min(torque_nmm, self._motor_torque_nmm))

    def _zero_found(self) -> None:
        self.homed = True
        self._kept_zero = self.units.zero
        self.limits.configure()
        self.refresh(self.t_ns)

    # Supervision

    def _followed_too_badly(self, t_ns: int) -> None:
        self._following_error.forget()
        if not self.mode.ignores_following_error:
            self._followed_badly = self.mode.code in _POSITION_MODES
            self.fault(FOLLOWING_ERROR, t_ns)

    def _look_after(self, t_ns: int) -> None:
        """See to it that ticks come while they are needed."""
        behind = self._following_error.since_ns is not None
        needed = behind or (self.power.following and self.mode.busy)
        if needed and not self._tick_timer.running:
            self._tick_timer.set(t_ns + self._tick_ns)

    def _tick(self, t_ns: int) -> None:
        self.advance(t_ns)
        if self.power.following:
            self.mode.tick()
        self._look_after(t_ns)
        self._events.status_changed(t_ns)

    def _nothing_commanded(self, t_ns: int) -> None:
        """In a cyclic mode commands are what looks at the shaft; it moves on without them too."""
        self.advance(t_ns)
        if not self.shaft.at_rest:
            self._silence_timer.set(t_ns + self._silence_ns)

    def _status_while_stopping(self) -> int:
        """Halted, or braking: the target counts as reached when the motor stands.

        Not so before the brake is open: what has been asked for is still to come.
        """
        synchronous = self.mode.code in _SYNCHRONOUS_MODES
        waits = self.shaft.moving or not self.power.brake_open
        return 0 if synchronous or waits else TARGET_REACHED


def _check_homing_method(value: int) -> None:
    if value not in METHODS:
        raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)
