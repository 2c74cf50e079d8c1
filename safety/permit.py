"""The permit to move: the only thing that the drives' writer takes, and only the gate gives it.

A permit is a straight motion of all axes within a time. Its last check, on the integers that will
be sent, is made here, whatever the gate has computed before.
"""

from collections.abc import Sequence
from math import ceil, copysign, floor, inf
from typing import Final, NoReturn, final
from weakref import WeakKeyDictionary

from safety.coupling import CoupledLimit, broken, kept_apart, ranges, room_alone
from safety.limits import (
    HIGHEST_COUNT,
    LOWEST_COUNT,
    CountLimits,
    CoupledViolation,
    Violation,
    at_rest,
    braking_together_s,
)

_SEAL = object()
_FRESH_SHARE: Final = 0.5
"""Of a step's duration: a target that comes later than that would be a jump on the bus."""


class _Sealed:
    """What only this module can make, and nobody can change, copy, pickle or derive from."""

    __slots__ = ("__weakref__",)

    def __init_subclass__(cls) -> None:
        if cls.__module__ != __name__:
            raise TypeError("nothing can be derived from a permit")

    def __setattr__(self, name: str, value: object) -> None:
        raise AttributeError(f"a permit cannot be changed: {name}")

    def __delattr__(self, name: str) -> None:
        raise AttributeError(f"a permit cannot be changed: {name}")

    def __copy__(self) -> NoReturn:
        raise TypeError("a permit cannot be copied")

    def __deepcopy__(self, memo: object) -> NoReturn:
        raise TypeError("a permit cannot be copied")

    def __reduce_ex__(self, protocol: object) -> NoReturn:
        raise TypeError("a permit cannot be pickled")


_GIVEN: Final[WeakKeyDictionary[_Sealed, tuple[object, ...]]] = WeakKeyDictionary()
"""Every permit that is still somewhere, and what it permitted when it was given."""


def _give(made: _Sealed, seal: object, **contents: object) -> None:
    """The only way to fill a permit."""
    if seal is not _SEAL:
        raise TypeError("only the gate permits motion")
    for name, value in contents.items():
        object.__setattr__(made, name, value)
    _GIVEN[made] = tuple(contents.values())


def is_genuine(permitted: "PermittedStep | PermittedHoming") -> bool:
    """Whether it was given here, and still says what it said then."""
    try:
        names = type(permitted).__slots__
        return _GIVEN[permitted] == tuple([getattr(permitted, name) for name in names])
    except (KeyError, TypeError, AttributeError):
        return False


@final
class PermittedStep(_Sealed):
    """Targets for all axes, in counts, evenly reached between `begins_ns` and `ends_ns`.

    After its end an axis that is still told to move brakes at its highest acceleration, unless the
    next step takes over: a late frame does not stop it at once. Near a coupled limit all axes
    brake together, on the straight line that they move on.
    """

    __slots__ = ("begins_ns", "decelerations", "ends_ns", "from_counts", "rest_counts", "to_counts")
    begins_ns: int
    decelerations: tuple[float, ...]
    """Counts/s², of the braking after the end."""
    ends_ns: int
    from_counts: tuple[int, ...]
    rest_counts: tuple[int, ...]
    """Where that braking ends."""
    to_counts: tuple[int, ...]

    def __init__(
        self,
        seal: object,
        from_counts: tuple[int, ...],
        to_counts: tuple[int, ...],
        begins_ns: int,
        ends_ns: int,
        limits: Sequence[CountLimits],
        together: bool,
    ) -> None:
        """together: whether all axes brake on one line."""
        duration_s = (ends_ns - begins_ns) * 1e-9
        decelerations = _decelerations(from_counts, to_counts, duration_s, limits, together)
        rests = [
            _rest(start, end, duration_s, deceleration, one)
            for start, end, deceleration, one in zip(
                from_counts, to_counts, decelerations, limits, strict=True
            )
        ]
        _give(
            self,
            seal,
            begins_ns=begins_ns,
            decelerations=decelerations,
            ends_ns=ends_ns,
            from_counts=from_counts,
            rest_counts=tuple(rests),
            to_counts=to_counts,
        )

    def target(self, axis: int, t_ns: int) -> int:
        """Where `axis` is meant to be at `t_ns`."""
        start, end = self.from_counts[axis], self.to_counts[axis]
        if t_ns <= self.begins_ns:
            return start
        if t_ns < self.ends_ns:
            duration_ns = self.ends_ns - self.begins_ns
            twice = 2 * (end - start) * (t_ns - self.begins_ns)
            return start + (twice + duration_ns) // (2 * duration_ns)
        rest = self.rest_counts[axis]
        left_s = self._braking_left_s(axis, t_ns)
        way = int(self.decelerations[axis] * left_s * left_s / 2)
        return max(end, rest - way) if rest > end else min(end, rest + way)

    def targets(self, t_ns: int) -> tuple[int, ...]:
        """Where all axes are meant to be at `t_ns`."""
        return tuple([self.target(axis, t_ns) for axis in range(len(self.to_counts))])

    def velocity(self, axis: int, t_ns: int) -> float:
        """How fast `axis` is meant to move at `t_ns`, counts/s."""
        if t_ns < self.begins_ns:
            return 0.0
        if t_ns < self.ends_ns:
            return self._even_velocity(axis)
        speed = self.decelerations[axis] * self._braking_left_s(axis, t_ns)
        return copysign(speed, self._even_velocity(axis))

    def unchanged_ns(self, axis: int, t_ns: int) -> float:
        """For how long, up to `t_ns`, the axis has been told not to change its velocity."""
        even_ns = max(0, min(t_ns, self.ends_ns) - self.begins_ns)
        brakes_ns = abs(self._even_velocity(axis)) / self.decelerations[axis] * 1e9
        return even_ns + max(0, t_ns - self.ends_ns - brakes_ns)

    def is_fresh(self, t_ns: int) -> bool:
        """Whether it may still be sent for the first time."""
        latest_ns = self.begins_ns + (self.ends_ns - self.begins_ns) * _FRESH_SHARE
        return self.begins_ns <= t_ns <= latest_ns

    def _even_velocity(self, axis: int) -> float:
        change = self.to_counts[axis] - self.from_counts[axis]
        return change * 1e9 / (self.ends_ns - self.begins_ns)

    def _braking_left_s(self, axis: int, t_ns: int) -> float:
        """How long the braking after the end still takes."""
        brakes_s = abs(self._even_velocity(axis)) / self.decelerations[axis]
        return max(0.0, brakes_s - (t_ns - self.ends_ns) * 1e-9)


