"""Motion profiles: pieces of constant acceleration, as a drive's own generator makes them."""

from math import copysign, inf, sqrt
from typing import NamedTuple


class Piece(NamedTuple):
    """`duration_s` from `velocity` on, with `acceleration`. Any one unit of length, and s."""

    duration_s: float
    velocity: float
    acceleration: float

    @property
    def distance(self) -> float:
        """How far it goes."""
        return (self.velocity + self.acceleration * self.duration_s / 2) * self.duration_s


def stop(velocity: float, deceleration: float) -> list[Piece]:
    """Brake to a standstill."""
    if velocity == 0.0:
        return []
    return [Piece(abs(velocity) / deceleration, velocity, -copysign(deceleration, velocity))]


def change_velocity(
    velocity: float, target: float, acceleration: float, deceleration: float
) -> list[Piece]:
    """Reach another velocity, and keep it for ever."""
    pieces = []
    if velocity * target < 0.0 or target == 0.0:
        pieces = stop(velocity, deceleration)
        velocity = 0.0
    if velocity != target:
        faster = abs(target) > abs(velocity)
        rate = copysign(acceleration if faster else deceleration, target - velocity)
        pieces.append(Piece((target - velocity) / rate, velocity, rate))
    if target:
        pieces.append(Piece(inf, target, 0.0))
    return pieces


def move(
    distance: float, velocity: float, max_velocity: float, acceleration: float, deceleration: float
) -> list[Piece]:
    """Go `distance` from here and stand still there, as fast as allowed.

    Where braking alone would carry too far, or goes the wrong way, it stops first and comes back.
    """
    braking = velocity * abs(velocity) / (2 * deceleration)
    if velocity * distance < 0.0 or abs(braking) > abs(distance):
        rest = move(distance - braking, 0.0, max_velocity, acceleration, deceleration)
        return [*stop(velocity, deceleration), *rest]
    if distance == 0.0:
        return []
    speed, length = abs(velocity), abs(distance)
    rise = deceleration if speed > max_velocity else acceleration
    peak = max_velocity
    if speed <= max_velocity:
        highest = 2 * acceleration * deceleration * length + deceleration * speed * speed
        peak = min(max_velocity, sqrt(highest / (acceleration + deceleration)))
    peak = max(peak, speed) if speed <= max_velocity else max_velocity
    rising = abs(peak * peak - speed * speed) / (2 * rise)
    cruising = max(0.0, length - rising - peak * peak / (2 * deceleration))
    pieces = []
    if peak != speed:
        change = copysign(rise, peak - speed)
        pieces.append(Piece(abs(peak - speed) / rise, speed, change))
    if cruising > 0.0:
        pieces.append(Piece(cruising / peak, peak, 0.0))
    pieces.append(Piece(peak / deceleration, peak, -deceleration))
    if distance > 0.0:
        return pieces
    return [Piece(piece.duration_s, -piece.velocity, -piece.acceleration) for piece in pieces]
