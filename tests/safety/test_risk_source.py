"""Which answers about risk are believed, and what stands in for the others."""

from collections.abc import Sequence
from math import inf, nan

import pytest

from safety.risk_source import (
    GIVEN_TIP,
    MAXIMUM_RISK,
    Clearance,
    KnownBody,
    Leaving,
    Nearest,
    NoModel,
    PartClearance,
    RiskAnswers,
    RiskReading,
    RiskSource,
    TipComparison,
    ask,
    believed,
    body_of,
    clearance_of,
    compared,
    count_way,
    minute_risk_of,
    name_of,
)

LATEST_S = 0.02


def reading(
    risk: float = 0.1, took_s: float = 0.001, body_point_risk: float | None = 0.01
) -> RiskReading:
    return RiskReading(risk, body_point_risk, took_s, "a model", "as trained")


class Source:
    """Answers as it is told; an exception is raised."""

    name = "a model"

    def __init__(
        self, answer: RiskReading | Exception | None, clearance: Clearance | Exception | None = None
    ) -> None:
        self.answer = answer
        self.given_clearance = clearance
        self.looked: list[tuple[Sequence[float], float]] = []
        self.asked: list[tuple[Sequence[float], Sequence[float], int]] = []

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        self.asked.append((u_from, u_to, t_ns))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        self.looked.append((u, risk))
        if isinstance(self.given_clearance, Exception):
            raise self.given_clearance
        return self.given_clearance


@pytest.mark.parametrize("risk", [0.0, 0.05, 1.0])
@pytest.mark.parametrize("took_s", [0.0, LATEST_S])
def test_a_probability_in_time_is_believed(risk: float, took_s: float) -> None:
    assert believed(reading(risk, took_s), LATEST_S) == (risk, "")


@pytest.mark.parametrize("risk", [nan, inf, -inf, -1e-9, 1.0 + 1e-9, 5.0])
def test_what_is_no_probability_is_the_maximum(risk: float) -> None:
    acted_on, why = believed(reading(risk), LATEST_S)
    assert acted_on == MAXIMUM_RISK
    assert "is not a probability" in why


@pytest.mark.parametrize("took_s", [LATEST_S + 1e-9, inf, nan, -1e-9])
def test_what_is_late_is_the_maximum(took_s: float) -> None:
    acted_on, why = believed(reading(0.0, took_s), LATEST_S)
    assert acted_on == MAXIMUM_RISK
    assert "late" in why


def test_how_late_is_told() -> None:
    assert believed(reading(0.0, 0.0314), LATEST_S)[1] == "late: it took 31.4 ms"


def test_a_missing_answer_is_the_maximum() -> None:
    assert believed(None, LATEST_S) == (MAXIMUM_RISK, "no answer")
    assert MAXIMUM_RISK == 1.0


def test_a_good_answer_is_passed_on() -> None:
    source = Source(reading(0.1, 0.001, 0.01))
    answer = ask(source, [1.0], [2.0], 77, LATEST_S)
    assert source.asked == [([1.0], [2.0], 77)]
    assert (answer.risk, answer.body_point_risk, answer.took_s) == (0.1, 0.01, 0.001)
    assert (answer.detail, answer.doubt) == ("as trained", "")


def test_a_source_that_cannot_tell_is_the_maximum_with_its_reason() -> None:
    unknown = RiskReading(0.0, 0.01, 0.001, "a model", "as trained", doubt="never learned")
    answer = ask(Source(unknown), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.took_s) == (MAXIMUM_RISK, 0.001)
    assert answer.doubt == answer.detail == "never learned"


def test_where_something_is_near_is_passed_on() -> None:
    nearest = Nearest(2.0, 150.0, (0.0, 1.0, 2.0), (3.0, 4.0, 5.0), ())
    told = RiskReading(0.1, None, 0.001, "a model", "as trained", nearest)
    assert ask(Source(told), [1.0], [2.0], 0, LATEST_S).nearest is nearest
    assert ask(Source(reading()), [1.0], [2.0], 0, LATEST_S).nearest is None
    assert ask(Source(None), [1.0], [2.0], 0, LATEST_S).nearest is None


ANSWERS = RiskAnswers(0.3, 0.1, GIVEN_TIP)


def test_which_answers_there_were_is_passed_on() -> None:
    told = RiskReading(0.1, None, 0.001, "a model", answers=ANSWERS)
    assert ask(Source(told), [1.0], [2.0], 0, LATEST_S).answers is ANSWERS
    alone = RiskReading(0.1, None, 0.001, "a model", answers=ANSWERS._replace(given_tip=None))
    assert ask(Source(alone), [1.0], [2.0], 0, LATEST_S).answers is alone.answers
    assert ask(Source(reading()), [1.0], [2.0], 0, LATEST_S).answers is None
    assert ask(Source(None), [1.0], [2.0], 0, LATEST_S).answers is None


