"""A body in its surroundings, as a planner asks for it: where it is and may be, what it risks.

The body is as thick as the gate takes it to be, so that what is planned may also be gone.
"""

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from config.control import Workspace
from config.robot import Robot
from daemon.robot.axes import AxisRanges
from safety.risk.body_point import BodyPointRisk
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import ContactRisk, PathContactRisk, WorstPlace
from safety.risk.model.mixture import FloatArray, Mixture
from safety.risk.model.risk_model import RiskModel
from safety.risk.seen_tip import LEFT_OUT_SHARE, SeenTip, TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk.surroundings.environment import Environment

LONGEST_STEP_MM: Final = 2.0
"""Of any part of the body, between two places where its shapes are drawn anew: between them they
are taken to go straight, which over so little is true to some hundredths of a mm."""
CLOSE_SHARE: Final = 0.65
"""Of the model's reach. Nearer than this to what it was trained at, the body can hold what it is
asked for: of the tendon arm's configurations within 0.6 of the reach 97 % can be held, of those
within all of it 41 %, since its tendons must not all pull at once."""
_PROBES: Final = 4
"""Places on a straight way of the axes by which its length in the body is judged."""


@dataclass(frozen=True, slots=True, eq=False)
class Standing:
    """What a place of the axes, or a way between two, is like."""

    allowed: bool
    """Within all limits, and where the model knows the body."""
    risk: float
    """Share of the draws that touch."""
    clearance_mm: float
    """One draw in twenty has no more."""
    worst: WorstPlace | None
    """None: not looked at."""


NOWHERE: Final = Standing(False, 1.0, -np.inf, None)


class AsSeen(NamedTuple):
    """A body whose tip was measured where it stands."""

    conditioning: TipConditioning
    tip: SeenTip
    """With which the model agrees."""


