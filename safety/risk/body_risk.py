"""Both risks of one way of the actuation vector, and the room round a place: see `RiskSource`.

What decides is contact_risk, swept along the way: the upper limit of how likely any part of the
body touches something. The body_point_risk of the paper, its printed bound, is computed beside it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import ContactRisk, PathContactRisk, most_touching
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel
from safety.risk.moving_obstacles import Swept
from safety.risk.part_kernels import PartSlopes
from safety.risk.seen_tip import FEWER, GivenTip, SeenTip, TipConditioning
from safety.risk.shape_kernels import farthest_mm
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import Environment
from safety.risk.way_contact import WayContact
from safety.risk_source import (
    GIVEN_TIP,
    MODEL,
    SHIFTED,
    Clearance,
    KnownBody,
    Leaving,
    PartClearance,
    RiskAnswers,
)

_LONGEST_SEGMENT: Final = 0.1
"""In the network's inputs. Between two mixtures shapes are taken to move straight."""
_MOST_SEGMENTS: Final = 20
_NO_NEARER_MM: Final = 5.0
"""Where nearly all shapes stay away by so much more than the body is shifted, the shifted ones do
not touch either."""
_NEAR_MM: Final = 10.0
"""Round that nothing is near."""
_SLOPE_STEP: Final = 0.04
"""In the network's inputs, either way, for the slope."""
_PARTS: Final = 6
"""Of the body, along it: enough that one of an arm that bends twice does not hide another."""


@dataclass(frozen=True, slots=True, eq=False)
class WayRisk:
    """What is known of one way."""

    contact: ContactRisk
    """Anywhere along it."""
    leaving: Leaving | None
    """Where it leads away from what touches."""
    answers: RiskAnswers
    """Of which the contact is one."""
    touching: NDArray[np.bool_]
    """(S,) which draws are not proved to be clear on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Beside:
    """What is told beside the risk that decides, of the body at rest."""

    body_point_risk: float
    """Printed bound (equation 9)."""
    means_mm: FloatArray
    """(K, 3) where the mixture over the body's points has its components."""