@pytest.mark.parametrize(
    "answers",
    [
        ANSWERS._replace(model=float("nan")),
        ANSWERS._replace(model=1.1),
        ANSWERS._replace(given_tip=-0.1),
        ANSWERS._replace(given_tip=float("inf")),
    ],
)
def test_answers_that_are_no_probabilities_are_not_told_and_decide_nothing(
    answers: RiskAnswers,
) -> None:
    told = RiskReading(0.1, None, 0.001, "a model", answers=answers)
    answer = ask(Source(told), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.doubt, answer.answers) == (0.1, "", None)


def test_of_what_is_not_believed_no_answers_are_told() -> None:
    late = RiskReading(0.1, None, 1.0, "a model", answers=ANSWERS)
    assert ask(Source(late), [1.0], [2.0], 0, LATEST_S).answers is None


@pytest.mark.parametrize(
    ("leaving", "bearable"),
    [
        (None, False),
        (Leaving(at_start=0.4, added=0.05), True),
        (Leaving(at_start=0.4, added=0.06), False),
        (Leaving(at_start=0.05, added=0.0), False),
        (Leaving(at_start=0.06, added=0.0), True),
    ],
)
def test_more_risk_is_bearable_on_the_way_out_of_it(
    leaving: Leaving | None, bearable: bool
) -> None:
    told = RiskReading(0.3, None, 0.001, "a model", leaving=leaving)
    answer = ask(Source(told), [1.0], [2.0], 0, LATEST_S)
    assert answer.bearable(0.05) == bearable
    assert answer.bearable(0.3)


@pytest.mark.parametrize(
    "leaving",
    [
        Leaving(at_start=nan, added=0.0),
        Leaving(at_start=0.4, added=nan),
        Leaving(at_start=0.4, added=-5.0),
        Leaving(at_start=7.0, added=0.0),
        Leaving(at_start=inf, added=0.0),
        Leaving(at_start=-0.1, added=0.0),
        Leaving(at_start=0.4, added=1.1),
    ],
)
def test_a_way_out_that_is_no_probability_makes_all_of_it_the_maximum(leaving: Leaving) -> None:
    told = RiskReading(0.3, None, 0.001, "a model", leaving=leaving)
    answer = ask(Source(told), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.leaving) == (MAXIMUM_RISK, None)
    assert not answer.bearable(0.99)
    assert answer.doubt == (
        f"of a way out, {leaving.at_start} and {leaving.added} are not probabilities"
    )


@pytest.mark.parametrize("edge", [0.0, 1.0])
def test_a_way_out_may_be_certain_or_impossible(edge: float) -> None:
    told = RiskReading(0.3, None, 0.001, "a model", leaving=Leaving(edge, edge))
    assert ask(Source(told), [1.0], [2.0], 0, LATEST_S).doubt == ""


@pytest.mark.parametrize("beside", [nan, inf, -0.1, 1.1])
def test_the_risk_of_a_body_point_that_is_no_probability_is_left_out(beside: float) -> None:
    answer = ask(Source(reading(0.1, 0.001, beside)), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk) == (0.1, None)


@pytest.mark.parametrize(
    "answer",
    [
        "0.0",
        {"contact_risk": 0.0},
        RiskReading("low", None, 0.001, "a model"),  # type: ignore[arg-type]
        RiskReading(0.0, "low", 0.001, "a model"),  # type: ignore[arg-type]
        RiskReading(0.0, None, None, "a model"),  # type: ignore[arg-type]
        RiskReading(0.0, None, 0.001, "a model", leaving=(0.4, 0.0)),  # type: ignore[arg-type]
        RiskReading(0.0, None, 0.001, "a model", nearest="a wall"),  # type: ignore[arg-type]
    ],
)
def test_an_answer_of_another_kind_is_the_maximum(answer: object) -> None:
    told = ask(Source(answer), [1.0], [2.0], 0, LATEST_S)  # type: ignore[arg-type]
    assert told.risk == MAXIMUM_RISK
    assert told.doubt.startswith("a model failed: ")


def test_words_of_another_kind_become_words() -> None:
    told = RiskReading(0.0, None, 0.001, "a model", 7, doubt=8)  # type: ignore[arg-type]
    assert ask(Source(told), [1.0], [2.0], 0, LATEST_S).doubt == "8"
    told = RiskReading(0.0, None, 0.001, "a model", 7)  # type: ignore[arg-type]
    assert ask(Source(told), [1.0], [2.0], 0, LATEST_S).detail == "7"


