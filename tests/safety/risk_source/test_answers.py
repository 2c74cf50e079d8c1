"""Which answers about risk are believed, and what stands in for the others."""

from math import inf, nan

import pytest

from safety.risk_source import (
    GIVEN_TIP,
    MAXIMUM_RISK,
    Leaving,
    Nearest,
    NoModel,
    RiskAnswers,
    RiskReading,
    RiskSource,
    ask,
    believed,
    name_of,
)
from tests.safety.risk_source.source import LATEST_S, Source


def reading(
    risk: float = 0.1, took_s: float = 0.001, body_point_risk: float | None = 0.01
) -> RiskReading:
    return RiskReading(risk, body_point_risk, took_s, "a model", "as trained")


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
