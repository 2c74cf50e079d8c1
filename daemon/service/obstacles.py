"""Streams of moving obstacles: what is believed, until when, and what is told when one stops."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

from config.axis import Axis
from daemon.messages import MovingObstacle, Obstacles
from safety.risk.moving_obstacles import NOTHING_MOVES, MovingBall, Swept

_LONGEST_VALIDITY_S: Final = 1.0
MOST_BALLS: Final = 16
"""Of one user: each costs the control step time while it is near."""
_STEPS_S: Final = 0.1
"""Four frames of 25 ms: a step is begun, goes on until the next one, and frames may be late."""
_NOT_NEWER: Final = (
    "it is not newer than what came before: another program may send in this user's name"
)
_QUIET_NS: Final = 1_000_000_000
_MOST_REASONS: Final = 8
"""Told of one user, until nothing of what they send was refused for a second."""

Changed = Callable[[Swept, int | None], None]
"""Hears where balls may be from now on, and until when that is believed (monotonic clock, ns).
None: nothing moves."""


def horizon_s(axes: Sequence[Axis]) -> float:
    """How long a step goes on that is begun now, with its braking."""
    return _STEPS_S + max(axis.max_velocity / axis.max_acceleration for axis in axes)


@dataclass(frozen=True, slots=True)
class _Stream:
    """The newest of one user."""

    sequence: int
    until_ns: int
    balls: tuple[tuple[MovingBall, float], ...]
    """Each with the time for which it is led on, s."""


class MovingObstacles:
    """Of one robot, from all users, each of whom has one stream.

    What a stream has said last counts until something newer comes, also when it is no longer
    believed: then nothing moves. A stream ends with a message without balls.
    """

    def __init__(self, horizon_s: float, changed: Changed) -> None:
        self._horizon_s = horizon_s
        self._changed = changed
        self._streams: dict[str, _Stream] = {}
        self._until_ns: int | None = None
        self.swept = NOTHING_MOVES
        """Where balls may be, as the gate counts with them."""

    @property
    def count(self) -> int:
        """How many balls there are."""
        return sum(len(stream.balls) for stream in self._streams.values())

    def take(self, user: str, message: Obstacles, t_ns: int) -> str:
        """Count with what came at `t_ns`. Returns why not; empty if it counts."""
        why = self._unwanted(user, message, t_ns)
        if why:
            return why
        if message.balls:
            for_s = message.valid_for_s + self._horizon_s
            balls = tuple((_ball(one), for_s) for one in message.balls)
            left_ns = round((message.valid_for_s - message.age_s) * 1e9)
            self._streams[user] = _Stream(message.sequence, t_ns + left_ns, balls)
        else:
            self._streams.pop(user, None)
        self._tell()
        return ""

    def late(self, t_ns: int) -> str:
        """Whose streams have stopped; empty: none."""
        if self._until_ns is None or t_ns <= self._until_ns:
            return ""
        return ", ".join(user for user, one in self._streams.items() if t_ns > one.until_ns)

    def forget_late(self, t_ns: int) -> None:
        """What sent them is gone for good, an operator says."""
        if self.late(t_ns):
            left = {user: one for user, one in self._streams.items() if t_ns <= one.until_ns}
            self._streams = left
            self._tell()

    def _tell(self) -> None:
        streams = self._streams.values()
        self._until_ns = min((stream.until_ns for stream in streams), default=None)
        self.swept = Swept.of([ball for one in streams for ball in one.balls])
        self._changed(self.swept, self._until_ns)

    def _unwanted(self, user: str, message: Obstacles, t_ns: int) -> str:
        there = self._streams.get(user)
        # Who begins anew counts from the beginning.
        if there and t_ns <= there.until_ns and message.sequence <= there.sequence:
            return _NOT_NEWER
        if len(message.balls) > MOST_BALLS:
            return f"{len(message.balls)} balls are more than {MOST_BALLS}"
        if not 0.0 < message.valid_for_s <= _LONGEST_VALIDITY_S:
            return f"valid_for_s must be more than 0 and at most {_LONGEST_VALIDITY_S:g}"
        if not 0.0 <= message.age_s < message.valid_for_s:
            return "age_s must be 0 or more, and less than valid_for_s"
        faults = (_ball(one).fault() for one in message.balls)
        return next((f"a ball: {fault}" for fault in faults if fault), "")


class Refusals:
    """Why messages of users are dropped, each reason once until all is well for a while: streams
    are many messages a second."""

    def __init__(self) -> None:
        self._told: dict[str, set[str]] = {}
        self._last_ns: dict[str, int] = {}

    def is_news(self, user: str, why: str, t_ns: int) -> bool:
        """Whether that a message of `user` is dropped is to be told."""
        told = self._told.setdefault(user, set())
        if t_ns - self._last_ns.get(user, t_ns) > _QUIET_NS:
            told.clear()
        self._last_ns[user] = t_ns
        if why in told or len(told) >= _MOST_REASONS:
            return False
        told.add(why)
        return True


def _ball(one: MovingObstacle) -> MovingBall:
    velocity = (0.0, 0.0, 0.0) if one.velocity_mm_s is None else tuple(one.velocity_mm_s)
    return MovingBall(tuple(one.centre_mm), one.radius_mm, velocity)
