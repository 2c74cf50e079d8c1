"""From what a hand does to where the tip is asked to be: dead-man, clutch, scale.

While the dead-man's key is held the target moves as the hand does; while the clutch's key is held
too, the target stays and the hand may come back: where it then is counts from there on. Whenever
the dead-man is pressed the target begins where the tip is measured to be, so that nothing jumps.
Let go, unplugged or without a tip there is no target at all: nothing is sent, and the daemon holds
when the last set-point is too old. The target never leads the tip by more than a leash.

Nothing here knows of devices, clocks or networks: what goes in again comes out again, to the last
bit.
"""

from dataclasses import dataclass, field
from math import cos, hypot, isfinite, pi, sin, sqrt
from typing import Final, NamedTuple

Triple = tuple[float, float, float]

_LONGEST_STEP_S: Final = 0.1
"""Between two targets: what a stalled program has missed is not made up for."""
_TIP_OLD_S: Final = 0.5
_REMEMBERED: Final = 128
"""Targets that may still be refused."""
_WALL_NS: Final = 3_000_000_000
"""The daemon says again after half a second that it refuses what it has refused before."""
_ZERO: Final = (0.0, 0.0, 0.0)
_SIGNED: Final = {"+": 1.0, "-": -1.0}


@dataclass(frozen=True)
class HandSettings:
    """How a hand's motions become the tip's."""

    speed_mm_s: float = 10.0
    """Of the target, of a device that is pushed all the way."""
    turn_rad_s: float = 0.3
    """The same of its direction."""
    scale: float = 0.2
    """Way of the target against the way of the hand, of a device that is moved."""
    rad_per_mm: float = 0.005
    """Turn of the target against the way of the hand about an axis."""
    leash_mm: float = 8.0
    leash_rad: float = 0.25
    axes: str = "+x+y+z"
    """Of the base frame: where the hand's right, away and up lead."""
    pointing: bool = False
    """Whether the tip's direction is steered, too."""

    def __post_init__(self) -> None:
        numbers = [self.speed_mm_s, self.turn_rad_s, self.scale, self.rad_per_mm]
        numbers += [self.leash_mm, self.leash_rad]
        if not all(isfinite(number) and number > 0.0 for number in numbers):
            raise ValueError("speeds, scales and leashes of a hand are finite and more than 0")
        if not self.leash_rad < pi / 2.0:
            raise ValueError("a direction that leads by a right angle is no lead")
        self.turned(_ZERO)

    def turned(self, vector: Triple) -> Triple:
        """A hand's (3,) in the base frame. Raises ValueError where the axes are none."""
        letters, found = self.axes[1::2], [0.0, 0.0, 0.0]
        if len(self.axes) != 6 or sorted(letters) != ["x", "y", "z"]:
            raise ValueError(f"axes are such as +x+y+z or -y+x+z, not {self.axes!r}")
        for sign, letter, value in zip(self.axes[::2], letters, vector, strict=True):
            if sign not in _SIGNED:
                raise ValueError(f"axes are such as +x+y+z or -y+x+z, not {self.axes!r}")
            found["xyz".index(letter)] = _SIGNED[sign] * value
        return found[0], found[1], found[2]


class Target(NamedTuple):
    """Where the tip is asked to be.

    sequence: from 1 on. direction: of unit length; None: it is not steered.
    """

    sequence: int
    position_mm: Triple
    direction: Triple | None


class _Tip(NamedTuple):
    t_ns: int
    position_mm: Triple
    direction: Triple | None


class _Wall(NamedTuple):
    """Where targets were refused: none goes beyond, for a while."""

    place_mm: Triple
    outwards: Triple
    """Of unit length."""
    until_ns: int

    def kept(self, place: Triple) -> Triple:
        beyond = _dot(_sum(place, _times(-1.0, self.place_mm)), self.outwards)
        return place if beyond <= 0.0 else _sum(place, _times(-beyond, self.outwards))


