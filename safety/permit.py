"""The permit to move: the only thing that the drives' writer takes, and only the gate gives it.

A permit is a straight motion of all axes within a time. Its last check, on the integers that will
be sent, is made here, whatever the gate has computed before.
"""

from collections.abc import Sequence
from typing import final

from safety.limits import CountLimits, Violation

_SEAL = object()


@final
class PermittedStep:
    """Targets for all axes, in counts, evenly reached between `begins_ns` and `ends_ns`."""

    __slots__ = ("begins_ns", "ends_ns", "from_counts", "to_counts")

    def __init__(
        self,
        seal: object,
        from_counts: tuple[int, ...],
        to_counts: tuple[int, ...],
        begins_ns: int,
        ends_ns: int,
    ) -> None:
        if seal is not _SEAL:
            raise TypeError("only the gate permits a step")
        self.from_counts = from_counts
        self.to_counts = to_counts
        self.begins_ns = begins_ns
        self.ends_ns = ends_ns

    def target(self, axis: int, t_ns: int) -> int:
        """Where `axis` is meant to be at `t_ns`; at the end of the step from its end on."""
        start, end = self.from_counts[axis], self.to_counts[axis]
        if t_ns >= self.ends_ns:
            return end
        if t_ns <= self.begins_ns:
            return start
        return start + (end - start) * (t_ns - self.begins_ns) // (self.ends_ns - self.begins_ns)

    def targets(self, t_ns: int) -> tuple[int, ...]:
        """Where all axes are meant to be at `t_ns`."""
        return tuple([self.target(axis, t_ns) for axis in range(len(self.to_counts))])

    def velocity(self, axis: int, t_ns: int) -> int:
        """How fast `axis` is meant to move at `t_ns`, counts/s."""
        if not self.begins_ns <= t_ns < self.ends_ns:
            return 0
        change = self.to_counts[axis] - self.from_counts[axis]
        return change * 1_000_000_000 // (self.ends_ns - self.begins_ns)


@final
class PermittedHoming:
    """Leave for one drive to look for its zero by itself, moving as it was set up to."""

    __slots__ = ("axis",)

    def __init__(self, seal: object, axis: int) -> None:
        if seal is not _SEAL:
            raise TypeError("only the gate permits homing")
        self.axis = axis


def permit_homing(axis: int) -> PermittedHoming:
    """For the gate alone, like `permit`: the drive moves while nobody checks its targets."""
    return PermittedHoming(_SEAL, axis)


def permit(
    *,
    from_counts: Sequence[int],
    to_counts: Sequence[int],
    measured_counts: Sequence[int],
    velocities_before: Sequence[float],
    begins_ns: int,
    duration_ns: int,
    limits: Sequence[CountLimits],
) -> PermittedStep | tuple[Violation, ...]:
    """The last check. For the gate alone: everything else gets its permits from there.

    from_counts, to_counts, measured_counts, limits: one per axis. velocities_before: counts/s that
    each axis was last told to have. Raises ValueError where the numbers do not fit together.
    """
    count = len(limits)
    if not len(from_counts) == len(to_counts) == len(measured_counts) == count:
        raise ValueError("a step needs one start, one end and one measurement per axis")
    if len(velocities_before) != count or duration_ns <= 0:
        raise ValueError("a step needs one velocity per axis and a positive duration")
    if not set(map(type, (*from_counts, *to_counts, *measured_counts))) <= {int}:
        raise ValueError("a step is made of whole counts")
    violations = [
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
    if violations:
        return tuple(violations)
    return PermittedStep(
        _SEAL, tuple(from_counts), tuple(to_counts), begins_ns, begins_ns + duration_ns
    )


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
    found = []
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