class Sight(NamedTuple):
    """What is seen of a body."""

    shift: FloatArray | None
    tip: SeenTip | None


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
        given: TipConditioning | None = None,
    ) -> None:
        """samples: shapes that are drawn, the same ones for every question. given: what makes of
        them those that agree with a measured tip; None: nothing does."""
        self.grid = grid
        self._model = model
        self._seed = seed
        self._contact = WayContact(model.basis, grid, environment.port, samples, seed)
        thicker = model.basis.on_the_safe_side()
        self._fewer = ContactModel(thicker, grid, environment.port, samples // FEWER, seed)
        self._shifted = WayContact(model.basis, grid, environment.port, samples, seed)
        around = grid, environment.port, samples, seed
        self._given = None if given is None else GivenTip(given, model.basis, *around)
        self._model_limit: float | None = None
        """Of the body at rest where its room was last told."""
        self._shift: FloatArray | None = None
        self._shift_mm = 0.0
        self._begin_shifted: tuple[Mixture, Mixture] | None = None
        """Where the last way began, and the same with the shift."""
        ends = np.linspace(0, model.basis.nodes, min(_PARTS, model.basis.nodes) + 1)
        self._part_ends = ends.round().astype(np.int64)
        self._samples = samples
        # More than proofs lose, so that a step is turned aside before it would be refused.
        self._hardly_proved_mm = 0.5 * grid.error_mm
        self._body_point = BodyPointRisk(environment)
        self._begin: tuple[tuple[float, ...], Mixture] | None = None
        """Where the last way began: the gate asks for several ways from the same place."""

    def take_moving(self, swept: Swept) -> None:
        """Count with what moves, too, from now on."""
        for contact in (self._contact, self._fewer, self._shifted):
            contact.take_moving(swept)
        if self._given is not None:
            self._given.take_moving(swept)

    def among(self, environment: Environment, grid: DistanceGrid) -> "BodyRisk":
        """The same body, and the same draws of it, in another environment. Raises ValueError."""
        given = None if self._given is None else self._given.conditioning
        return BodyRisk(self._model, environment, grid, self._samples, self._seed, given)

    @property
    def model(self) -> RiskModel:
        """Of the body."""
        return self._model

    @property
    def samples(self) -> int:
        """S, the shapes that are drawn."""
        return self._samples

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
            self._shift_mm = float(farthest_mm(self._model.basis.modes, shift))
        for contact in (self._contact.all_draws, self._fewer):
            contact.look_as_far_as(self._shift_mm + _NEAR_MM)

    def see(
        self, mixture: Mixture, place_mm: FloatArray, direction: FloatArray | None, agrees: bool
    ) -> None:
        """A (3,) tip was measured, pointing along (3,), where the model has this mixture: tell the
        risk given that. agrees: the model has nothing against it."""
        if self._given is not None:
            self._given.see(mixture, place_mm, direction, agrees)

    @property
    def sight(self) -> Sight:
        """What was seen of the body, for another one of the same body."""
        return Sight(self._shift, None if self._given is None else self._given.seen)

    def see_as(self, sight: Sight) -> None:
        """What another one has seen of the body."""
        self.take_as_shifted(sight.shift)
        if self._given is not None:
            self._given.take(sight.tip)

    def forget_tip(self) -> None:
        """What was seen is too old: tell the risk of what the model knows by itself."""
        if self._given is not None:
            self._given.take(None)

    def of_way(self, u_from: Sequence[float], u_to: Sequence[float]) -> WayRisk | str:
        """The risk of going straight from (m,) to (m,); words where it cannot be told."""
        for u in (u_from, u_to):
            if not self._model.knows(u):
                return f"outside what the model has learned: {_words(u)}"
        mixtures = self._mixtures(u_from, u_to)
        if mixtures is None:
            return f"the model gives no finite answer at {_words(u_to)}"
        decides = self._decides
        given = None if decides is None else decides.along(mixtures)
        if given is not None:
            limit = given.on_the_way.upper_limit
            return _way_risk(given, RiskAnswers(self._model_limit, limit, GIVEN_TIP))
        alone = self._contact.along(mixtures)
        told = {MODEL: alone}
        if alone.on_the_way.lowest_1_percent_mm < self._shift_mm + _NO_NEARER_MM:
            told |= self._of_body_as_seen(mixtures)
        by = max(told, key=lambda one: told[one].on_the_way.upper_limit)
        limits = {one: path.on_the_way.upper_limit for one, path in told.items()}
        return _way_risk(told[by], RiskAnswers(limits[MODEL], limits.get(GIVEN_TIP), by))

    def _of_body_as_seen(self, mixtures: list[Mixture]) -> dict[str, PathContactRisk]:
        """Given its tip, and as much off everywhere as it is seen to be: where the model has
        something against that tip, or there is no such answer."""
        told = {}
        given = None if self._given is None else self._given.along(mixtures)
        if given is not None:
            told[GIVEN_TIP] = given
        if self._shift is not None:
            told[SHIFTED] = self._shifted.along(self._as_seen(mixtures, self._shift))
        return told

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
        alone = self._model.shapes.mixture(at)
        self._tell_beside(alone)
        here = self._as_told(alone)
        if here is None:
            return None
        clearance_mm, nearest = self._clearance(here, share)
        if clearance_mm > _NEAR_MM:
            return None
        moving = self._drawn.near_moving(nearest)
        parts = self._drawn.part_slopes(nearest, share, self._part_ends, _NEAR_MM)
        slope, changes, tip_slope = [], [], []
        for axis, scale in enumerate(self._model.scale.tolist()):
            ends = self._beside(at, axis, _SLOPE_STEP / scale)
            if ends is None:
                return None
            per_unit = scale / (2.0 * _SLOPE_STEP)
            up, down = ends
            more, less = self._clearance(up, share)[0], self._clearance(down, share)[0]
            slope.append((more - less) * per_unit)
            changes.append(_change(up, down) * per_unit)
            tip_slope.append((self._tip(up) - self._tip(down)) * per_unit)
        return Clearance(
            tuple(at.tolist()),
            clearance_mm,
            tuple(slope),
            () if moving else self._parts(parts, np.array(changes), clearance_mm),
            tuple(map(tuple, np.array(tip_slope).T.tolist())),
        )

    def _tell_beside(self, alone: Mixture | None) -> None:
        """What the model says by itself of the body at rest, while the tip decides: no step has to
        wait for it."""
        self._model_limit = None
        if alone is not None and self._decides is not None:
            self._model_limit = self._contact.all_draws.risk(alone).upper_limit

    def warm_up(self) -> None:
        """Compile what is only needed near to something, or load it from numba's cache."""
        mixture = self._model.shapes.mixture(self._model.known[0])
        if mixture is not None:
            self._contact.warm_up(mixture)
            self._fewer.part_slopes(mixture, 0.0, self._part_ends, np.inf)
            self.see(mixture, np.zeros(3), np.zeros(3), agrees=True)
            self.forget_tip()
            self.take_as_shifted(np.zeros(mixture.dimensions))
            self.take_as_shifted(None)

    def _beside(self, u: FloatArray, axis: int, step: float) -> tuple[Mixture, Mixture] | None:
        """With one axis a step further, and a step back."""
        ends = []
        for way in (step, -step):
            there = u.copy()
            there[axis] += way
            ends.append(self._as_told(self._model.shapes.mixture(there)))
        up, down = ends
        return None if up is None or down is None else (up, down)

    def _tip(self, mixture: Mixture) -> FloatArray:
        """(6,) place in mm and direction of the mean shape's tip."""
        modes, base = self._model.basis.modes, self._model.basis.base_mm
        mean = mixture.weights @ mixture.means_mm
        before, tip = (base[node] + mean @ modes[:, node] for node in (-2, -1))
        along = tip - before
        return np.concatenate([tip, along / np.linalg.norm(along)])

    def _parts(
        self, found: PartSlopes, changes: FloatArray, clearance_mm: float
    ) -> tuple[PartClearance, ...]:
        """Of what is near. changes: (m, …) of the mixture with each axis.

        The nearest part has the clearance of the whole body, which more of the shapes decide, and
        the others are as much farther as they are by themselves.
        """
        by_mixture = [
            np.concatenate([means.ravel(), factors.ravel()])
            for means, factors in zip(found.by_means, found.by_factors, strict=True)
        ]
        slopes = (np.array(by_mixture) @ changes.T).tolist()
        nearer_mm = float(found.clearance.min()) - clearance_mm
        arc_mm = self._model.basis.arc_mm[found.node].tolist()
        return tuple(
            PartClearance(arc, part_mm - nearer_mm, tuple(slope))
            for arc, part_mm, slope in zip(arc_mm, found.clearance.tolist(), slopes, strict=True)
            if part_mm <= _NEAR_MM
        )

    def _clearance(self, mixture: Mixture, share: float) -> tuple[float, Mixture]:
        """Of the body, or of the body as it was seen; and the one that has so little."""
        clearance_mm = self._drawn.clearance_mm(mixture, share)
        shifts = self._shift is not None and self._decides is None
        if shifts and clearance_mm < self._shift_mm + _NEAR_MM:
            assert self._shift is not None
            shifted = _moved(mixture, self._shift)
            as_seen_mm = self._fewer.clearance_mm(shifted, share)
            if as_seen_mm < clearance_mm:
                clearance_mm, mixture = as_seen_mm, shifted
        return clearance_mm - self._hardly_proved_mm, mixture

    @property
    def _decides(self) -> GivenTip | None:
        """Who decides by itself, given the tip; None: nobody does."""
        return self._given if self._given is not None and self._given.decides else None

    @property
    def _drawn(self) -> ContactModel:
        """Few shapes, as thick as those that decide."""
        given = self._decides
        return self._fewer if given is None else given.fewer

    def _as_told(self, mixture: Mixture | None) -> Mixture | None:
        """Given the tip, where that decides."""
        given = self._decides
        return mixture if mixture is None or given is None else given.at(mixture)

    def _mixtures(self, u_from: Sequence[float], u_to: Sequence[float]) -> list[Mixture] | None:
        """Over the shape's coefficients, along the way."""
        begin, end = np.asarray(u_from, np.float64), np.asarray(u_to, np.float64)
        way = (end - begin) * self._model.scale
        segments = min(max(1, ceil(sqrt(way @ way) / _LONGEST_SEGMENT)), _MOST_SEGMENTS)
        places = begin + np.arange(segments + 1)[:, np.newaxis] / segments * (end - begin)
        known = self._begin if self._begin is not None and self._begin[0] == tuple(u_from) else None
        if known is not None:
            rest = self._model.shapes.mixtures(places[1:])
            return None if rest is None else [known[1], *rest]
        mixtures = self._model.shapes.mixtures(places)
        self._begin = None if mixtures is None else (tuple(u_from), mixtures[0])
        return mixtures


def _way_risk(found: PathContactRisk, answers: RiskAnswers) -> WayRisk:
    return WayRisk(found.on_the_way, found.leaving, answers, found.touching)


def _change(up: Mixture, down: Mixture) -> FloatArray:
    """(K·d + K·d·d,) of the means, and of the factors."""
    means, factors = up.means_mm - down.means_mm, up.factors_per_mm - down.factors_per_mm
    return np.concatenate([means.ravel(), factors.ravel()])


def _moved(mixture: Mixture, shift: FloatArray) -> Mixture:
    return Mixture(mixture.weights, mixture.means_mm + shift, mixture.factors_per_mm)


def _words(u: Sequence[float]) -> str:
    return "u = (" + ", ".join(f"{value:.4g}" for value in u) + ")"
