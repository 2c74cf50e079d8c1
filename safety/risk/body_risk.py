"""Both risks of one way of the actuation vector, and the room round a place: see `RiskSource`.

What decides is contact_risk, swept along the way: the upper limit of how likely any part of the
body touches something. The body_point_risk of the paper, its printed bound, is computed beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil
from typing import Final

import numpy as np

from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel, ContactRisk, most_touching
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import Environment
from safety.risk_source import Clearance, KnownBody, Leaving

_LONGEST_SEGMENT: Final = 0.1
"""In the network's inputs. Between two mixtures shapes are taken to move straight."""
_MOST_SEGMENTS: Final = 20
_FEWER: Final = 5
"""Times fewer shapes tell the room: it is asked for many times, and decides nothing."""
_NO_NEARER_MM: Final = 5.0
"""Where nearly all shapes stay away by so much more than the body is shifted, the shifted ones do
not touch either."""
_NEAR_MM: Final = 10.0
"""Round that nothing is near."""
_SLOPE_STEP: Final = 0.04
"""In the network's inputs, either way, for the slope."""


@dataclass(frozen=True, slots=True, eq=False)
class WayRisk:
    """What is known of one way."""

    contact: ContactRisk
    """Anywhere along it."""
    leaving: Leaving | None
    """Where it leads away from what touches."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """What is told beside the risk that decides, of the body at rest."""

    body_point_risk: float
    """Printed bound (equation 9)."""
    means_mm: FloatArray
    """(K, 3) where the mixture over the body's points has its components."""


