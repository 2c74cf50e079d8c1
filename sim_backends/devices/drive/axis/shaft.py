"""The motor shaft: what is demanded of it, where it is, and what stands in its way.

The demand is piecewise of constant acceleration. The position loop makes the shaft follow as a
first-order lag, which has a closed form: nothing is computed between two moments of interest.
"""

from collections import deque
from collections.abc import Iterable
from math import exp, inf
from typing import Final

from sim_backends.devices.can.events import NEVER_NS
from sim_backends.devices.drive.axis.trajectory import Piece

_AT_REST: Final = 1e-6
_TIGHT: Final = 1e-9
_SETTLED_LAGS: Final = 4  # so long after its demand the shaft stands too


class Shaft:
    """All positions in increments of the encoder, velocities per s; torques in N·mm.

    A positive load pushes towards lower positions. What the motor cannot overcome it does not
    move against, and it does not give way either: a screw holds itself.
    """

    def __init__(self, position: float, low_stop: float, high_stop: float, lag_s: float) -> None:
        self.position = position
        self.demand = position
        self.demand_velocity = 0.0
        self.t_ns = 0
        """The present: how far it was advanced."""
        self.energised = False
        self.load_nmm = 0.0
        self.limit_nmm = inf
        """What the motor can give."""
        self.blocked = False
        self.pushing = 0
        """+1 or -1: the demand lies beyond what stands in the way in that direction."""
        self._stops = (low_stop, high_stop)
        self._low, self._high = low_stop, high_stop  # free way at present
        self._lag_s = lag_s
        self._acceleration = 0.0
        self._pieces: deque[tuple[int, float, float, float | None]] = deque()
        self._piece_end_ns = NEVER_NS
        self._piece_end: float | None = None
        self.at_rest = True
        """Whether nothing changes as long as nothing is done to it."""

    # What it is now

    @property
    def following_error(self) -> float:
        """Demand minus position."""
        return self.demand - self.position

    @property
    def velocity(self) -> float:
        """Of the shaft itself: the loop drives it in proportion to the error."""
        if not self.energised or self.pushing:
            return 0.0
        return (self.demand - self.position) / self._lag_s

    @property
    def torque_nmm(self) -> float:
        """What the motor gives, positive towards higher positions."""
        if not self.energised:
            return 0.0
        load, limit = self.load_nmm, self.limit_nmm
        if self.pushing:
            return self.pushing * limit
        if -limit <= load <= limit:
            return load
        return limit if load > 0.0 else -limit

    @property
    def moving(self) -> bool:
        """Whether the demand is under way."""
        return self._piece_end_ns != NEVER_NS or self.demand_velocity != 0.0

    @property
    def settles_ns(self) -> int:
        """When the shaft will stand, as good as; NEVER_NS where the demand goes on for ever."""
        last_ns = self._pieces[-1][0] if self._pieces else self._piece_end_ns
        return min(NEVER_NS, last_ns + round(_SETTLED_LAGS * self._lag_s * 1e9))

    # What is done to it

    def energise(self) -> None:
        """Torque on, holding where it is."""
        self.energised = True
        self.hold()
        self._find_way()

    def release(self) -> None:
        """Torque off: it stands still at once."""
        self.energised = False
        self.hold()

    def hold(self) -> None:
        """Demand what is."""
        self._clear()
        self.demand = self.position
        self.demand_velocity = 0.0
        self.pushing = 0
        self.at_rest = True

    def interpolate(self, target: float, duration_ns: int) -> None:
        """Demand to go straight to `target`, to arrive after `duration_ns` and wait there."""
        if self._pieces:
            self._pieces.clear()
        self._acceleration = 0.0
        self.demand_velocity = (target - self.demand) * 1e9 / duration_ns
        if self.demand_velocity == 0.0:
            self._piece_end_ns = NEVER_NS
            return
        self._piece_end_ns = self.t_ns + duration_ns
        self._piece_end = target
        self.at_rest = False

    def follow(self, pieces: Iterable[Piece], end: float | None) -> None:
        """Demand this profile from now on; it is known to end at `end`."""
        self._clear()
        self.demand_velocity = 0.0
        at_s = 0.0
        for piece in pieces:
            at_s += piece.duration_s
            end_ns = NEVER_NS if at_s == inf else self.t_ns + round(at_s * 1e9)
            self._pieces.append((end_ns, piece.velocity, piece.acceleration, None))
        if self._pieces:
            end_ns, velocity, acceleration, _ = self._pieces.pop()
            self._pieces.append((end_ns, velocity, acceleration, end))
            self._next_piece()
        self.at_rest = False

    def set_load(self, torque_nmm: float) -> None:
        """What the axis has to hold from now on."""
        self.load_nmm = torque_nmm
        self._find_way()

    def set_limit(self, torque_nmm: float) -> None:
        """What the motor can give from now on."""
        self.limit_nmm = torque_nmm
        self._find_way()

    def block(self, blocked: bool) -> None:
        """Something jams it, or no longer."""
        self.blocked = blocked
        self._find_way()

    def drag_to(self, position: float) -> None:
        """A hand has turned it, where no torque holds it."""
        self.position = max(self._stops[0], min(self._stops[1], position))
        self.hold()
        self._find_way()

    def advance(self, t_ns: int) -> None:
        """Let time pass until `t_ns`."""
        if t_ns <= self.t_ns:
            return
        if self.at_rest:
            self.t_ns = t_ns
            return
        while (end_ns := self._piece_end_ns) <= t_ns:
            self._step((end_ns - self.t_ns) * 1e-9)
            self.t_ns = end_ns
            self._next_piece()
        if self.t_ns < t_ns:
            self._step((t_ns - self.t_ns) * 1e-9)
            self.t_ns = t_ns

    def _step(self, dt_s: float) -> None:
        """Exact solution of the lag, d position/dt = error / lag, for a demand at²/2 + vt + d."""
        lag_s, velocity, acceleration = self._lag_s, self.demand_velocity, self._acceleration
        steady = (velocity - acceleration * lag_s) * lag_s
        demand = self.demand
        error = demand - self.position
        error = steady + acceleration * lag_s * dt_s + (error - steady) * exp(-dt_s / lag_s)
        self.demand = demand = demand + (velocity + acceleration * dt_s / 2) * dt_s
        self.demand_velocity = velocity = velocity + acceleration * dt_s
        self.position = position = demand - error
        if not self._low <= position <= self._high:
            self._meet(self._high if position > self._high else self._low)
        elif self.pushing:
            self.pushing = 0
        if velocity == 0.0 and -_AT_REST < error < _AT_REST and self._piece_end_ns == NEVER_NS:
            self.at_rest = True

    def _meet(self, obstacle: float) -> None:
        self.position = obstacle
        error = self.demand - obstacle
        self.pushing = 1 if error > _TIGHT else -1 if error < -_TIGHT else 0

    def _find_way(self) -> None:
        """Where the shaft can go at present."""
        self._low, self._high = self._stops
        if self.blocked or self.load_nmm < -self.limit_nmm:
            self._low = max(self._low, self.position)
        if self.blocked or self.load_nmm > self.limit_nmm:
            self._high = min(self._high, self.position)
        self.at_rest = False

    def _next_piece(self) -> None:
        end = self._piece_end
        if end is not None:  # the profile is over: take away what rounding has left
            if not self.pushing:
                self.position += end - self.demand
            self.demand = end
        if self._pieces:
            self._piece_end_ns, self.demand_velocity, self._acceleration, self._piece_end = (
                self._pieces.popleft()
            )
        else:
            self._piece_end_ns = NEVER_NS
            self._piece_end = None
            self._acceleration = self.demand_velocity = 0.0

    def _clear(self) -> None:
        self._pieces.clear()
        self._piece_end_ns = NEVER_NS
        self._piece_end = None
        self._acceleration = 0.0