class BodyInPlace:
    """One body in one environment. Not for several threads."""

    def __init__(
        self,
        robot: Robot,
        model: RiskModel,
        environment: Environment,
        grid: DistanceGrid,
        samples: int = 200,
        seed: int = 0,
        as_seen: AsSeen | None = None,
    ) -> None:
        """samples: shapes that are drawn while a path is looked for, the same ones everywhere.

        as_seen: the body is the one whose tip was seen there, as the gate takes it to be while the
        tip decides. None: any that the model knows.
        """
        self.robot = robot
        self.ranges = AxisRanges.of(robot)
        self.workspace: Workspace | None = robot.workspace
        self.model = model
        self.environment = environment
        self.grid = grid
        self._as_seen = as_seen
        self.basis = model.basis if as_seen is None else model.basis.leaving_out(LEFT_OUT_SHARE)
        self.thick = self.basis.on_the_safe_side()
        self.contact = ContactModel(self.thick, grid, environment.port, samples, seed)
        self.body_point = BodyPointRisk(environment)
        self._modes = model.basis.modes.astype(np.float64)
        self._base = model.basis.base_mm.astype(np.float64)

    def centreline(self, u: FloatArray) -> FloatArray:
        """(n, 3) mm of the mean shape at (m,) u. Raises ValueError as `mixture` does."""
        mixture = self.mixture(u)
        mean = mixture.weights @ mixture.means_mm
        return np.asarray(self._base + np.tensordot(mean, self._modes, axes=1))

    def mixture(self, u: FloatArray) -> Mixture:
        """Over the shape's coefficients. Raises ValueError where the model has no number."""
        mixture = self.model.shapes.mixture(u)
        if mixture is not None and self._as_seen is not None:
            mixture = self._as_seen.conditioning.there(self._as_seen.tip, mixture)
        if mixture is None:
            raise ValueError(f"the model gives no finite answer at {u.tolist()}")
        return mixture

    def tip(self, u: FloatArray) -> FloatArray:
        """(6,) where the mean shape's tip is, mm, and which way its end points."""
        mixture = self.mixture(u)
        mean = mixture.weights @ mixture.means_mm
        before, tip = (self._base[node] + mean @ self._modes[:, node] for node in (-2, -1))
        along = tip - before
        return np.concatenate([tip, along / np.linalg.norm(along)])

    def closeness(self, u: FloatArray) -> float:
        """How far (m,) u is from what the model was trained at, in shares of its reach."""
        return self.model.distance(u) / self.model.reach

    def allowed(self, u: FloatArray, closer_than: float = CLOSE_SHARE) -> bool:
        """Whether (m,) u is within travel, coupled limits and workspace, and known well."""
        ranges = self.ranges
        if not ((u >= ranges.lowest) & (u <= ranges.highest)).all():
            return False
        if self.closeness(u) > closer_than or not bool(ranges.coupled.inside(u)):
            return False
        return self.in_workspace(self.tip(u)[:3])

    def in_workspace(self, place_mm: FloatArray) -> bool:
        """Whether a trajectory may lead a tip to a (3,) place."""
        if self.workspace is None:
            return True
        ends = (self.workspace.x_mm, self.workspace.y_mm, self.workspace.z_mm)
        return all(low <= x <= high for x, (low, high) in zip(place_mm, ends, strict=True))

    def at_rest(self, u: FloatArray) -> ContactRisk:
        """Of few draws."""
        return self.contact.risk(self.mixture(u))

    def standing(self, u: FloatArray, closer_than: float = CLOSE_SHARE) -> Standing:
        """Of the body at rest at (m,) u."""
        if not self.allowed(u, closer_than):
            return NOWHERE
        return _standing(self.at_rest(u))

    def way(self, start: FloatArray, end: FloatArray, closer_than: float = CLOSE_SHARE) -> Standing:
        """Of the straight way from (m,) to (m,), swept by steps of LONGEST_STEP_MM."""
        places = self.places(start, end)
        if not all(self.allowed(u, closer_than) for u in places[1:]):
            return NOWHERE
        return _standing(self.along(places).on_the_way)

    def along(self, places: FloatArray, contact: ContactModel | None = None) -> PathContactRisk:
        """Through (n, m) places that are near to each other. contact: of other draws."""
        model = self.contact if contact is None else contact
        return model.along([self.mixture(u) for u in places])

    def places(
        self, start: FloatArray, end: FloatArray, longest_mm: float = LONGEST_STEP_MM
    ) -> FloatArray:
        """(k, m) from one place to another, both included, the body never further on its way."""
        probes = [start + share * (end - start) for share in np.linspace(0.0, 1.0, _PROBES + 1)]
        far_mm = body_motion_mm(np.array([self.centreline(u) for u in probes])).max()
        steps = max(1, ceil(_PROBES * float(far_mm) / longest_mm))
        return np.asarray(start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start))

    def finely(self, waypoints: FloatArray, longest_mm: float = LONGEST_STEP_MM) -> FloatArray:
        """(k, m) of a polyline through (n, m)."""
        legs = [self.places(a, b, longest_mm)[1:] for a, b in pairwise(waypoints)]
        return np.concatenate([waypoints[:1], *legs])

    def length_mm(self, places: FloatArray) -> float:
        """How far the part of the body goes that goes farthest, summed over (n, m) places."""
        return float(body_motion_mm(np.array([self.centreline(u) for u in places])).sum())

    def means_free(self, u: FloatArray) -> bool:
        """Whether no mean of the mixture over the body's points is in something solid."""
        points = self.model.points.mixture(u)
        return points is not None and not self.environment.solid(points.means_mm).any()

    def printed_risks(self, places: FloatArray) -> FloatArray:
        """(n,) body_point_risk by equation 9 of Thompson et al., at (n, m) places."""
        mixtures = [self.model.points.mixture(u) for u in places]
        return np.array([1.0 if m is None else self.body_point.printed(m) for m in mixtures])


def body_motion_mm(centrelines: FloatArray) -> NDArray[np.float64]:
    """(k − 1,) how far the node goes that goes farthest, between (k, n, 3) centrelines."""
    return np.asarray(np.linalg.norm(np.diff(centrelines, axis=0), axis=2).max(axis=1))


def _standing(risk: ContactRisk) -> Standing:
    return Standing(True, risk.probability, risk.lowest_5_percent_mm, risk.worst)
