"""How likely a body that goes along a whole path touches something anywhere on it.

Each draw is one body: it keeps what makes it different from the others from the path's beginning to
its end, and is swept from one shape to the next. So the answer does not grow with the number of
waypoints, as a product over independent waypoints does (equation 10 of Thompson et al.), and says
something of what is between them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import betaincinv

from daemon.workbench.planning.body_in_place import BodyInPlace
from safety.risk.body_point import along_path
from safety.risk.contact import ContactModel
from safety.risk.contact_figures import CONFIDENCE, WorstPlace
from safety.risk.model.mixture import FloatArray


@dataclass(frozen=True, eq=False)
class PathRisk:
    """Of one path."""

    probability: float
    """Share of the draws that touch anywhere on the way: the estimate."""
    lowest: float
    highest: float
    """Of the estimate, 95 %, two-sided (Clopper and Pearson)."""
    upper_limit: float
    """As the gate has it: one-sided, and counted are all draws that are not proved to be clear."""
    samples: int
    clearance_mm: float
    """On the way; one draw in twenty has no more."""
    by_place: tuple[float, ...]
    """(n,) share of the draws that touch at each place of the path."""
    worst: WorstPlace

    def summary(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "contact_risk": self.probability,
            "contact_risk_between": [self.lowest, self.highest],
            "contact_risk_upper_limit": self.upper_limit,
            "samples": self.samples,
            "clearance_5_percent_mm": self.clearance_mm,
            "nearest": {
                "clearance_mm": self.worst.clearance_mm,
                "arc_mm": self.worst.arc_mm,
                "place_mm": self.worst.place_mm.tolist(),
                "obstacle_mm": self.worst.nearest_mm.tolist(),
            },
        }


class PathRisks:
    """Asks for many paths of one body, with the same draws. Not for several threads."""

    def __init__(self, body: BodyInPlace, samples: int = 1000, seed: int = 1) -> None:
        """seed: another one than that with which the path was made, or it flatters itself."""
        self._body = body
        port = body.environment.port
        self._contact = ContactModel(body.basis, body.grid, port, samples, seed)

    def of(self, waypoints: FloatArray) -> PathRisk:
        """Of a polyline through (n, m), looked at as finely as the body needs."""
        found = self._body.along(self._body.finely(waypoints), self._contact)
        on_the_way = found.on_the_way
        low, high = interval(on_the_way.touching, on_the_way.samples)
        return PathRisk(
            on_the_way.probability,
            low,
            high,
            on_the_way.upper_limit,
            on_the_way.samples,
            on_the_way.lowest_5_percent_mm,
            found.at_waypoints,
            on_the_way.worst,
        )


def interval(count: int, samples: int, confidence: float = CONFIDENCE) -> tuple[float, float]:
    """Two-sided, of a share (Clopper and Pearson 1934)."""
    tail = 0.5 * (1.0 - confidence)
    low = 0.0 if count == 0 else float(betaincinv(count, samples - count + 1, tail))
    high = 1.0 if count >= samples else float(betaincinv(count + 1, samples - count, 1.0 - tail))
    return low, high


def printed_path_risk(body: BodyInPlace, waypoints: FloatArray) -> float:
    """Equation 10 of Thompson et al. over these (n, m) waypoints: 1 − Π (1 − body_point_risk).

    No probability that the body touches, and another number for every number of waypoints.
    """
    return along_path(body.printed_risks(waypoints).tolist()).product


def resampled(body: BodyInPlace, waypoints: FloatArray, count: int) -> FloatArray:
    """(count, m) places on the polyline through (n, m), the body as far from one to the next."""
    fine = body.finely(waypoints)
    lines = np.array([body.centreline(u) for u in fine])
    passed = np.concatenate(
        [[0.0], np.cumsum(np.linalg.norm(np.diff(lines, axis=0), axis=2).max(axis=1))]
    )
    if not passed[-1] > 0.0:
        return np.repeat(waypoints[:1], count, axis=0)
    wanted = np.linspace(0.0, passed[-1], count)
    columns = [np.interp(wanted, passed, fine[:, axis]) for axis in range(fine.shape[1])]
    return np.stack(columns, axis=1)