class BodyRisk:
    """One body in one environment. Not for several threads.

    Raises ValueError where the grid is not made for so thick a body.
    """

    def __init__(
        self,
        model: RiskModel,
        environment: Environment,
        grid: DistanceGrid,
        samples: int = 1000,
        seed: int = 0,
    ) -> None:
        """samples: shapes that are drawn, the same ones for every question."""
        self._model = model
        self._contact = ContactModel(model.basis, grid, environment.port, samples, seed)
        thicker = model.basis.on_the_safe_side()
        self._fewer = ContactModel(thicker, grid, environment.port, samples // _FEWER, seed)
        self._shifted = ContactModel(model.basis, grid, environment.port, samples, seed)
        self._shift: FloatArray | None = None
        self._shift_mm = 0.0
        self._begin_shifted: tuple[Mixture, Mixture] | None = None
        """Where the last way began, and the same with the shift."""
        self._samples = samples
        self._hardly_proved_mm = 0.5 * grid.error_mm
        self._body_point = BodyPointRisk(environment)
        self._begin: tuple[tuple[float, ...], Mixture] | None = None
        """Where the last way began: the gate asks for several ways from the same place."""

    @property
    def inputs(self) -> int:
        """m, the actuation vector's length."""
        return self._model.inputs

    def take_as_shifted(self, shift: FloatArray | None) -> None:
        """The body was seen to be off from the middle of what it may be: ask for that one too.

        shift: (d,) of its shape's coefficients. What a body is off by stays with it on its next
        steps. None: nothing was seen.
        """
        self._shift, self._shift_mm, self._begin_shifted = shift, 0.0, None
        if shift is not None:
            nodes = np.tensordot(shift, self._model.basis.modes, axes=1)
            self._shift_mm = float(np.linalg.norm(nodes, axis=1).max())

    def of_way(self, u_from: Sequence[float], u_to: Sequence[float]) -> WayRisk | str:
        """The risk of going straight from (m,) to (m,); words where it cannot be told."""
        for u in (u_from, u_to):
            if not self._model.knows(u):
                return f"outside what the model has learned: {_words(u)}"
        mixtures = self._mixtures(u_from, u_to)
        if mixtures is None:
            return f"the model gives no finite answer at {_words(u_to)}"
        contact = self._contact.along(mixtures)
        away_mm = contact.on_the_way.lowest_1_percent_mm
        if self._shift is not None and away_mm < self._shift_mm + _NO_NEARER_MM:
            shifted = self._shifted.along(self._as_seen(mixtures, self._shift))
            if shifted.on_the_way.upper_limit > contact.on_the_way.upper_limit:
                contact = shifted
        return WayRisk(contact.on_the_way, contact.leaving)

    def _as_seen(self, mixtures: list[Mixture], shift: FloatArray) -> list[Mixture]:
        if self._begin_shifted is None or self._begin_shifted[0] is not mixtures[0]:
            self._begin_shifted = (mixtures[0], _moved(mixtures[0], shift))
        return [self._begin_shifted[1], *(_moved(mixture, shift) for mixture in mixtures[1:])]

    def beside(self, u: Sequence[float]) -> Beside | None:
        """At (m,) u; None where it cannot be told."""
        points = self._model.points.mixture(u) if self._model.knows(u) else None
        return None if points is None else Beside(self._body_point.printed(points), points.means_mm)

    def body(self, u: Sequence[float]) -> KnownBody | None:
        """Where the body is expected at (m,) u: the mean over its mixture of shapes, and the
        mixture over its points; None where nothing was learned."""
        if not self._model.knows(u):
            return None
        shapes, points = self._model.shapes.mixture(u), self._model.points.mixture(u)
        if shapes is None or points is None:
            return None
        basis = self._model.basis
        mean = (shapes.weights @ shapes.means_mm).astype(np.float32)
        centreline = basis.base_mm + np.tensordot(mean, basis.modes, axes=1)
        inverse = np.linalg.inv(points.factors_per_mm)
        covariances = inverse @ inverse.transpose(0, 2, 1)
        return KnownBody(
            centreline.tolist(),
            basis.radius_mm.tolist(),
            points.weights.tolist(),
            points.means_mm.tolist(),
            covariances[:, *np.triu_indices(3)].tolist(),
        )

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        """How far the body at rest at (m,) u is from such a risk; None: far, or nobody knows.

        The clearance of the shape that decides: more than so many must not touch, nor be so near
        that they are not proved to be clear. Its slope from differences, of the same draws.
        """
        share = (most_touching(risk, self._samples) + 1) / self._samples
        at = np.asarray(u, np.float64)
        clearance_mm = self._clearance(at, share)
        if clearance_mm is None or clearance_mm > _NEAR_MM:
            return None
        slope = []
        for axis, scale in enumerate(self._model.scale.tolist()):
            ends = []
            for way in (_SLOPE_STEP, -_SLOPE_STEP):
                there = at.copy()
                there[axis] += way / scale
                ends.append(self._clearance(there, share))
            up, down = ends
            if up is None or down is None:
                return None
            slope.append((up - down) * scale / (2.0 * _SLOPE_STEP))
        return Clearance(tuple(at.tolist()), clearance_mm, tuple(slope))

    def _clearance(self, u: FloatArray, share: float) -> float | None:
        mixture = self._model.shapes.mixture(u)
        if mixture is None:
            return None
        clearance_mm = self._fewer.clearance_mm(mixture, share)
        if self._shift is not None and clearance_mm < self._shift_mm + _NEAR_MM:
            shifted = _moved(mixture, self._shift)
            clearance_mm = min(clearance_mm, self._fewer.clearance_mm(shifted, share))
        return clearance_mm - self._hardly_proved_mm

    def _mixtures(self, u_from: Sequence[float], u_to: Sequence[float]) -> list[Mixture] | None:
        """Over the shape's coefficients, along the way."""
        begin, end = np.asarray(u_from, np.float64), np.asarray(u_to, np.float64)
        first = self._first(tuple(u_from))
        length = float(np.linalg.norm((end - begin) * self._model.scale))
        segments = min(max(1, ceil(length / _LONGEST_SEGMENT)), _MOST_SEGMENTS)
        shares = [k / segments for k in range(1, segments + 1)]
        along = [self._model.shapes.mixture(begin + share * (end - begin)) for share in shares]
        mixtures = [mixture for mixture in (first, *along) if mixture is not None]
        return mixtures if len(mixtures) == 1 + segments else None

    def _first(self, u_from: tuple[float, ...]) -> Mixture | None:
        if self._begin is not None and self._begin[0] == u_from:
            return self._begin[1]
        mixture = self._model.shapes.mixture(u_from)
        self._begin = None if mixture is None else (u_from, mixture)
        return mixture


def _moved(mixture: Mixture, shift: FloatArray) -> Mixture:
    return Mixture(mixture.weights, mixture.means_mm + shift, mixture.factors_per_mm)


def _words(u: Sequence[float]) -> str:
    return "u = (" + ", ".join(f"{value:.4g}" for value in u) + ")"
