"""A learnt pose model in a robot's own axes: where its tip is and points, and how that answers.

The model knows what shapes the body. What moves it as a whole, roll about the base's z axis and
insertion along it, is applied as what it is (Fagogenis, Bergeles and Dupont, IROS 2016, eq. 1).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, hypot, sin
from typing import Any, Final, NamedTuple, Self

import numpy as np

from daemon.learning.forward.pose_model import NO_DIRECTION, PoseOfTip
from daemon.learning.lwpr.model import FloatArray, Lwpr, with_corrections
from drivers.pose import Vector

_BESIDE: Final = 3
"""Rows of the position; those of the direction follow."""
_KNOWN_ABOVE: Final = 0.01
"""Largest weight of a field without which the model knows nothing of a place."""


@dataclass(frozen=True)
class BodyCoordinates:
    """What of m axes shapes a body, in q numbers, and what moves it as a whole."""

    shaping: FloatArray
    """(q, m) with which an actuation u makes the model's numbers, and ..."""
    offset: FloatArray
    """... (q,) what is added."""
    roll: FloatArray
    """(m,) with which u makes the roll about z, rad."""
    insertion: FloatArray
    """(m,) with which u makes the way along z, mm."""

    def __post_init__(self) -> None:
        q, m = self.shaping.shape
        if self.offset.shape != (q,) or self.roll.shape != (m,) or self.insertion.shape != (m,):
            raise ValueError(f"coordinates of {m} axes and {q} numbers do not fit each other")

    @property
    def axes(self) -> int:
        """m."""
        return len(self.roll)

    def through(self, matrix: FloatArray, offset: FloatArray) -> "BodyCoordinates":
        """The same of another actuation v, where u = matrix v + offset; roll and insertion of the
        offset are no part of it."""
        return BodyCoordinates(
            self.shaping @ matrix,
            self.offset + self.shaping @ offset,
            self.roll @ matrix,
            self.insertion @ matrix,
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {name: value.tolist() for name, value in vars(self).items()}

    @classmethod
    def from_dict(cls, mapping: Mapping[str, Any]) -> Self:
        """What `to_dict` gave. Raises KeyError, TypeError, ValueError."""
        names = ("shaping", "offset", "roll", "insertion")
        arrays = {name: np.array(mapping[name], dtype=np.float64) for name in names}
        if arrays["shaping"].ndim != 2 or not all(np.isfinite(a).all() for a in arrays.values()):
            raise ValueError("coordinates are finite numbers, and their matrix has rows")
        return cls(**arrays)


class PoseAnswer(NamedTuple):
    """position_mm (3,) and direction (3,) in the base's frame; jacobian (6, m): mm per mm or rad,
    then 1 per mm or rad of the direction, without the part along it."""

    position_mm: Vector
    direction: Vector
    jacobian: Vector


class PoseKinematics:
    """Poses and Jacobians of a regression with six outputs, at actuations (m,)."""

    def __init__(self, lwpr: Lwpr, coordinates: BodyCoordinates) -> None:
        self.lwpr = lwpr
        self._coordinates = coordinates

    def known(self, u: Vector) -> bool:
        """Whether the model has learnt anything there."""
        return self.lwpr.activation(self.configuration(u)) > _KNOWN_ABOVE

    def configuration(self, u: Vector) -> Vector:
        """(q,) the model's numbers."""
        return np.asarray(self._coordinates.shaping @ u + self._coordinates.offset)

    def pose(self, u: Vector) -> PoseOfTip:
        """Not a number where the model does not know the direction."""
        said = self.lwpr.predict(self.configuration(u))
        length = hypot(*said[_BESIDE:].tolist())
        if length < NO_DIRECTION:
            return PoseOfTip(np.full(3, np.nan), np.full(3, np.nan))
        turn, lift = self._carried(u)
        return PoseOfTip(turn @ said[:_BESIDE] + lift, turn @ said[_BESIDE:] / length)

    def answer(self, u: Vector) -> PoseAnswer:
        """Pose and Jacobian; not a number where the model does not know the direction."""
        coordinates, configuration = self._coordinates, self.configuration(u)
        said = self.lwpr.predict(configuration)
        length = hypot(*said[_BESIDE:].tolist())
        if length < NO_DIRECTION:
            nothing = np.full(3, np.nan)
            return PoseAnswer(nothing, nothing, np.full((6, len(u)), np.nan))
        turn, lift = self._carried(u)
        position_mm = turn @ said[:_BESIDE]
        direction = turn @ said[_BESIDE:] / length
        slopes = self.lwpr.slopes(configuration) @ coordinates.shaping
        jacobian = np.vstack([turn @ slopes[:_BESIDE], turn @ slopes[_BESIDE:] / length])
        jacobian[_BESIDE:] -= np.outer(direction, direction @ jacobian[_BESIDE:])
        jacobian[:_BESIDE] += np.outer(_about_z(position_mm), coordinates.roll)
        jacobian[_BESIDE:] += np.outer(_about_z(direction), coordinates.roll)
        jacobian[2] += coordinates.insertion
        return PoseAnswer(position_mm + lift, direction, jacobian)

    def learn(self, u: Vector, position_mm: Vector, direction: Vector) -> None:
        """Take (3,) mm and (3,) unit vector, as they were seen in the base's frame."""
        turn, lift = self._carried(u)
        seen = np.concatenate([turn.T @ (position_mm - lift), turn.T @ direction])
        self.lwpr.update(self.configuration(u), seen)

    def _carried(self, u: Vector) -> tuple[Vector, Vector]:
        """(3, 3) turn and (3,) mm by which the body is moved as a whole."""
        roll = float(self._coordinates.roll @ u)
        c, s = cos(roll), sin(roll)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return turn, np.array([0.0, 0.0, float(self._coordinates.insertion @ u)])


def _about_z(vector: Vector) -> Vector:
    """(3,) how a turn about z moves it, per rad."""
    return np.array([-vector[1], vector[0], 0.0])


class PoseAdaptation:
    """Lets a pose model go on learning while it is used, where the axes have moved.

    A model that has seen half a million samples would hardly move any more: its fields learn anew
    what is to be added to what they say, believe no more than a few samples would tell, and forget
    by how much a sample weighs in them.
    """

    def __init__(
        self, kinematics: PoseKinematics, travel: Vector, memory: float, tip_mm: float, share: float
    ) -> None:
        """memory: samples that a field remembers. tip_mm, share: how far tip or axes, in shares of
        their travel (m,), go between two samples."""
        kinematics.lwpr = with_corrections(kinematics.lwpr, memory, _KEPT_S2)
        self.samples = 0
        self._kinematics = kinematics
        self._travel = travel
        self._tip_mm, self._share = tip_mm, share
        self._last: tuple[Vector, Vector] | None = None

    def break_off(self) -> None:
        """What comes next does not go on from here."""
        self._last = None

    def see(self, u: Vector, tip_mm: Vector, direction: Vector) -> None:
        """Take a frame."""
        if not (
            np.isfinite(u).all() and np.isfinite(tip_mm).all() and np.isfinite(direction).all()
        ):
            return
        if self._last is not None:
            moved_mm = hypot(*(tip_mm - self._last[1]).tolist())
            moved = hypot(*((u - self._last[0]) / self._travel).tolist())
            # A tip that jitters has not moved: the axes say so.
            if moved < self._share and (moved_mm < self._tip_mm or moved < _JITTER * self._share):
                return
        self._last = u, tip_mm
        if self._kinematics.known(u):
            self._kinematics.learn(u, tip_mm, direction)
            self.samples += 1


_JITTER: Final = 0.1
_KEPT_S2: Final = 1e-3
"""A path shows a field one direction or two. Chosen with a body that is 4 mm off: less, and the
slopes along the others wander (without it by 40 mm beside the path); ten times as much halves what
is learnt on the path."""
