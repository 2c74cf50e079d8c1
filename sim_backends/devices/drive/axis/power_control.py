"""What the power state machine does to the motor: torque, brake, and the ways of stopping."""

from dataclasses import dataclass
from typing import Final, Protocol

from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.data_types import DataType
from sim_backends.devices.drive.axis import trajectory
from sim_backends.devices.drive.axis.mode import AxisParts
from sim_backends.devices.drive.axis.power import (
    FAULT_RESET,
    HALT,
    SUPPORTED_OPTIONS,
    TARGET,
    TRANSITIONS,
    ConnectionLost,
    PowerCommand,
    State,
    StopOption,
    command_of,
)
from sim_backends.devices.drive.node.object_dictionary import Entry, SdoAbortError

_ENERGISED: Final = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION)


class PowerEvents(Protocol):
    """What the axis is told."""

    def state_changed(self, t_ns: int) -> None:
        """The state, or whether targets are followed, is another one."""
        ...

    def follows(self, resumed: bool, t_ns: int) -> None:
        """Targets are followed from now on; resumed: after a halt or a stop that was taken back."""
        ...

    def cause_remains(self, code: int) -> bool:
        """Whether what made this fault is still there."""
        ...

    def fault_reset(self, codes: tuple[int, ...], t_ns: int) -> None:
        """These faults are over."""
        ...


@dataclass
class PowerTrouble:
    """What the world or a fault does to the power stage."""

    no_voltage: bool = False
    torque_off: bool = False
    """The safe-torque-off input is open."""
    refuses_enable: bool = False