@pytest.mark.parametrize(
    "nearest",
    [
        Nearest(nan, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), ()),
        Nearest(0.0, nan, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), ()),
        Nearest(0.0, 0.0, (0.0, 0.0), (0.0, 0.0), ()),
        Nearest(0.0, 0.0, (0.0, 0.0), (0.0, 0.0, 0.0), ()),
        Nearest(0.0, 0.0, (0.0, 0.0, inf), (0.0, 0.0, 0.0), ()),
        Nearest(0.0, 0.0, (0.0, 0.0, 0.0), (nan, 0.0, 0.0), ()),
        Nearest(0.0, 0.0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), ((0.0, nan, 0.0),)),
    ],
)
def test_a_place_that_is_none_is_left_out(nearest: Nearest) -> None:
    told = RiskReading(0.1, None, 0.001, "a model", "as trained", nearest)
    answer = ask(Source(told), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.nearest) == (0.1, None)


class Nameless(Source):
    """Fails, and cannot even say what it is."""

    @property
    def name(self) -> str:  # type: ignore[override]
        raise ZeroDivisionError


class WordlessError(RuntimeError):
    """An error that cannot be told."""

    def __str__(self) -> str:
        raise ZeroDivisionError


def test_a_source_that_cannot_say_its_name_is_the_maximum_too() -> None:
    answer = ask(Nameless(ValueError("no body")), [1.0], [2.0], 0, LATEST_S)
    assert answer.risk == MAXIMUM_RISK
    assert answer.doubt == "a source without a name failed: ValueError: no body"
    assert name_of(Nameless(None)) == "a source without a name"
    assert name_of(Source(None)) == "a model"


def test_an_error_that_cannot_be_told_is_the_maximum_too() -> None:
    answer = ask(Source(WordlessError()), [1.0], [2.0], 0, LATEST_S)
    assert (answer.risk, answer.doubt) == (MAXIMUM_RISK, "a model failed: WordlessError")


def test_a_way_out_that_is_doubted_is_none() -> None:
    out = Leaving(at_start=0.4, added=0.0)
    late = RiskReading(0.3, None, 1.0, "a model", leaving=out)
    assert not ask(Source(late), [1.0], [2.0], 0, LATEST_S).bearable(0.1)
    unknown = RiskReading(0.3, None, 0.001, "a model", doubt="never learned", leaving=out)
    assert not ask(Source(unknown), [1.0], [2.0], 0, LATEST_S).bearable(0.1)


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


def test_a_source_that_says_nothing_is_doubted() -> None:
    answer = ask(Source(None), [], [], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk) == (MAXIMUM_RISK, None)
    assert answer.took_s == 0.0
    assert answer.doubt == answer.detail == "no answer"


def test_a_source_that_fails_is_doubted_and_does_not_end_the_loop() -> None:
    answer = ask(Source(ZeroDivisionError("no bodies")), [], [], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk) == (MAXIMUM_RISK, None)
    assert answer.took_s == 0.0
    assert answer.doubt == answer.detail == "a model failed: ZeroDivisionError: no bodies"


def test_a_late_answer_says_so_and_keeps_the_rest() -> None:
    answer = ask(Source(reading(0.1, 0.05)), [], [], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk, answer.took_s) == (MAXIMUM_RISK, 0.01, 0.05)
    assert answer.detail == answer.doubt == "late: it took 50 ms"


def test_an_answer_of_the_wrong_kind_is_doubted() -> None:
    wrong = RiskReading("low", None, 0.0, "a model")  # type: ignore[arg-type]
    answer = ask(Source(wrong), [], [], 0, LATEST_S)
    assert answer.risk == MAXIMUM_RISK
    assert answer.doubt.startswith("a model failed: TypeError")


@pytest.mark.parametrize("beside", [nan, inf, None])
def test_a_body_point_risk_that_is_no_number_is_not_shown(beside: float | None) -> None:
    answer = ask(Source(reading(body_point_risk=beside)), [], [], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk, answer.doubt) == (0.1, None, "")


def test_without_a_model_nothing_is_claimed() -> None:
    source: RiskSource = NoModel()
    answer = ask(source, [0.0], [1.0], 0, LATEST_S)
    assert (answer.risk, answer.body_point_risk, answer.doubt) == (0.0, None, "")
    assert answer.took_s == 0.0
    assert answer.detail == "nothing is computed"
    said = source.assess([0.0], [1.0], 0)
    assert said is not None
    assert source.name == said.source == "no model"


def test_the_stand_in_can_say_any_risk() -> None:
    assert ask(NoModel(0.7), [], [], 0, LATEST_S).risk == 0.7


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
