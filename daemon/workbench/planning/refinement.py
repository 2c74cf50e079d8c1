"""A path's waypoints moved until the whole of it is short, smooth and away from everything.

What is minimised has exact slopes and the same draws throughout (`clearance_slopes`), so that a
quasi-Newton method (L-BFGS-B) may be trusted with it. What it finds is taken only as far as it is
better by the measures that decide, which it does not know: the risk of the whole path as it is
swept, and the paper's.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import BSpline
from scipy.optimize import minimize

from daemon.host.progress import Progress
from daemon.workbench.planning.body_in_place import CLOSE_SHARE, BodyInPlace
from daemon.workbench.planning.clearance_slopes import ClearanceLack
from daemon.workbench.planning.path_risk import PathRisk, PathRisks, printed_path_risk, resampled
from safety.risk.model.mixture import FloatArray

_PER_MM: Final = 0.6
"""What a mm of clearance that is lacking at one waypoint counts, where the whole way counts 1."""
_STRAIGHTENING: Final = 0.3
"""What second differences count beside first ones."""
_UNKNOWN: Final = 30.0
"""What it counts to be further from the training than may be, per square of that in reaches."""
_CLOSE: Final = 0.92 * CLOSE_SHARE
_SHARES: Final = (1.0, 0.5)
"""Of the way from the path as it was to what the optimiser found."""
_DEGREE: Final = 3
_FINER: Final = (1, 3)
"""Times as many control points: a spline comes nearer to the polyline through them."""


@dataclass(frozen=True, eq=False)
class Refined:
    """A path, and what it risks."""

    waypoints: FloatArray
    """(n, m)."""
    risk: PathRisk
    printed: float
    """Equation 10 over as many waypoints as the path had before."""


class Refinement:
    """Of paths of one body. Not for several threads."""

    def __init__(
        self, body: BodyInPlace, risks: PathRisks, waypoints: int, iterations: int, seed: int
    ) -> None:
        """waypoints: of a path while it is optimised. iterations: at most."""
        self._body, self._risks = body, risks
        self._count, self._iterations = waypoints, iterations
        self._lack = ClearanceLack(body.model, body.contact, body.grid, seed=seed)
        self._scale = body.model.scale

    def of(self, path: FloatArray, progress: Progress) -> Refined:
        """The (n, m) path made better; or as it was, where nothing is better."""
        before = resampled(self._body, path, self._count)
        progress.begin("refining", self._iterations, 0)
        after = self._optimised(before, progress)
        was = self._judged(path, before)
        best = was
        for share in _SHARES:
            waypoints = self._legal(before, before + share * (after - before))
            for smooth in self._smoothed(waypoints):
                found = self._judged(smooth, waypoints)
                if self._better(found, best):
                    best = found
                    break
            if best is not was:
                break
        return best

    def _judged(self, path: FloatArray, waypoints: FloatArray) -> Refined:
        risk = self._risks.of(path)
        return Refined(path, risk, printed_path_risk(self._body, waypoints))

    def _better(self, found: Refined, than: Refined) -> bool:
        """Never one that is worse by either measure; of the same risk, the one with more room."""
        a, b = found.risk, than.risk
        if found.printed > than.printed + 1e-9 or a.upper_limit > b.upper_limit:
            return False
        if a.probability != b.probability:
            return a.probability < b.probability
        return a.upper_limit < b.upper_limit or a.clearance_mm >= b.clearance_mm - 0.5

    def _optimised(self, before: FloatArray, progress: Progress) -> FloatArray:
        """The (n, m) waypoints between the ends, moved."""
        inner = before[1:-1] * self._scale
        if not inner.size:
            return before
        chords = np.diff(before * self._scale, axis=0)
        length = max(float(np.linalg.norm(chords, axis=1).sum()), 1e-6)
        ranges = self._body.ranges
        bounds = np.stack([ranges.lowest * self._scale, ranges.highest * self._scale], axis=1)

        def value(flat: FloatArray) -> tuple[float, FloatArray]:
            waypoints = before * self._scale
            waypoints[1:-1] = flat.reshape(inner.shape)
            return self._value(waypoints, length)

        found = minimize(
            value,
            inner.ravel(),
            jac=True,
            method="L-BFGS-B",
            bounds=np.tile(bounds, (len(inner), 1)),
            options={"maxiter": self._iterations, "maxfun": 2 * self._iterations},
            callback=lambda _: progress.advance(),
        )
        after = before.copy()
        after[1:-1] = found.x.reshape(inner.shape) / self._scale
        return after

    def _value(self, waypoints: FloatArray, length: float) -> tuple[float, FloatArray]:
        """What is minimised, and its slope by the inner ones of (n, m) waypoints in inputs."""
        n = len(waypoints)
        steps = np.diff(waypoints, axis=0) * ((n - 1) / length)
        bends = np.diff(waypoints, n=2, axis=0) * ((n - 1) / length)
        total = float((steps**2).sum() / (n - 1) + _STRAIGHTENING * (bends**2).sum() / (n - 1))
        slope = np.zeros_like(waypoints)
        by_steps = 2.0 / length * steps
        slope[:-1] -= by_steps
        slope[1:] += by_steps
        by_bends = _STRAIGHTENING * 2.0 / length * bends
        slope[:-2] += by_bends
        slope[1:-1] -= 2.0 * by_bends
        slope[2:] += by_bends
        for row in range(1, n - 1):
            u = waypoints[row] / self._scale
            lack = self._lack.at(u)
            strange, by_place = self._strangeness(u)
            total += _PER_MM * lack.mm + _UNKNOWN * strange
            slope[row] += _PER_MM * lack.by_u / self._scale + _UNKNOWN * by_place
        return total, slope[1:-1].ravel()

    def _strangeness(self, u: FloatArray) -> tuple[float, FloatArray]:
        """The square of how much too far (m,) u is from the training, and its slope by inputs.

        Of an axis with a period the slope is left out: it is never far from anything there.
        """
        model = self._body.model
        nothing = np.zeros_like(u)
        distance = model.distance(u)
        beyond = distance / model.reach - _CLOSE
        if beyond <= 0.0:
            return 0.0, nothing
        features = model.features(u)
        nearest = int(np.argmin(np.square(model.known_features - features).sum(axis=1)))
        off = (u - model.known[nearest]) * self._scale
        off[model.points.period > 0.0] = 0.0
        return beyond**2, 2.0 * beyond * off / (distance * model.reach)

    def _legal(self, before: FloatArray, after: FloatArray) -> FloatArray:
        """Each waypoint as far on its way as is allowed there."""
        legal = after.copy()
        for row in range(1, len(after) - 1):
            for share in (1.0, 0.75, 0.5, 0.25, 0.0):
                legal[row] = before[row] + share * (after[row] - before[row])
                if self._body.allowed(legal[row]):
                    break
        return legal

    def _smoothed(self, waypoints: FloatArray) -> list[FloatArray]:
        """Splines near the polyline through (n, m), and the polyline itself; all within limits."""
        found = []
        for finer in _FINER:
            spline = spline_through(self._finer(waypoints, finer), 3 * len(waypoints))
            if self._is_allowed(spline):
                found.append(spline)
        if self._is_allowed(waypoints):
            found.append(waypoints)
        return found

    def _is_allowed(self, waypoints: FloatArray) -> bool:
        """Whether all of the way through (n, m) is, but for its ends, which were asked for."""
        return all(self._body.allowed(u) for u in self._body.finely(waypoints)[1:-1])

    def _finer(self, waypoints: FloatArray, times: int) -> FloatArray:
        at = np.arange(len(waypoints), dtype=np.float64)
        wanted = np.linspace(0.0, at[-1], times * (len(waypoints) - 1) + 1)
        columns = [np.interp(wanted, at, column) for column in waypoints.T]
        return np.stack(columns, axis=1)


def spline_through(control: FloatArray, count: int) -> FloatArray:
    """(count, m) places on the clamped cubic B-spline of (n, m) control points: no corners."""
    degree = min(_DEGREE, len(control) - 1)
    inner = np.linspace(0.0, 1.0, len(control) - degree + 1)
    knots = np.concatenate([np.zeros(degree), inner, np.ones(degree)])
    return np.asarray(BSpline(knots, control, degree)(np.linspace(0.0, 1.0, count)))
