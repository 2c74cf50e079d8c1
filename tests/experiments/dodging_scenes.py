"""What stands where beside which body, for `dodging`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.workbench.body_model.evaluation.shapes import ball, box
from safety.risk.surroundings.environment import Mesh
from tests import SOFT_ARM
from tests.daemon.service.grazing import BROYDEN, TENDON_ARM, TUBES, TUBES_CIRCLE

Floats = NDArray[np.float64]

PARTS: Final = {"tip": 1.0, "middle": 0.6, "base": 0.4}
"""Where along the body something stands, as a share of its length."""
INTO_MM: Final = {"soft": 4.0, "tendon": 3.0, "tubes": 1.0}
"""How far it reaches into where the body would be, at most: more than what a body may be off by."""
HOME_MM: Final = {"soft": 8.0, "tendon": 5.0, "tubes": 3.0}
"""At least so far it stays from where the body is armed, which is refused otherwise."""
KINDS: Final = ("ball", "slab", "slot", "two balls")


@dataclass(frozen=True)
class Subject:
    """A robot that goes round a circle."""

    file: Path
    model: str
    controller: dict[str, Any]
    circle: dict[str, Any]


SUBJECTS: Final = {
    "soft": Subject(
        SOFT_ARM,
        "builtin:soft_arm.npz",
        {"kind": "broyden"},
        {"kind": "circle", "center_mm": [0.0, 0.0, 187.0], "radius_mm": 30.0},
    ),
    "tendon": Subject(
        TENDON_ARM,
        "builtin:tendon_arm.npz",
        BROYDEN,
        {"kind": "circle", "center_mm": [0.0, 0.0, 197.5], "radius_mm": 25.0},
    ),
    "tubes": Subject(TUBES, "builtin:concentric_tubes.npz", {"kind": "broyden"}, {**TUBES_CIRCLE}),
}


@dataclass(frozen=True)
class Scene:
    """What stands where."""

    robot: str
    kind: str
    part: str
    seed: int

    @property
    def name(self) -> str:
        return f"{self.robot}, {self.kind} beside the {self.part}, seed {self.seed}"


@dataclass(frozen=True)
class Solid:
    """A ball, or a box along the columns of `turn`."""

    centre_mm: Floats
    half_mm: Floats
    """(1,) the ball's radius, (3,) of the box."""
    turn: Floats

    def mesh(self) -> Mesh:
        if self.half_mm.size == 1:
            return ball(float(self.half_mm[0]), self.centre_mm.tolist(), 2000)
        made = box((2.0 * self.half_mm).tolist(), (0.0, 0.0, 0.0), 6)
        return Mesh(made.vertices_mm @ self.turn.T + self.centre_mm, made.triangles)

    def distance_mm(self, places: Floats) -> float:
        """Least of (n, 3) places from its surface, negative inside."""
        away = places - self.centre_mm
        if self.half_mm.size == 1:
            return float(np.linalg.norm(away, axis=1).min() - self.half_mm[0])
        beyond = np.abs(away @ self.turn) - self.half_mm
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return float((outside + np.minimum(beyond.max(axis=1), 0.0)).min())


class Stands(NamedTuple):
    """Beside a place of the body. turn: its columns lead out, aside and along the body."""

    place: Floats
    turn: Floats
    thick_mm: float

    def solids(self, kind: str, into_mm: float, behind_mm: float) -> list[Solid]:
        out, aside, _ = self.turn.T
        if kind == "ball":
            return [self._ball(out, into_mm)]
        if kind == "slab":
            return [self._slab(out, into_mm)]
        if kind == "slot":  # the other wall stands as far behind as the body needs to start
            return [self._slab(out, into_mm), self._slab(-out, -behind_mm)]
        return [
            self._ball(np.cos(lean) * out + np.sin(lean) * aside, into_mm) for lean in (0.9, -0.9)
        ]

    def _ball(self, way: Floats, into_mm: float) -> Solid:
        size_mm = 8.0 if self.thick_mm < 5.0 else 12.0
        centre = self.place + (self.thick_mm + size_mm - into_mm) * way
        return Solid(centre, np.array([size_mm]), self.turn)

    def _slab(self, way: Floats, into_mm: float) -> Solid:
        centre = self.place + (self.thick_mm + 3.0 - into_mm) * way
        return Solid(centre, np.array([3.0, 20.0, 8.0]), self.turn)
