"""What sampled shapes of the body say of a contact: shares and upper limits, clearances, where."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from safety.risk.model.mixture import FloatArray
from safety.risk.shape_kernels import Shapes, SingleArray, count_shapes
from safety.risk_source import Leaving

CONFIDENCE: Final = 0.95
"""Of the upper limit: the usual one of one-sided limits."""
_WORST_SHARE: Final = 0.05
"""Of the shapes, that say where the body is nearest: fifty of a thousand, enough for a middle."""
MINUTE_NS: Final = 60_000_000_000
_NEVER_NS: Final = np.iinfo(np.int64).min


@dataclass(frozen=True, slots=True, eq=False)
class WorstPlace:
    """Where most of the worst twentieth of the shapes are nearest to something."""

    arc_mm: float
    """Along the body."""
    place_mm: FloatArray
    """(3,) where that part of the body is, on the average of them."""
    nearest_mm: FloatArray
    """(3,) the place of the surface nearest to there."""
    clearance_mm: float
    """None of the worst twentieth has more."""


class Counted(NamedTuple):
    """Of shapes, by their clearances, and what these are surely not below: see `ContactRisk`."""

    samples: int
    touching: int
    not_surely_clear: int
    lowest_1_percent_mm: float
    threshold_mm: float
    """None of the worst twentieth has more."""
    median_mm: float
    mean_of_worst_mm: float


def counted(clearance: SingleArray, surely: SingleArray) -> Counted:
    """Of (S,) shapes."""
    samples = clearance.size
    return Counted(samples, *count_shapes(clearance, surely, few_of(samples), samples // 100))


@dataclass(frozen=True, slots=True, eq=False)
class ContactRisk:
    """What the sampled shapes say. Clearances are of the body's skin, negative in what is solid."""

    probability: float
    """The share of shapes that touch: the estimate."""
    upper_limit: float
    """With CONFIDENCE, the probability is not above this (Clopper and Pearson). Counted are all
    shapes that are not proved to be clear. What decides."""
    samples: int
    touching: int
    not_surely_clear: int
    lowest_1_percent_mm: float
    """One shape in a hundred has no more clearance than this."""
    lowest_5_percent_mm: float
    median_mm: float
    """Of shapes with more clearance than a twentieth has, it is that of their nodes at most."""
    mean_of_worst_mm: float
    """Mean clearance of the worst twentieth of the shapes."""
    worst: WorstPlace

    @classmethod
    def of(cls, counted: Counted, worst: WorstPlace) -> "ContactRisk":
        """Of what is counted of the shapes."""
        samples, touching, not_clear = counted.samples, counted.touching, counted.not_surely_clear
        return cls(
            touching / samples,
            upper_limit(not_clear, samples),
            samples,
            touching,
            not_clear,
            counted.lowest_1_percent_mm,
            counted.threshold_mm,
            counted.median_mm,
            counted.mean_of_worst_mm,
            worst,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PathContactRisk:
    """Of a way through several mixtures, and of each of them."""

    on_the_way: ContactRisk
    """Touching anywhere, at the waypoints or between them."""
    at_waypoints: tuple[float, ...]
    """The estimate at each."""
    leaving: Leaving | None
    """None: the way does not lead away from what touches."""
    touching: NDArray[np.bool_]
    """(S,) which draws are not proved to be clear anywhere on it."""


@dataclass(frozen=True, slots=True, eq=False)
class Touching:
    """How much of the body touches, at one end of a way."""

    which: NDArray[np.bool_]
    """(S,) shapes that are not proved to be clear."""
    count: int
    mean_of_worst_mm: float
    """Not taken where none touches."""

    @classmethod
    def of(cls, shapes: Shapes) -> "Touching":
        which = ~(shapes.surely > 0.0)
        count = int(np.count_nonzero(which))
        return cls(which, count, _mean_of_worst(shapes.clearance) if count else np.inf)

    def left(self, end: Shapes, surely: SingleArray) -> Leaving | None:
        """Where the way from here to there leads out. surely: (S,) on the way."""
        there = Touching.of(end)
        if there.count > self.count or not there.mean_of_worst_mm > self.mean_of_worst_mm:
            return None
        samples = self.which.size
        added = int(np.count_nonzero(~(surely > 0.0) & ~self.which))
        return Leaving(upper_limit(self.count, samples), upper_limit(added, samples))


class MinuteBehind:
    """How likely the body has touched anything in the last minute.

    Shapes are drawn with the same draws at every step, so each draw is one body. It counts as
    having touched from the step at which it is not proved to be clear until a minute later, however
    often it does so in between: steps that are risky for the same bodies do not add up, and those
    that are risky for others do. A product over the steps, as if each met another body, would soon
    be 1.
    """

    def __init__(self, samples: int) -> None:
        self._touched_ns = np.full(samples, _NEVER_NS, np.int64)

    def add(self, touching: NDArray[np.bool_], t_ns: int) -> None:
        """A way is gone. touching: (S,) which draws are not proved to be clear on it."""
        self._touched_ns[touching] = t_ns

    def risk(self, t_ns: int) -> float:
        """Upper limit, with the confidence of a step's, of having touched since a minute before."""
        count = int(np.count_nonzero(self._touched_ns > t_ns - MINUTE_NS))
        return upper_limit(count, self._touched_ns.size)


def upper_limit(count: int, samples: int, confidence: float = CONFIDENCE) -> float:
    """Clopper and Pearson's: a larger probability would give so few with less than 1 − confidence.

    None of 1000 gives 0.003.
    """
    return 1.0 if count >= samples else float(_limits(samples, confidence)[count])


def most_touching(risk: float, samples: int) -> int:
    """How many of the samples may touch for the upper limit not to be above a risk; −1: none may,
    and not even that is enough."""
    return int(_limits(samples, CONFIDENCE).searchsorted(risk, side="right")) - 1


@lru_cache(maxsize=16)
def _limits(samples: int, confidence: float) -> FloatArray:
    """(samples,) the upper limits of all that can be counted, at once: one is asked for with every
    step, and each takes tens of microseconds."""
    count = np.arange(samples)
    return np.asarray(betaincinv(count + 1.0, samples - count, confidence))


def share_touching(clearance: SingleArray) -> float:
    """The estimate, of (S,) clearances."""
    return int(np.count_nonzero(clearance <= 0.0)) / clearance.size


def threshold_mm(clearance: SingleArray) -> float:
    """None of the worst twentieth has more."""
    few = few_of(clearance.size)
    return float(np.partition(clearance, few - 1)[few - 1])


def _mean_of_worst(clearance: SingleArray) -> float:
    few = few_of(clearance.size)
    return float(np.partition(clearance, few - 1)[:few].mean())


def few_of(samples: int) -> int:
    """How many are the worst twentieth: of so many at least, clearances are exact."""
    return max(1, int(_WORST_SHARE * samples))
