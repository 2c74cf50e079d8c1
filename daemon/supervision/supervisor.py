"""Who decides what state the robot is in: causes, operator's requests, and the drives' power."""

from collections.abc import Callable, Sequence

from config.control import Supervision
from daemon.supervision.checks import Checks
from daemon.supervision.power import Power, PowerPhase
from drivers.cia402.drive_bus import DriveBus
from safety.causes import Cause, ClearRule, Severity
from safety.consequences import Consequences, with_leads
from safety.failsafe import ActiveReason, Failsafe
from safety.states import OperatingState, Request, next_state, refusal

StateListener = Callable[[OperatingState, OperatingState, int], None]


class Supervisor:
    """The robot's operating state. All methods are called from the event loop."""

    def __init__(
        self, settings: Supervision, buses: Sequence[DriveBus], on_state: StateListener
    ) -> None:
        """on_state: hears of every change: before, after, when."""
        self.state = OperatingState.STANDBY
        self.failsafe = Failsafe()
        self.power = Power(buses)
        self.arming = False
        """The drives are being enabled."""
        self.stopped_by: tuple[ActiveReason, ...] = ()
        """Why the robot was last held or switched off, worst first; nothing once motion goes on.
        What has stopped it may be over before anybody could see it."""
        self._buses = buses
        self.checks = Checks(
            self.failsafe, settings, buses, self.power, lambda t_ns: self._go(t_ns, None)
        )
        self._on_state = on_state
        self._verdict = self.failsafe.evaluate(0, False)
        self._consequences = Consequences()
        self._reasons = self._verdict.reasons

    @property
    def energised(self) -> bool:
        """Whether drives are, or are being, powered."""
        return self.arming or self.state.energised

    @property
    def running(self) -> bool:
        """Whether a reference is being followed."""
        return self.state is OperatingState.RUNNING

    @property
    def reasons(self) -> tuple[ActiveReason, ...]:
        """Everything that is not as it should be, worst first; what follows from another reason
        comes behind it."""
        return self._reasons

    @property
    def blocking(self) -> tuple[ActiveReason, ...]:
        """What stands in the way of arming, and what it follows from."""
        return with_leads(self._reasons, Severity.NOT_READY)

    @property
    def still_holds(self) -> bool:
        """Whether something holds the robot that `resume` does not take away."""
        return any(
            reason.severity >= Severity.HOLD
            and not (reason.latched and reason.cause.clears is ClearRule.BY_RESUME)
            for reason in self._reasons
        )

    @property
    def severity(self) -> Severity:
        """Of the worst of them."""
        return self._verdict.severity

    # What happens.

    def cycle(self, t_ns: int, gap_s: float, why_late: str) -> None:
        """Once per bus cycle, before anything is sent."""
        self.checks.gap(gap_s, t_ns, why_late)
        homing = self.state is OperatingState.HOMING
        self.checks.cycle(t_ns, self.energised, self.running, homing)
        self.power.cycle(t_ns)
        if self.arming and self.power.phase is PowerPhase.ENABLED:
            self.arming = False
            self._go(t_ns, Request.ARMED)
        self._go(t_ns, None)
        if self.power.wanted and not self.energised:  # something went missing while they came on
            self.power.stop(t_ns)

    # What operators ask for. Whether they may is the service's business.

    def refusal(self, request: Request) -> str:
        """Why a request is not possible now, in words; empty if it is."""
        if self.arming and request in (Request.ARM, Request.HOME):
            return "the drives are being enabled already"
        if self.comes_to_rest and request in (Request.ARM, Request.CLEAR, Request.HOME):
            return "the drives are still being switched off"
        # What is in the way of these two may be what they take out of the way.
        undoes = request in (Request.RESUME, Request.CLEAR)
        severity = Severity.NONE if undoes else self.severity
        return refusal(self.state, request, severity, bool(self._blocking(request)))

    def _blocking(self, request: Request | None) -> tuple[ActiveReason, ...]:
        """What stands in the way of a request to arm, or to home: which takes one of them away."""
        if request is not Request.HOME:
            return self.blocking
        return tuple(one for one in self.blocking if one.cause is not Cause.NOT_REFERENCED)

    def arm(self, t_ns: int) -> None:
        """Energise the drives where they stand; ARMED when they all follow."""
        self.arming = True
        self.power.enable(t_ns)

    def request(self, request: Request, t_ns: int) -> None:
        """Carry out a request that is possible in this state."""
        if request is Request.RESUME:
            self.failsafe.resume()
        elif request is Request.HOLD and self.state is not OperatingState.HOMING:
            self.checks.operator_hold(t_ns)
        elif request in (Request.STOP, Request.DISARM, Request.HOMED):
            self.arming = False
            self.power.stop(t_ns)
        elif request is Request.HOME:
            self.power.home(t_ns)
        self._go(t_ns, request)

    def clear(self, t_ns: int) -> tuple[ActiveReason, ...]:
        """Acknowledge what is latched and take the drives out of their faults.

        Returns what still holds.
        """
        for bus in self._buses:
            bus.reset_faults()
        left = self.failsafe.clear()
        self._go(t_ns, Request.CLEAR)
        return left

    @property
    def comes_to_rest(self) -> bool:
        """The drives were told to stop, and are not off yet."""
        return not self.power.at_rest and not self.power.wanted

    def _react(self, t_ns: int) -> None:
        self._go(t_ns, None)

    def _go(self, t_ns: int, request: Request | None) -> None:
        """Work out the state anew; more than one step where one leads to the next."""
        verdict = self.failsafe.evaluate(t_ns, self.energised)
        if verdict is not self._verdict:
            self._verdict = verdict
            self._reasons = self._consequences.ordered(verdict.reasons, t_ns)
        rests = self.comes_to_rest
        blocked = bool(self._blocking(request)) or rests
        if self.arming and self._verdict.severity >= Severity.DISARM:
            self.arming = False
            self.power.stop(t_ns)
        while (
            after := next_state(self.state, request, self._verdict.severity, blocked, rests)
        ) is not self.state:
            before, self.state = self.state, after
            request = None
            if before.energised and not after.energised:
                self.power.stop(t_ns)
            self._keep_reasons(before, after)
            self._on_state(before, after, t_ns)

    def _keep_reasons(self, before: OperatingState, after: OperatingState) -> None:
        fails = after in (OperatingState.FAULT, OperatingState.ESTOP)
        if after is OperatingState.RUNNING:
            self.stopped_by = ()
        elif after is OperatingState.HOLD or (before.energised and not after.energised) or fails:
            self.stopped_by = with_leads(self._reasons, Severity.HOLD) or self.stopped_by
