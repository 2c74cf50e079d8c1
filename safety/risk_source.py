"""The risk of touching something, as the gate asks for it, and when an answer is believed."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from math import isfinite
from typing import Final, NamedTuple, Protocol, runtime_checkable

MAXIMUM_RISK: Final = 1.0
_TIP_ROWS: Final = 6


@dataclass(frozen=True, slots=True)
class Nearest:
    """Where the body is most likely to touch something, for people: nothing is decided by it."""

    clearance_mm: float
    """One shape in twenty of those the body may have has no more; negative: it touches."""
    arc_mm: float
    """Along the body."""
    place_mm: tuple[float, ...]
    """(3,) where that part of the body is."""
    obstacle_mm: tuple[float, ...]
    """(3,) the place of the surface nearest to there."""
    means_mm: tuple[tuple[float, ...], ...]
    """(K, 3) of the mixture over the body's points; empty: not computed yet."""


@dataclass(frozen=True, slots=True)
class Leaving:
    """Of a way that leads out of a contact: less touches where it ends, and less deeply."""

    at_start: float
    """Probability that something touches before it begins."""
    added: float
    """... that something touches on the way which did not before."""


MODEL: Final = "model"
"""What decides: the model by itself, ..."""
GIVEN_TIP: Final = "tip"
"""... its shapes given where the tip is measured, ..."""
SHIFTED: Final = "shifted"
"""... or the body off from the model everywhere as much as it is seen to be."""


class RiskAnswers(NamedTuple):
    """What was known of one way: by the model alone, and given the measured tip."""

    model: float | None
    """Of the way; while the tip decides, of the body at rest where its room was last told, and None
    where it was not."""
    given_tip: float | None
    """None: not asked, for there is no tip; or the model has something against it, and nothing is
    near."""
    decided_by: str


@dataclass(frozen=True, slots=True)
class RiskReading:
    """What a source says about one straight way of the actuation vector."""

    contact_risk: float
    """Probability that any part of the body touches something, anywhere along the way."""
    body_point_risk: float | None
    """Probability that a random point of the body is in an obstacle, where the source was last
    asked for the room; None: not computed."""
    took_s: float
    """How long the answer took."""
    source: str
    detail: str = ""
    nearest: Nearest | None = None
    doubt: str = ""
    """Why the source cannot tell, for instance outside what its model has learned; empty if it
    can."""
    leaving: Leaving | None = None
    """None: the way does not lead away from what touches."""
    answers: RiskAnswers | None = None
    """For people: the contact risk is one of them. None: there is but one."""


class PartClearance(NamedTuple):
    """The clearance of one part of a body at rest from a risk."""

    arc_mm: float
    """Where along the body the part is nearest to something."""
    clearance_mm: float
    """As of the whole body."""
    slope: tuple[float, ...]
    """(m,) mm of it for each unit of an axis."""


@dataclass(frozen=True, slots=True)
class Clearance:
    """The clearance of a body at rest from a risk, and which way of the axes leads away from it."""

    u: tuple[float, ...]
    """(m,) where that is."""
    clearance_mm: float
    """By how much all shapes would have to come nearer; negative: the risk is higher."""
    slope: tuple[float, ...]
    """(m,) mm of it for each unit of an axis."""
    parts: tuple[PartClearance, ...] = ()
    """Of those that something is near to; empty: only the whole is known."""
    tip_slope: tuple[tuple[float, ...], ...] = ()
    """(6, m) how place (mm) and direction (unit vector) of the tip change with each unit of an
    axis; empty: it is not known."""


class RiskSource(Protocol):
    """Knows the body and its surroundings."""

    @property
    def name(self) -> str:
        """What it is, for people."""
        ...

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        """The risk of the straight way between two actuation vectors, each in its axes' units.

        None: there is no answer.
        """
        ...

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        """How far the body at rest at (m,) u is from such a risk. Nothing is decided by it.

        None: it is far, or it is not known.
        """
        ...


class TipComparison(NamedTuple):
    """How the measured tip fits the model of the body."""

    statistic: float
    """Of the sequential test: 1 raises its alarm, 0 takes it back."""
    probability: float
    """Of a tip further out than the measured one, if the body is as the model has it."""
    off_mm: float
    """How far the tip is from the mean of the model's."""
    doubt: str
    """Why the risk cannot be told, and what to do; empty while the tip fits."""


