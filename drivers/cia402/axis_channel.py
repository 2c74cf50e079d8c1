"""One axis on the bus: what it last said, and what it is sent in each cycle."""

from math import copysign
from typing import Final, Protocol

from config.axis import Axis
from drivers.axis_scale import axis_scale, count_limits
from drivers.cia402.objects import CYCLIC_MODES, MODES
from drivers.cia402.pdo_plan import RPDO_LAYOUT, TPDO_LAYOUT, axis_pdos
from drivers.cia402.power_state import (
    Control,
    FaultReset,
    PowerGoal,
    PowerState,
    StatuswordBit,
    controlword_to_stay,
    controlword_towards,
    power_state,
    reached,
)
from safety.limits import CountLimits, velocity_within
from safety.permit import PermittedStep

# What a drive in each mode is sent for one permitted step: mode bits and a target.


_LONGEST_S: Final = 0.02
"""After a longer gap a velocity may change by as much as in this time: the longest bus cycle."""
_INT32_LOW: Final = -(1 << 31)
_INT32_HIGH: Final = (1 << 31) - 1


class Target(Protocol):
    """The target of one axis, cycle after cycle, while it is enabled and follows."""

    def hold(self, position: int) -> None:
        """Stay at `position` counts until there is a step; called each cycle before enabling."""
        ...

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int, share: float
    ) -> tuple[int, int]:
        """Mode bits of the controlword, and the value of the target object. share: what may be
        gone of the way from the target before."""
        ...