def _decelerations(
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    duration_s: float,
    limits: Sequence[CountLimits],
    together: bool,
) -> tuple[float, ...]:
    """Counts/s² of each axis' braking after a step."""
    if not together:
        return tuple([one.max_acceleration for one in limits])
    velocities = _velocities(from_counts, to_counts, duration_s)
    lasts_s = braking_together_s(velocities, limits)
    return tuple(
        [
            abs(velocity) / lasts_s if velocity else one.max_acceleration
            for velocity, one in zip(velocities, limits, strict=True)
        ]
    )


def _velocities(
    from_counts: Sequence[int], to_counts: Sequence[int], duration_s: float
) -> list[float]:
    return [(end - start) / duration_s for start, end in zip(from_counts, to_counts, strict=True)]


def _rest(
    start: int,
    end: int,
    duration_s: float,
    deceleration: float,
    limits: CountLimits,
    goes_on_s: float = 0.0,
) -> int:
    """Where an axis comes to rest that brakes from the end of its step, or so much later; inside
    its travel."""
    velocity = (end - start) / duration_s
    way = int(abs(velocity) * goes_on_s + velocity * velocity / (2 * deceleration))
    if velocity > 0:
        return max(end, min(end + way, limits.highest))
    return min(end, max(end - way, limits.lowest))


@final
class PermittedHoming(_Sealed):
    """Leave for one drive to look for its zero by itself, no faster than this, and no further."""

    __slots__ = ("axis", "highest", "lowest", "max_acceleration", "max_velocity")
    axis: int
    highest: int
    """Counts, as it has them before it has found its zero."""
    lowest: int
    max_acceleration: int
    """Counts/s²."""
    max_velocity: int
    """Counts/s."""

    def __init__(
        self, seal: object, axis: int, limits: CountLimits, lowest: int, highest: int
    ) -> None:
        _give(
            self,
            seal,
            axis=axis,
            highest=highest,
            lowest=lowest,
            max_acceleration=limits.max_acceleration,
            max_velocity=limits.max_velocity,
        )


def permit_homing(
    axis: int,
    limits: CountLimits,
    known_counts: Sequence[int | None] = (),
    coupled: Sequence[CoupledLimit] = (),
) -> PermittedHoming:
    """For the gate alone, like `permit`: the drive moves while nobody checks its targets.

    known_counts: one per axis where there are coupled limits; None of those without a zero.
    """
    lowest, highest = room_alone(coupled, axis, known_counts) if coupled else (-inf, inf)
    return PermittedHoming(
        _SEAL,
        axis,
        limits,
        LOWEST_COUNT if lowest < LOWEST_COUNT else ceil(lowest),
        HIGHEST_COUNT if highest > HIGHEST_COUNT else floor(highest),
    )


