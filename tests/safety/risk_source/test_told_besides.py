"""What a source tells besides the risk: clearance, the tip's place, the minute and the body."""

from collections.abc import Sequence
from math import inf, nan

import pytest

from safety.risk_source import (
    MAXIMUM_RISK,
    Clearance,
    KnownBody,
    NoModel,
    PartClearance,
    TipComparison,
    body_of,
    clearance_of,
    compared,
    count_way,
    minute_risk_of,
)
from tests.safety.risk_source.source import Source


@pytest.mark.parametrize(
    "clearance",
    [
        None,
        Clearance((0.0,), nan, (1.0,)),
        Clearance((0.0,), 1.0, (inf,)),
        Clearance((nan,), 1.0, (1.0,)),
        Clearance((0.0, 0.0), 1.0, (1.0,)),
        Clearance((0.0,), 1.0, (1.0, 1.0)),
        Clearance((0.0, 0.0), 1.0, (1.0, 1.0)),
        Clearance((0.0,), "far", (1.0,)),  # type: ignore[arg-type]
        Clearance((0.0,), 1.0, (1.0,), parts=(PartClearance(0.0, 1.0, (1.0, 2.0)),)),
        Clearance((0.0,), 1.0, (1.0,), parts=(PartClearance(0.0, 1.0, (nan,)),)),
        Clearance((0.0,), 1.0, (1.0,), parts=(PartClearance(0.0, inf, (1.0,)),)),
        Clearance((0.0,), 1.0, (1.0,), parts=(PartClearance(nan, 1.0, (1.0,)),)),
        Clearance((0.0,), 1.0, (1.0,), tip_slope=((1.0,),) * 5),
        Clearance((0.0,), 1.0, (1.0,), tip_slope=((1.0,),) * 7),
        Clearance((0.0,), 1.0, (1.0,), tip_slope=(*((1.0,),) * 5, (1.0, 1.0))),
        Clearance((0.0,), 1.0, (1.0,), tip_slope=(*((1.0,),) * 5, (inf,))),
        ZeroDivisionError("no bodies"),
    ],
)
def test_a_clearance_that_is_no_number_or_cannot_be_told_is_none(
    clearance: Clearance | Exception | None,
) -> None:
    assert clearance_of(Source(None, clearance), [0.0], 0.05) is None


def test_a_clearance_is_passed_on() -> None:
    clearance = Clearance((0.0, 1.0), -2.0, (1.0, 0.0))
    source = Source(None, clearance)
    assert clearance_of(source, [0.0, 1.0], 0.05) is clearance
    assert source.looked == [([0.0, 1.0], 0.05)]
    assert clearance_of(NoModel(), [0.0, 1.0], 0.05) is None


def test_the_clearance_of_parts_is_passed_on_with_what_the_tip_does() -> None:
    parts = (PartClearance(50.0, 2.0, (1.0, 0.0)), PartClearance(90.0, 3.0, (0.0, 1.0)))
    clearance = Clearance((0.0, 1.0), 2.0, (1.0, 0.0), parts, ((0.5, 0.1),) * 6)
    assert clearance_of(Source(None, clearance), [0.0, 1.0], 0.05) is clearance


# Tips that are compared.


class Compares:
    def __init__(self, answer: TipComparison | Exception | None) -> None:
        self._answer = answer

    def compare(
        self, lately: object, tip_mm: object, t_ns: int, direction: object = None
    ) -> TipComparison | None:
        if isinstance(self._answer, Exception):
            raise self._answer
        return self._answer


GOOD = TipComparison(0.5, 0.1, 3.0, "")


@pytest.mark.parametrize(
    "answer",
    [
        None,
        RuntimeError("a model"),
        GOOD._replace(statistic=float("nan")),
        GOOD._replace(probability=float("inf")),
        GOOD._replace(off_mm=float("nan")),
    ],
)
def test_a_comparison_that_fails_or_is_no_number_is_none(
    answer: TipComparison | Exception | None,
) -> None:
    assert compared(Compares(answer), [[0.0]], [0.0, 0.0, 0.0], 0) is None
    assert compared(Compares(GOOD), [[0.0]], [0.0, 0.0, 0.0], 0) is GOOD


# The minute behind.


class Counts:
    def __init__(self, minute: object) -> None:
        self._minute = minute
        self.gone: list[int] = []

    def went(self, t_ns: int) -> None:
        if isinstance(self._minute, Exception):
            raise self._minute
        self.gone.append(t_ns)

    def minute_risk(self, t_ns: int) -> float:
        if isinstance(self._minute, Exception):
            raise self._minute
        return self._minute if t_ns == 7 else 0.5  # type: ignore[return-value]


@pytest.mark.parametrize("minute", [0.0, 0.03, 1.0])
def test_the_risk_of_the_minute_is_what_the_source_says(minute: float) -> None:
    assert minute_risk_of(Counts(minute), 7) == minute


@pytest.mark.parametrize(
    "minute", [RuntimeError("a model"), "low", None, float("nan"), -0.1, 1.1, float("inf")]
)
def test_a_minute_of_which_nothing_can_be_said_is_the_maximum(minute: object) -> None:
    assert minute_risk_of(Counts(minute), 7) == MAXIMUM_RISK


def test_a_way_that_was_gone_is_told_whatever_goes_wrong_with_that() -> None:
    counts = Counts(0.0)
    count_way(counts, 5)
    assert counts.gone == [5]
    count_way(Counts(RuntimeError("a model")), 5)


# Bodies that are known.


class Knows:
    """Says of a body at rest what it is told to; an exception is raised."""

    def __init__(self, answer: KnownBody | Exception | None) -> None:
        self.answer = answer

    def body(self, u: Sequence[float]) -> KnownBody | None:
        assert u == [1.0]
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


BODY = KnownBody(
    centreline_mm=[[0.0, 0.0, 0.0], [0.0, 1.0, 9.0]],
    radius_mm=[2.0, 1.5],
    weights=[0.4, 0.6],
    means_mm=[[0.0, 0.0, 4.0], [0.0, 1.0, 5.0]],
    covariances_mm2=[[1.0, 0.0, 0.0, 1.0, 0.0, 1.0], [2.0, 0.0, 0.0, 2.0, 0.0, 2.0]],
)


def test_a_known_body_is_passed_on() -> None:
    assert body_of(Knows(BODY), [1.0]) is BODY


@pytest.mark.parametrize(
    "answer",
    [
        None,
        ValueError("no"),
        BODY._replace(centreline_mm=[[0.0, 0.0, 0.0], [0.0, nan, 9.0]]),
        BODY._replace(radius_mm=[2.0, inf]),
        BODY._replace(weights=[nan, 0.6]),
        BODY._replace(means_mm=[[0.0, 0.0, -inf], [0.0, 1.0, 5.0]]),
        BODY._replace(covariances_mm2=[[1.0, 0.0, nan, 1.0, 0.0, 1.0]] * 2),
    ],
)
def test_a_body_that_is_no_numbers_or_cannot_be_told_is_none(
    answer: KnownBody | Exception | None,
) -> None:
    assert body_of(Knows(answer), [1.0]) is None