@runtime_checkable
class TipComparing(Protocol):
    """A `RiskSource` that knows where the tip should be, and can tell a body from its model."""

    def compare(
        self,
        lately: Sequence[Sequence[float]],
        tip_mm: Sequence[float],
        t_ns: int,
        direction: Sequence[float] | None = None,
    ) -> TipComparison | None:
        """Take the (3,) tip of a frame, with the axes at (m,) at its time and shortly before it.

        direction: (3,) unit vector along which it points; None: not measured. None: nothing can be
        told there, and the last word stands.
        """
        ...


@runtime_checkable
class WayCounting(Protocol):
    """A `RiskSource` that knows what was risked lately."""

    def went(self, t_ns: int) -> None:
        """The way that was asked about last is gone."""
        ...

    def minute_risk(self, t_ns: int) -> float:
        """How likely the body has touched something since a minute before."""
        ...


def minute_risk_of(source: WayCounting, t_ns: int) -> float:
    """What the source says of the minute behind; the maximum where it fails or says no
    probability."""
    try:
        risk = float(source.minute_risk(t_ns))
    except Exception:  # a model must not end the loop
        return MAXIMUM_RISK
    return risk if _is_probability(risk) else MAXIMUM_RISK


def count_way(source: WayCounting, t_ns: int) -> None:
    """Tell the source that the way asked about last is gone, whatever goes wrong with that."""
    with suppress(Exception):  # it then says what it says of the minute, which is asked for
        source.went(t_ns)


class KnownBody(NamedTuple):
    """Where a model expects the whole body, for people: nothing is decided by it."""

    centreline_mm: list[list[float]]
    """(n, 3) from base to tip."""
    radius_mm: list[float]
    """(n,)."""
    weights: list[float]
    """(K,) of the mixture over the body's points."""
    means_mm: list[list[float]]
    """(K, 3)."""
    covariances_mm2: list[list[float]]
    """(K, 6) of each: xx, xy, xz, yy, yz, zz."""


@runtime_checkable
class BodyKnowing(Protocol):
    """A `RiskSource` that knows where the whole body is."""

    def body(self, u: Sequence[float]) -> KnownBody | None:
        """Of a body at rest at (m,) u; None: it is not known there."""
        ...


def body_of(source: BodyKnowing, u: Sequence[float]) -> KnownBody | None:
    """What the source says of the body at (m,) u; None where it fails, or says no numbers."""
    try:
        body = source.body(u)
        if body is None:
            return None
        rows = (*body.centreline_mm, *body.means_mm, *body.covariances_mm2)
        finite = all(isfinite(part) for row in rows for part in row)
        return body if finite and all(map(isfinite, (*body.radius_mm, *body.weights))) else None
    except Exception:  # a model must not end the loop
        return None


class NoModel:
    """Stands in where there is no model: says always the same, and that it is no model."""

    def __init__(self, contact_risk: float = 0.0) -> None:
        self._reading = RiskReading(contact_risk, None, 0.0, self.name, "nothing is computed")

    @property
    def name(self) -> str:
        return "no model"

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        del u_from, u_to, t_ns
        return self._reading

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        del u, risk
        return None


class RiskAnswer(NamedTuple):
    """A reading that can be acted on."""

    risk: float
    body_point_risk: float | None
    took_s: float
    detail: str
    doubt: str
    """Why the maximum stands here and not what was said; empty if it is what was said."""
    nearest: Nearest | None = None
    leaving: Leaving | None = None
    answers: RiskAnswers | None = None

    def bearable(self, threshold: float) -> bool:
        """Whether the way may be gone: at no more risk than the threshold, or out of more."""
        if self.risk <= threshold:
            return True
        way = self.leaving
        return way is not None and way.at_start > threshold and way.added <= threshold