def permit(
    *,
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    measured_counts: Sequence[int],
    velocities_before: Sequence[float],
    begins_ns: int,
    duration_ns: int,
    limits: Sequence[CountLimits],
    coupled: Sequence[CoupledLimit] = (),
) -> PermittedStep | tuple[Violation | CoupledViolation, ...]:
    """The last check. For the gate alone: everything else gets its permits from there.

    from_counts, to_counts, measured_counts, limits: one per axis. velocities_before: counts/s that
    each axis was last told to have. coupled: what axes may not do together; they brake together
    where they could come to it if each did by itself. Raises ValueError where the numbers do not
    fit together.
    """
    count = len(limits)
    if not len(from_counts) == len(to_counts) == len(measured_counts) == count:
        raise ValueError("a step needs one start, one end and one measurement per axis")
    if len(velocities_before) != count or duration_ns <= 0:
        raise ValueError("a step needs one velocity per axis and a positive duration")
    if not set(map(type, (*from_counts, *to_counts, *measured_counts))) <= {int}:
        raise ValueError("a step is made of whole counts")
    violations: list[Violation | CoupledViolation] = [
        violation
        for axis in range(count)
        for violation in _violations(
            axis,
            from_counts[axis],
            to_counts[axis],
            measured_counts[axis],
            velocities_before[axis],
            duration_ns * 1e-9,
            limits[axis],
        )
    ]
    duration_s = duration_ns * 1e-9
    together = not _may_brake_apart(from_counts, to_counts, duration_s, limits, coupled)
    if together:
        violations += _coupled_violations(from_counts, to_counts, duration_s, limits, coupled)
    if violations:
        return tuple(violations)
    ends_ns = begins_ns + duration_ns
    return PermittedStep(
        _SEAL, tuple(from_counts), tuple(to_counts), begins_ns, ends_ns, limits, together
    )


def rests_apart(
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    duration_s: float,
    limits: Sequence[CountLimits],
) -> list[int]:
    """Where each axis comes to rest that brakes by itself from the end of its step, and before goes
    on as long as it does where nobody tells it anything any more."""
    return [
        _rest(start, end, duration_s, one.max_acceleration, one, one.goes_on_s)
        for start, end, one in zip(from_counts, to_counts, limits, strict=True)
    ]


def _may_brake_apart(
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    duration_s: float,
    limits: Sequence[CountLimits],
    coupled: Sequence[CoupledLimit],
) -> bool:
    """Whether coupled limits are kept however far each axis is on its way until it is at rest."""
    if not coupled:
        return True
    rests = rests_apart(from_counts, to_counts, duration_s, limits)
    return all(kept_apart(ranges(one, from_counts), from_counts, rests) for one in coupled)


def _coupled_violations(
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    duration_s: float,
    limits: Sequence[CountLimits],
    coupled: Sequence[CoupledLimit],
) -> list[Violation | CoupledViolation]:
    """What axes that brake together would break, on the way or where they come to rest."""
    velocities = _velocities(from_counts, to_counts, duration_s)
    lasts_s = braking_together_s(velocities, limits)
    rests = [
        at_rest(end, velocity, lasts_s, one.goes_on_s)
        for end, velocity, one in zip(to_counts, velocities, limits, strict=True)
    ]
    found: list[Violation | CoupledViolation] = []
    for axis, (end, rest, one) in enumerate(zip(to_counts, rests, limits, strict=True)):
        if rest > max(one.highest, end):
            found.append(Violation(axis, "highest place of rest", rest, one.highest))
        if rest < min(one.lowest, end):
            found.append(Violation(axis, "lowest place of rest", rest, one.lowest))
    found += [
        CoupledViolation(limit.name) for limit in broken(coupled, from_counts, to_counts, rests)
    ]
    return found


def _violations(
    axis: int,
    start: int,
    end: int,
    measured: int,
    velocity_before: float,
    duration_s: float,
    limits: CountLimits,
) -> list[Violation]:
    """Each limit that this axis' part of the step would break. One count of rounding is allowed."""
    rounding = 1 / duration_s
    velocity = (end - start) / duration_s
    acceleration = abs(velocity - velocity_before) / duration_s
    found = [
        Violation(axis, "32-bit counts", counts, HIGHEST_COUNT)
        for counts in (start, end)
        if not LOWEST_COUNT <= counts <= HIGHEST_COUNT
    ]
    # An axis that is outside its travel may come back, and may not go further out.
    if end > max(limits.highest, start):
        found.append(Violation(axis, "highest position", end, limits.highest))
    if end < min(limits.lowest, start):
        found.append(Violation(axis, "lowest position", end, limits.lowest))
    if not abs(velocity) <= limits.max_velocity + rounding:
        found.append(Violation(axis, "velocity", velocity, limits.max_velocity))
    if not acceleration <= limits.max_acceleration + 2 * rounding / duration_s:
        found.append(Violation(axis, "acceleration", acceleration, limits.max_acceleration))
    if not abs(end - measured) <= limits.max_lag:
        found.append(Violation(axis, "distance from measured", end - measured, limits.max_lag))
    return found