@dataclass
class Hand:
    """One hand on one device, from when it is taken until it is let go."""

    settings: HandSettings
    _tip: _Tip | None = None
    _position: Triple | None = None
    """None: there is no target."""
    _direction: Triple | None = None
    _sequence: int = 0
    _advanced_ns: int | None = None
    _moved: list[float] = field(default_factory=lambda: [0.0] * 6)
    """By the hand, since the last target."""
    _past: dict[int, tuple[Triple, Triple | None]] = field(default_factory=dict)
    """Targets by their numbers."""
    _walls: list[_Wall] = field(default_factory=list)

    def tip(self, t_ns: int, position_mm: Triple, direction: Triple | None) -> None:
        """The tip was measured."""
        if all(map(isfinite, (*position_mm, *(direction or ())))):
            self._tip = _Tip(t_ns, position_mm, direction)

    def moved(self, by: tuple[float, ...]) -> None:
        """(6,) mm by which the hand was moved."""
        self._moved = [before + more for before, more in zip(self._moved, by, strict=True)]

    def refused(self, sequence: int) -> None:
        """The daemon does not follow a target, and does not say so of each that comes after it.

        The target goes back to the one before, and for a while no further that way: so the robot
        stands at the end of its workspace, and is not held for want of what it may follow.
        """
        before, wrong = self._past.get(sequence - 1), self._past.get(sequence)
        if before is None or wrong is None or self._position is None:
            return
        self._position, self._direction = before
        self._past = {number: one for number, one in self._past.items() if number < sequence}
        way = _sum(wrong[0], _times(-1.0, before[0]))
        if (far := _length(way)) > 0.0:
            until_ns = (self._advanced_ns or 0) + _WALL_NS
            self._walls.append(_Wall(before[0], _times(1.0 / far, way), until_ns))

    def advance(
        self, t_ns: int, dead_man: bool, clutch: bool, rates: tuple[float, ...]
    ) -> Target | None:
        """What is to be asked for now; None: nothing.

        rates: (6,) from -1 to 1, how far the device is pushed.
        """
        last_ns, self._advanced_ns = self._advanced_ns, t_ns
        moved, self._moved = tuple(self._moved), [0.0] * 6
        tip = self._tip
        if tip is None or not dead_man or (t_ns - tip.t_ns) * 1e-9 > _TIP_OLD_S:
            self._position, self._direction = None, None
            self._past.clear()
            self._walls.clear()
            return None
        self._walls = [wall for wall in self._walls if t_ns < wall.until_ns]
        if self._position is None:
            self._position, self._direction = tip.position_mm, tip.direction
        elif not clutch:
            dt_s = min(max(0.0, (t_ns - (last_ns or t_ns)) * 1e-9), _LONGEST_STEP_S)
            self._go(tip, rates, moved, dt_s)
        self._sequence += 1
        self._past[self._sequence] = self._position, self._direction
        self._past.pop(self._sequence - _REMEMBERED, None)
        direction = self._direction if self.settings.pointing else None
        return Target(self._sequence, self._position, direction)

    def _go(
        self, tip: _Tip, rates: tuple[float, ...], moved: tuple[float, ...], dt_s: float
    ) -> None:
        assert self._position is not None
        settings = self.settings
        far, turn = settings.speed_mm_s * dt_s, settings.turn_rad_s * dt_s
        ways = [far * r + settings.scale * m for r, m in zip(rates[:3], moved[:3], strict=True)]
        turns = [
            turn * r + settings.rad_per_mm * m for r, m in zip(rates[3:], moved[3:], strict=True)
        ]
        way = settings.turned((ways[0], ways[1], ways[2]))
        place = _leashed(_sum(self._position, way), tip.position_mm, settings.leash_mm)
        for wall in self._walls:
            place = wall.kept(place)
        self._position = place
        if self._direction is not None and tip.direction is not None:
            about = settings.turned((turns[0], turns[1], turns[2]))
            turned = _rotated(self._direction, about)
            self._direction = _near(turned, tip.direction, settings.leash_rad)


# Vectors of three, as plain numbers.


def _sum(a: Triple, b: Triple) -> Triple:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _times(factor: float, a: Triple) -> Triple:
    return factor * a[0], factor * a[1], factor * a[2]


def _dot(a: Triple, b: Triple) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Triple, b: Triple) -> Triple:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def _length(a: Triple) -> float:
    return sqrt(_dot(a, a))


def _leashed(place: Triple, anchor: Triple, most: float) -> Triple:
    """The place, or what of it is no farther from the anchor."""
    away = (place[0] - anchor[0], place[1] - anchor[1], place[2] - anchor[2])
    far = _length(away)
    return place if far <= most else _sum(anchor, _times(most / far, away))


def _rotated(direction: Triple, about: Triple) -> Triple:
    """A unit vector, turned by the length of `about`, about it (Rodrigues)."""
    angle = _length(about)
    if angle == 0.0:
        return direction
    axis = _times(1.0 / angle, about)
    along = _times(_dot(axis, direction) * (1.0 - cos(angle)), axis)
    across = _times(sin(angle), _cross(axis, direction))
    found = _sum(_sum(_times(cos(angle), direction), across), along)
    return _times(1.0 / _length(found), found)


def _near(direction: Triple, anchor: Triple, most_rad: float) -> Triple:
    """The direction, or the one on the way there that is no farther from the anchor."""
    aligned, across = _dot(anchor, direction), _cross(anchor, direction)
    apart = _length(across)
    if aligned > 0.0 and apart <= sin(most_rad):
        return direction
    if apart == 0.0:  # the other way round: no way there is shorter than another
        return anchor
    return _rotated(anchor, _times(most_rad / apart, across))


def direction_of(quaternion: tuple[float, float, float, float]) -> Triple | None:
    """Where the z axis of a frame points, whose quaternion has its scalar first; None: nowhere."""
    w, x, y, z = quaternion
    length = hypot(w, x, y, z)
    if not (isfinite(length) and length > 0.0):
        return None
    w, x, y, z = w / length, x / length, y / length, z / length
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)