def believed(reading: RiskReading | None, latest_after_s: float) -> tuple[float, str]:
    """The risk to act on, and why it is not what was said; empty if it is.

    What is missing, late, not finite or not a probability counts as the maximum.
    """
    if reading is None:
        return MAXIMUM_RISK, "no answer"
    if reading.doubt:
        return MAXIMUM_RISK, str(reading.doubt)
    if not _is_probability(reading.contact_risk):
        return MAXIMUM_RISK, f"{reading.contact_risk} is not a probability"
    if not 0.0 <= reading.took_s <= latest_after_s:
        return MAXIMUM_RISK, f"late: it took {reading.took_s * 1e3:.3g} ms"
    way = reading.leaving
    if way is not None and not (_is_probability(way.at_start) and _is_probability(way.added)):
        return MAXIMUM_RISK, f"of a way out, {way.at_start} and {way.added} are not probabilities"
    return float(reading.contact_risk), ""


def name_of(source: RiskSource) -> str:
    """What the source calls itself, whatever goes wrong with that."""
    try:
        return str(source.name)
    except Exception:  # a model must not end the loop
        return "a source without a name"


def clearance_of(source: RiskSource, u: Sequence[float], risk: float) -> Clearance | None:
    """What the source says of the clearance at (m,) u; None where it fails, or says no numbers."""
    try:
        clearance = source.clearance(u, risk)
        if clearance is None:
            return None
        rows = [clearance.u, clearance.slope, *[part.slope for part in clearance.parts]]
        rows += clearance.tip_slope
        if len(clearance.tip_slope) not in (0, _TIP_ROWS) or any(
            len(row) != len(u) for row in rows
        ):
            return None
        places = [number for part in clearance.parts for number in part[:2]]
        known = all(map(isfinite, chain([clearance.clearance_mm], places, *rows)))
        return clearance if known else None
    except Exception:  # a model must not end the loop
        return None


def compared(
    source: TipComparing,
    lately: Sequence[Sequence[float]],
    tip_mm: Sequence[float],
    t_ns: int,
    direction: Sequence[float] | None = None,
) -> TipComparison | None:
    """What the source makes of a measured tip; None where it makes nothing of it, or fails."""
    try:
        found = source.compare(lately, tip_mm, t_ns, direction)
        numbers = None if found is None else (found.statistic, found.probability, found.off_mm)
        return found if numbers is None or all(map(isfinite, numbers)) else None
    except Exception:  # a model must not end the loop
        return None


def ask(
    source: RiskSource,
    u_from: Sequence[float],
    u_to: Sequence[float],
    t_ns: int,
    latest_after_s: float,
) -> RiskAnswer:
    """What the source says of one way, made safe: whatever goes wrong is the maximum risk."""
    try:
        return _answer(source.assess(u_from, u_to, t_ns), latest_after_s)
    except Exception as error:  # a model must not end the loop
        doubt = f"{name_of(source)} failed: {type(error).__name__}{_words_of(error)}"
        return RiskAnswer(MAXIMUM_RISK, None, 0.0, doubt, doubt)


def _answer(reading: RiskReading | None, latest_after_s: float) -> RiskAnswer:
    risk, doubt = believed(reading, latest_after_s)
    if reading is None:
        return RiskAnswer(risk, None, 0.0, doubt, doubt)
    beside = reading.body_point_risk
    if beside is not None and not _is_probability(beside):
        beside = None  # nothing is decided by it
    detail = doubt or str(reading.detail)
    leaving = None if doubt else reading.leaving
    nearest = reading.nearest if _is_place(reading.nearest) else None
    answers = reading.answers if not doubt and _can_be_told(reading.answers) else None
    return RiskAnswer(risk, beside, float(reading.took_s), detail, doubt, nearest, leaving, answers)


def _is_probability(value: float) -> bool:
    return 0.0 <= value <= 1.0


def _can_be_told(answers: RiskAnswers | None) -> bool:
    return answers is not None and all(
        _is_probability(one) for one in answers[:2] if one is not None
    )


def _is_place(nearest: Nearest | None) -> bool:
    """Whether it can be told to people and programs."""
    return (
        nearest is not None
        and len(nearest.place_mm) == len(nearest.obstacle_mm) == 3
        and all(map(isfinite, (nearest.clearance_mm, nearest.arc_mm)))
        and all(map(isfinite, (*nearest.place_mm, *nearest.obstacle_mm)))
        and all(isfinite(part) for mean in nearest.means_mm for part in mean)
    )


def _words_of(error: Exception) -> str:
    try:
        return f": {error}"
    except Exception:  # an error whose words fail
        return ""
