"""Which answers about risk are believed, and what stands in for the others."""

from collections.abc import Sequence
from math import inf, nan

import pytest

from safety.risk_source import (
    MAXIMUM_RISK,
    Nearest,
    NoModel,
    RiskReading,
    RiskSource,
    ask,
    believed,
)

LATEST_S = 0.02


def reading(
    risk: float = 0.1, took_s: float = 0.001, body_point_risk: float | None = 0.01
) -> RiskReading:
    return RiskReading(risk, body_point_risk, took_s, "a model", "as trained")


class Source:
    """Answers as it is told; an exception is raised."""

    name = "a model"

    def __init__(self, answer: RiskReading | Exception | None) -> None:
        self.answer = answer
        self.asked: list[tuple[Sequence[float], Sequence[float], int]] = []

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        self.asked.append((u_from, u_to, t_ns))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


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