class PowerControl:
    """The power state machine of one axis, at work. Called with the shaft advanced to `t_ns`."""

    def __init__(self, parts: AxisParts, events: PowerEvents, brake_release_s: float) -> None:
        self._parts = parts
        self._shaft = parts.shaft
        self._events = events
        self._brake_release_ns = parts.timers.host_ns(brake_release_s)
        self._brake_timer = parts.timers.timer(self._brake_released)
        self._stop_timer = parts.timers.timer(self._stop_timer_due)
        self._connection_option = self._option(0x6007, ConnectionLost.FAULT)
        self._quick_stop_option = self._option(0x605A, StopOption.QUICK_STOP_RAMP)
        self._shutdown_option = self._option(0x605B, StopOption.DISABLE)
        self._disable_option = self._option(0x605C, StopOption.SLOW_DOWN_RAMP)
        self._halt_option = self._option(0x605D, StopOption.SLOW_DOWN_RAMP)
        self._fault_option = self._option(0x605E, StopOption.QUICK_STOP_RAMP)
        self._deceleration = parts.own(0x6084, 0, DataType.UNSIGNED32, 100_000)
        self._quick_deceleration = parts.own(0x6085, 0, DataType.UNSIGNED32, 200_000)
        self._error_code = parts.own(0x603F, 0, DataType.UNSIGNED16)
        self.trouble = PowerTrouble()
        self.state = State.NOT_READY
        self.control = 0
        self.following = False
        """Whether the mode of operation has the motor."""
        self.halted = False
        self.enabled_with = 0
        """The controlword that enabled the axis."""
        self.settled = False
        """Whether the same controlword once more would change nothing."""
        self._stopping_for: State | None = None
        self.brake_open = False
        self._faults: list[int] = []

    def obey(self, control: int, t_ns: int) -> None:
        """A controlword counts from now on."""
        previous, self.control = self.control, control
        if self.state is State.FAULT:
            if control & FAULT_RESET and not previous & FAULT_RESET:
                self._reset_fault(t_ns)
        else:
            command = command_of(control)
            self._carry_out(command, t_ns)
            if self.state is State.SWITCHED_ON and command is PowerCommand.ENABLE_OPERATION:
                self._carry_out(command, t_ns)
            self._obey_halt(t_ns)
        self.settled = True

    def fault(self, code: int, t_ns: int, *, coast: bool = False) -> None:
        """Transition 13. coast: the motor cannot even brake."""
        if code not in self._faults:
            self._faults.append(code)
        self._error_code.value = code
        if self.state is State.FAULT or (self.state is State.FAULT_REACTION and not coast):
            return
        option = self._fault_option.number
        if coast or option == StopOption.DISABLE or not self._shaft.energised:
            self._enter(State.FAULT, t_ns)
        else:
            self._enter(State.FAULT_REACTION, t_ns)
            self._stop(self._rate(option), State.FAULT, t_ns)

    @property
    def faults_without_connection(self) -> bool:
        """Whether the loss of communication is a fault now: only of a motor that is switched on."""
        switched_on = self.state is State.SWITCHED_ON or self.state in _ENERGISED
        return switched_on and self._connection_option.number == ConnectionLost.FAULT

    def connection_lost(self, t_ns: int) -> None:
        """Communication is lost, and that is no fault: do what else 0x6007 says."""
        option = self._connection_option.number
        if option == ConnectionLost.DISABLE_VOLTAGE:
            self._carry_out(PowerCommand.DISABLE_VOLTAGE, t_ns)
        elif option == ConnectionLost.QUICK_STOP:
            self._carry_out(PowerCommand.QUICK_STOP, t_ns)
        self.settled = False

    def torque_lost(self, t_ns: int) -> None:
        """Nothing drives the motor any more, and that is no fault: safe torque off."""
        if self.state not in (State.NOT_READY, State.FAULT, State.SWITCH_ON_DISABLED):
            fault = self.state is State.FAULT_REACTION
            self._enter(State.FAULT if fault else State.SWITCH_ON_DISABLED, t_ns)

    def slow_down(self, t_ns: int) -> None:
        """Let what is under way run out: another mode takes over."""
        self._stop(self._rate(StopOption.SLOW_DOWN_RAMP), None, t_ns)

    def boot(self, t_ns: int) -> None:
        """Transitions 0 and 1."""
        self.control = 0
        self._enter(State.SWITCH_ON_DISABLED, t_ns)

    def off(self) -> None:
        """No power, or a reset: everything is forgotten."""
        self._shaft.release()
        self._faults.clear()
        self.state = State.NOT_READY
        self.following = self.halted = self.brake_open = False
        self._stopping_for = None

    def _carry_out(self, command: PowerCommand, t_ns: int) -> None:
        number = TRANSITIONS.get((self.state, command))
        if number is None:
            enabled = (
                self.state is State.OPERATION_ENABLED and command is PowerCommand.ENABLE_OPERATION
            )
            if enabled and self._stopping_for is not None:  # taken back before it was over
                self._stopping_for = None
                self._stop_timer.cancel()
                self._update_following(t_ns, resumed=True)
            return
        target = TARGET[number]
        if self._refused(number) or target is self._stopping_for:
            return
        ramp = (number == 5 and self._disable_option.number) or (
            number == 8 and self._shutdown_option.number
        )
        if ramp:
            self._stop(self._rate(StopOption.SLOW_DOWN_RAMP), target, t_ns)
        else:
            self._enter(target, t_ns)

    def _refused(self, number: int) -> bool:
        trouble = self.trouble
        if number in (2, 4) and (trouble.no_voltage or trouble.torque_off):
            return True
        if number == 4:
            return trouble.refuses_enable
        return number == 16 and self._quick_stop_option.number <= StopOption.STAY

    def _enter(self, state: State, t_ns: int) -> None:
        self.state = state
        self.settled = False
        self._stopping_for = None
        self._stop_timer.cancel()
        if state not in _ENERGISED:
            self._brake_timer.cancel()
            self.brake_open = self.halted = False
            self._shaft.release()
        elif not self._shaft.energised:
            self._shaft.energise()
            self.enabled_with = self.control
            self._brake_timer.set(t_ns + self._brake_release_ns)
        self._update_following(t_ns, resumed=True)
        self._events.state_changed(t_ns)
        if state is State.QUICK_STOP_ACTIVE:
            self._quick_stop(t_ns)

    def _quick_stop(self, t_ns: int) -> None:
        option = self._quick_stop_option.number
        stays = option > StopOption.STAY
        how = option - StopOption.STAY if stays else option
        if how == StopOption.DISABLE:
            self._enter(State.SWITCH_ON_DISABLED, t_ns)
        else:
            self._stop(self._rate(how), None if stays else State.SWITCH_ON_DISABLED, t_ns)

    def _obey_halt(self, t_ns: int) -> None:
        wanted = bool(self.control & HALT)
        if self.state is not State.OPERATION_ENABLED or wanted == self.halted:
            return
        was_following = self.following
        self.halted = wanted
        if was_following:
            self._stop(self._rate(self._halt_option.number), None, t_ns)
        self._update_following(t_ns, resumed=True)

    def _rate(self, how: int) -> float:
        """The deceleration of a stop."""
        limits = self._parts.limits
        if how == StopOption.SLOW_DOWN_RAMP:
            return limits.deceleration(self._deceleration)
        if how == StopOption.QUICK_STOP_RAMP:
            return limits.deceleration(self._quick_deceleration)
        return limits.max_deceleration

    def _stop(self, rate: float, then: State | None, t_ns: int) -> None:
        """Brake, and go to another state when the motor stands."""
        shaft = self._shaft
        shaft.follow(trajectory.stop(shaft.demand_velocity, rate), None)
        self._stopping_for = then
        self._update_following(t_ns, resumed=False)
        if then is None:
            return
        if shaft.moving:
            self._stop_timer.set(shaft.settles_ns)
        else:
            self._stopped(t_ns)

    def _stop_timer_due(self, t_ns: int) -> None:
        self._shaft.advance(t_ns)
        self._stopped(t_ns)

    def _stopped(self, t_ns: int) -> None:
        if self._stopping_for is not None:
            self._enter(self._stopping_for, t_ns)

    def _brake_released(self, t_ns: int) -> None:
        self._shaft.advance(t_ns)
        self.brake_open = True
        self._update_following(t_ns, resumed=False)
        self._events.state_changed(t_ns)

    def _update_following(self, t_ns: int, *, resumed: bool) -> None:
        following = (
            self.state is State.OPERATION_ENABLED
            and self.brake_open
            and not self.halted
            and self._stopping_for is None
        )
        begins = following and not self.following
        self.following = following
        if begins:
            self._events.follows(resumed, t_ns)

    def _reset_fault(self, t_ns: int) -> None:
        """Transition 15."""
        if any(self._events.cause_remains(code) for code in self._faults):
            return
        codes = tuple(self._faults)
        self._faults.clear()
        self._error_code.value = 0
        self._events.fault_reset(codes, t_ns)
        self._enter(State.SWITCH_ON_DISABLED, t_ns)

    def _option(self, index: int, default: int) -> Entry:
        entry = self._parts.own(index, 0, DataType.INTEGER16, default)

        def check(value: int) -> None:
            if value not in SUPPORTED_OPTIONS[index]:
                raise SdoAbortError(AbortCode.VALUE_OUT_OF_RANGE)

        entry.check = check
        return entry