class CyclicPosition:
    """CSP: the point of the step that is due now.

    Where the step is taken away in mid-motion, the axis brakes as it would have after its end.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._held = 0
        self._velocity = self._deceleration = 0.0
        """Of the last step, when it was last followed; then of braking."""
        self._sent_for_ns = 0

    def hold(self, position: int) -> None:
        self._held, self._velocity = position, 0.0

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int, share: float
    ) -> tuple[int, int]:
        del position, statusword
        if step is not None:
            way = step.target(self._index, t_ns) - self._held
            self._held += way if share >= 1.0 else int(share * way)
            self._velocity = step.velocity(self._index, t_ns)
            self._deceleration = step.decelerations[self._index]
        elif self._velocity:
            self._brake(min((t_ns - self._sent_for_ns) * 1e-9, _LONGEST_S))
        self._sent_for_ns = t_ns
        return 0, self._held

    def _brake(self, cycle_s: float) -> None:
        speed = max(0.0, abs(self._velocity) - self._deceleration * cycle_s)
        self._velocity = copysign(speed, self._velocity)
        self._held += int(self._velocity * cycle_s)


class Velocity:
    """CSV and PV: the step's velocity, and what brings the axis back onto its line.

    What is sent keeps to the axis' own limits by itself: it also has to where the axis is far from
    its line, and a velocity that is the last to arrive goes on for a while.
    """

    _CATCH_UP_PER_S: Final = 5.0

    def __init__(self, index: int, limits: CountLimits, unit_counts_s: float) -> None:
        self._index = index
        self._limits = limits
        self._unit_counts_s = unit_counts_s
        self._held = 0
        self._sent = 0.0
        self._sent_for_ns: int | None = None
        self._before = self._cycle_s = 0.0
        """What was sent for the cycle before, and how long ago that was."""

    def hold(self, position: int) -> None:
        self._held = position
        self._sent, self._sent_for_ns = 0.0, None

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int, share: float
    ) -> tuple[int, int]:
        del statusword, share
        velocity = 0.0
        if step is not None:
            self._held = step.target(self._index, t_ns)
            velocity = step.velocity(self._index, t_ns)
        velocity += self._CATCH_UP_PER_S * (self._held - position)
        self._sent = self._within_limits(velocity, t_ns, position)
        value = round(self._sent / self._unit_counts_s)
        return 0, max(_INT32_LOW, min(_INT32_HIGH, value))

    def _within_limits(self, velocity: float, t_ns: int, position: int) -> float:
        """Frames for one SYNC may be sent twice: only the time between two of them counts."""
        if self._sent_for_ns != t_ns:
            since_ns = self._sent_for_ns
            self._before = self._sent
            self._cycle_s = 0.0 if since_ns is None else min((t_ns - since_ns) * 1e-9, _LONGEST_S)
            self._sent_for_ns = t_ns
        return velocity_within(velocity, self._before, position, self._limits, self._cycle_s)


class ProfilePosition:
    """PP: each step's end as a set-point of its own, handed over by the drive's handshake.

    A new set-point is offered with bit 4 until the drive acknowledges it, then taken back until the
    drive is ready for the next. Steps that come meanwhile are left out but for the newest.
    """

    def __init__(self, index: int) -> None:
        self._index = index
        self._wanted = self._offered = 0
        self._offering = False

    def hold(self, position: int) -> None:
        self._wanted = self._offered = position
        self._offering = False

    def output(
        self, t_ns: int, step: PermittedStep | None, position: int, statusword: int, share: float
    ) -> tuple[int, int]:
        del t_ns, position, share
        if step is not None:
            self._wanted = step.to_counts[self._index]
        acknowledged = bool(statusword & StatuswordBit.SETPOINT_ACKNOWLEDGED)
        if self._offering:
            self._offering = not acknowledged
        elif not acknowledged and self._wanted != self._offered:
            self._offered, self._offering = self._wanted, True
        bits = Control.CHANGE_IMMEDIATELY | (Control.NEW_SETPOINT if self._offering else 0)
        return bits, self._offered


def target_of(mode: str, index: int, limits: CountLimits, unit_counts_s: float) -> Target:
    """The target of an axis in `mode`, at place `index` of the actuation vector."""
    if MODES[mode].is_velocity:
        return Velocity(index, limits, unit_counts_s)
    return ProfilePosition(index) if mode == "pp" else CyclicPosition(index)


_FOLLOWS_WITHIN_NS: Final = 500_000_000
"""Drives hold a target back while their brake opens, and tell so; old ones tell nothing."""

_ON_THE_WAY_UP: Final = (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON)
_CAN_BE_ENABLED: Final = (PowerState.OPERATION_ENABLED, PowerState.SWITCHED_ON)
_DONE_WITHIN_NS: Final = 2_000_000_000
"""Judgement: four transitions with a frame each, and between them a brake that opens."""


def _voltage_state(state: PowerState) -> PowerState:
    """The state that stands for all those in which a drive tells of its motor voltage alike."""
    if state.energised:
        return PowerState.OPERATION_ENABLED
    return state if state in _ON_THE_WAY_UP else PowerState.SWITCH_ON_DISABLED


class AxisChannel:
    """The axis at place `index` of the actuation vector."""

    def __init__(self, axis: Axis, index: int) -> None:
        limits = count_limits(axis)
        self.axis = axis
        self.index = index
        self.scale = axis_scale(axis)
        self.pdos = axis_pdos(axis.drive)
        self.rpdo_id = self.pdos.rpdo.can_id
        self.statusword = 0
        self.state = PowerState.UNKNOWN
        self.position_counts = 0
        self.torque_permille = 0
        self.received_ns: int | None = None
        """When the axis last told its state; None while it has not."""
        self.following = False
        """Enabled, as it is told to be, and moving when its target moves."""
        self.target_counts: int | None = None
        """What was last sent: a position, or a velocity in the velocity modes."""
        self._voltage_told: set[PowerState] = set()
        """Where the drive has told of motor voltage since it was set up: some do in every state,
        others only while their power stage is on."""
        self._had_torque = False
        self.goal: PowerGoal | None = None
        """None: leave the drive's power as it is, and send it nothing."""
        self._goal_since_ns = 0
        self.waits_for_others = False
        """Not to be enabled before the other axes can be: a body is not held by one."""
        self.homing = self.start_homing = False
        """In homing mode: the drive moves by itself, and targets mean nothing."""
        self.zero_found = False
        """Homed since the drive was last away, as far as could be heard."""
        self.zero_lost = False
        """Its encoder has failed since the drive was last away."""
        self._referenced_bit = axis.homing.referenced_bit
        self._keeps_zero = axis.homing.referenced == "absolute_encoder"
        self._cyclic = axis.drive.mode in CYCLIC_MODES
        self._max_velocity = limits.max_velocity
        self._enabled_since_ns: int | None = None
        self._fault_reset = FaultReset()
        self._target = target_of(axis.drive.mode, index, limits, axis.drive.velocity_unit_counts_s)
        self._stays_in_touch = self.pdos.rpdo.deadline_ms > 0
        """Once spoken to, it must not be left without a word: it would take that for an error."""
        self._spoken_to = False

    def receive(self, data: bytes, t_ns: int) -> bool:
        """The axis' state came. False: it is not in the form it was told to have."""
        if len(data) != TPDO_LAYOUT.size:
            return False
        statusword, self.position_counts, self.torque_permille = TPDO_LAYOUT.unpack(data)
        self.received_ns = t_ns
        if statusword != self.statusword or not self.following:
            self.statusword = statusword
            self.state = power_state(statusword)
            self._learn_of_voltage()
            self._follow(t_ns)
        return True

    def is_silent(self, t_ns: int, timeout_ns: int) -> bool:
        """Whether the axis used to tell its state and does so no more."""
        return self.received_ns is not None and t_ns - self.received_ns > timeout_ns

    def share_in_a_cycle(self, t_ns: int, step: PermittedStep, cycle_s: float) -> float:
        """Of the way to where `step` is at `t_ns`, what the axis goes in one cycle at the most; 1
        where it is told no places for each cycle."""
        if not self.following or self.target_counts is None or self.axis.drive.mode != "csp":
            return 1.0
        way = abs(step.target(self.index, t_ns) - self.target_counts)
        most = self._max_velocity * cycle_s + 1.0
        return 1.0 if way <= most else most / way

    def output(self, t_ns: int, step: PermittedStep | None, share: float = 1.0) -> bytes | None:
        """The next RPDO; None while the drive's power is to be left alone, or is not known.

        share: of the way to where `step` is at `t_ns`, what may be gone.
        """
        goal, position = self.goal, self.position_counts
        if goal is None or self.received_ns is None:
            return self._stay() if self._spoken_to else None
        self._spoken_to = self._stays_in_touch
        following = self.following
        if self._fault_reset.running:
            controlword = self._fault_reset.controlword()
        elif following:
            controlword = Control.ENABLE_OPERATION
        else:
            controlword = controlword_towards(goal, self.state)
            if self.waits_for_others and self.state is PowerState.SWITCHED_ON:
                controlword = min(controlword, Control.SWITCH_ON)
        if not following:
            self._target.hold(position)
            step = None
        mode_bits, target = self._target.output(t_ns, step, position, self.statusword, share)
        if controlword == Control.ENABLE_OPERATION:
            if not self.homing:
                controlword |= mode_bits
            elif self.start_homing:
                controlword |= Control.START_HOMING
        self.target_counts = target
        return RPDO_LAYOUT.pack(controlword, target)

    def _stay(self) -> bytes | None:
        """What changes nothing, with a velocity of 0."""
        controlword = controlword_to_stay(self.state)
        return None if controlword is None else RPDO_LAYOUT.pack(controlword, 0)

    @property
    def keeps_others_waiting(self) -> bool:
        """Whether the axis is to be enabled, and cannot be yet."""
        return self.goal is PowerGoal.ENABLED and self.state not in _CAN_BE_ENABLED

    def _learn_of_voltage(self) -> None:
        """A stage that has just been switched off may tell of a voltage that is not fed any more:
        at rest only what is told before the first torque counts."""
        self._had_torque |= self.state.energised
        if self.statusword & StatuswordBit.VOLTAGE_ENABLED and (
            self.state.energised or not self._had_torque
        ):
            self._voltage_told.add(_voltage_state(self.state))

    @property
    def voltage_lost(self) -> bool:
        """Whether the drive tells of no motor voltage, in a state in which it has told of it."""
        tells = self.statusword & StatuswordBit.VOLTAGE_ENABLED
        return not tells and _voltage_state(self.state) in self._voltage_told

    @property
    def referenced(self) -> bool:
        """Whether the drive knows where its zero is."""
        if self._referenced_bit is not None:
            return bool(self.statusword >> self._referenced_bit & 1)
        return self.zero_found or (self._keeps_zero and not self.zero_lost)

    def set_goal(self, goal: PowerGoal | None, t_ns: int) -> None:
        """What the drive shall do from now on."""
        self.goal, self._goal_since_ns = goal, t_ns
        self.following = self.following and goal is PowerGoal.ENABLED

    def is_unwilling(self, t_ns: int) -> bool:
        """Whether the drive has had time enough to do what it is told, and has not."""
        goal, late = self.goal, t_ns - self._goal_since_ns > _DONE_WITHIN_NS
        return late and goal is not None and not reached(goal, self.state)

    def begin_fault_reset(self, t_ns: int) -> None:
        """Send the edge that resets a fault, with the next cycles, and leave the drive off."""
        self.set_goal(PowerGoal.OFF, t_ns)
        self._fault_reset.begin()

    @property
    def goal_reached(self) -> bool:
        """Whether the drive has done what `goal` asks."""
        return self.goal is None or reached(self.goal, self.state)

    def forget(self) -> None:
        """The drive is gone or was reset: nothing it said before counts."""
        self.received_ns = self.target_counts = self._enabled_since_ns = self.goal = None
        self.following = self.zero_found = self.zero_lost = self._had_torque = False
        self._voltage_told.clear()
        self._spoken_to = False
        self.homing = self.start_homing = False
        self._fault_reset = FaultReset()  # what is left of one would reset a fault that comes later
        self.statusword, self.state = 0, PowerState.UNKNOWN

    def _follow(self, t_ns: int) -> None:
        if self.state is not PowerState.OPERATION_ENABLED:
            if self._enabled_since_ns is not None and self.goal is PowerGoal.ENABLED:
                self.goal = None  # it has stopped by itself: to go on is somebody's decision
            self._enabled_since_ns, self.following = None, False
            return
        if self._enabled_since_ns is None:
            self._enabled_since_ns = t_ns
        follows = not self._cyclic or bool(self.statusword & StatuswordBit.FOLLOWS_TARGET)
        ready = follows or t_ns - self._enabled_since_ns > _FOLLOWS_WITHIN_NS
        self.following = ready and self.goal is PowerGoal.ENABLED and not self.homing
