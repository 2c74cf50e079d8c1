"""What the gate makes of the risk, what its last check finds, and which bodies may be energised."""

from collections.abc import Sequence
from math import nan

import pytest

from safety import gate
from safety.gate import RISK, RISK_UNAVAILABLE, Gate, Measured
from safety.limits import Violation
from safety.permit import PermittedHoming, PermittedStep, permit
from safety.risk_source import GIVEN_TIP, Leaving, RiskAnswers, RiskReading
from tests.safety.gate.gate_rig import (
    LATEST_S,
    LIMITS,
    NEAREST,
    STEP_NS,
    THRESHOLD,
    Rig,
    ToldRisk,
    change,
    risky_beyond,
)

# Risk.


def test_the_risk_is_asked_for_the_whole_way_until_the_body_has_stopped() -> None:
    rig = Rig(2)
    rig.run_up(90_000, 10_000)
    rig.risk.asked.clear()
    start = list(rig.at)
    rig.decide(start[0] + 500, start[1] - 500, measured=rig.measured(start[0] - 40, start[1]))
    u_from, u_to, t_ns = rig.risk.asked[0]
    assert u_from == [(start[0] - 40) / 2000.0, start[1] / 2000.0]
    braking = 500 * 500 / 2 / 125
    assert u_to == [(start[0] + 500 + braking) / 2000.0, (start[1] - 500 - braking) / 2000.0]
    assert t_ns == rig.t_ns
    assert len(rig.risk.asked) == 1


def test_a_risk_at_the_threshold_may_be_taken() -> None:
    decision = Rig(risk=ToldRisk(THRESHOLD)).decide(50_100)
    assert (change(decision), decision.risk, decision.refused) == (100, THRESHOLD, "")
    assert decision.body_point_risk == THRESHOLD / 10
    assert decision.nearest is NEAREST


@pytest.mark.parametrize(("wall", "changed"), [(50_140.0, 100), (50_139.9, 50), (50_059.9, 25)])
def test_a_step_is_shortened_until_its_risk_may_be_taken(wall: float, changed: int) -> None:
    rig = Rig(risk=risky_beyond(wall / 2000.0))
    decision = rig.decide(50_100)
    assert (change(decision), decision.refused) == (changed, "")
    assert decision.limits == ((RISK,) if changed < 100 else ())
    assert decision.scale == changed / 100
    assert (decision.risk, decision.risk_detail) == (0.0, "a wall")


def test_a_body_that_touches_something_may_leave_it() -> None:
    out = Leaving(at_start=0.8, added=0.003)
    rig = Rig(risk=ToldRisk(lambda _, __: RiskReading(0.8, 0.1, 0.001, "told", leaving=out)))
    decision = rig.decide(50_100)
    assert (change(decision), decision.risk, decision.refused) == (100, 0.8, "")
    assert decision.limits == ()
    assert len(rig.risk.asked) == 1


def test_a_body_that_leaves_one_thing_is_not_led_into_another() -> None:
    def between(_: object, u_to: Sequence[float]) -> RiskReading:
        added = 0.0 if u_to[0] < 50_070 / 2000.0 else 0.5
        return RiskReading(0.8, 0.1, 0.001, "told", leaving=Leaving(at_start=0.8, added=added))

    rig = Rig(risk=ToldRisk(between))
    decision = rig.decide(50_100)
    assert (change(decision), decision.limits) == (50, (RISK,))


def test_a_step_of_which_no_part_is_safe_is_refused_and_braked() -> None:
    rig = Rig()
    rig.run_up(90_000)
    rig.risk.risk = 0.051
    rig.risk.asked.clear()
    decision = rig.decide(90_000)
    assert (decision.refused, decision.risk, decision.scale) == (RISK, 0.051, 0.0)
    assert decision.risk_detail == "as told"
    assert decision.body_point_risk == pytest.approx(0.0051)
    assert decision.nearest is NEAREST
    assert "velocity: axis 0" in decision.limits
    assert change(decision) == 375
    assert len(rig.risk.asked) == 3


def test_a_shortened_step_keeps_to_the_acceleration() -> None:
    rig = Rig()
    rig.run_up(90_000)
    at = rig.at[0]
    brakes = (at + 375 + 375 * 375 / 250) / 2000.0
    rig.risk.risk = risky_beyond(brakes).risk
    decision = rig.decide(90_000)
    assert (change(decision), decision.limits) == (375, ("velocity: axis 0", RISK))


@pytest.mark.parametrize("threshold", [0.05, 1.0])
def test_a_risk_that_is_not_known_refuses_whatever_the_threshold(threshold: float) -> None:
    risk = ToldRisk(lambda _, __: None)
    one = Gate([LIMITS], [2000.0], [None], risk, threshold, LATEST_S)
    decision = one.decide([50_100], Measured([50_000], [None]), 0, STEP_NS)
    assert change(decision) == 0
    assert (decision.refused, decision.risk) == (RISK_UNAVAILABLE, 1.0)
    assert decision.risk_detail == "no answer"
    assert len(risk.asked) == 1, "what gave no answer is not asked again"


def test_a_source_that_fails_refuses() -> None:
    def fail(_: object, __: object) -> RiskReading:
        raise ValueError("not a body")

    decision = Rig(risk=ToldRisk(fail)).decide(50_100)
    assert (decision.refused, decision.risk, change(decision)) == (RISK_UNAVAILABLE, 1.0, 0)
    assert decision.risk_detail == "told failed: ValueError: not a body"


def test_all_answers_together_have_the_time_of_one() -> None:
    def slow(_: object, u_to: Sequence[float]) -> RiskReading:
        return RiskReading(float(u_to[0] > 50_059.9 / 2000.0), None, took_s, "told")

    took_s = LATEST_S / 3 - 1e-6
    assert not Rig(risk=ToldRisk(slow)).decide(50_100).refused
    took_s = LATEST_S / 3 + 1e-6
    decision = Rig(risk=ToldRisk(slow)).decide(50_100)
    assert decision.refused == RISK_UNAVAILABLE
    assert "late" in decision.risk_detail


def test_a_hold_is_not_asked_about() -> None:
    rig = Rig(risk=ToldRisk(1.0))
    assert change(rig.hold()) == 0
    assert rig.risk.asked == []


# The last check.


def test_what_the_last_check_finds_is_braked(monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[object] = []

    def check(**arguments: object) -> object:
        if not found:
            found.append(arguments["to_counts"])
            return (Violation(0, "velocity", 2, 1), Violation(1, "acceleration", 2, 1))
        return permit(**arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(gate, "permit", check)
    decision = Rig(2).decide(50_100, 50_200)
    assert found == [[50_100, 50_125]]
    assert [change(decision, axis) for axis in range(2)] == [0, 0]
    assert decision.refused == "axis 0: velocity 2 is beyond 1; axis 1: acceleration 2 is beyond 1"
    assert (decision.scale, decision.risk) == (0.0, 0.0)
    assert decision.limits == ("acceleration: axis 1",)


def test_a_refused_step_is_not_remembered() -> None:
    rig = Rig()
    assert rig.decide(50_100, measured=rig.measured(10_000)).step is None
    decision = rig.decide(50_100)
    assert isinstance(decision.step, PermittedStep)
    assert decision.step.from_counts == (50_000,)


# Homing.


def test_only_axes_that_exist_are_homed() -> None:
    rig = Rig(2)
    permitted = rig.gate.permit_homing(1, [0, 0])
    assert isinstance(permitted, PermittedHoming)
    assert permitted.axis == 1
    assert rig.gate.permit_homing(0, [None, None]).axis == 0
    for axis in (-1, 2):
        with pytest.raises(ValueError, match=f"no axis {axis}"):
            rig.gate.permit_homing(axis, [0, 0])
    with pytest.raises(ValueError, match="1 places for 2 axes"):
        rig.gate.permit_homing(0, [0])


# At rest.


def test_a_body_at_rest_is_asked_about_where_it_is_measured() -> None:
    rig = Rig(2)
    assert rig.gate.refuses_rest(rig.measured(2000, -4000), 77) == ""
    assert rig.risk.asked == [([1.0, -2.0], [1.0, -2.0], 77)]


def test_a_body_at_rest_that_touches_may_not_be_energised() -> None:
    assert Rig(risk=ToldRisk(THRESHOLD)).gate.refuses_rest(Rig().measured(), 0) == ""
    refused = Rig(risk=ToldRisk(0.051)).gate.refuses_rest(Rig().measured(), 0)
    assert refused == (
        "the body touches something where it stands, or may at any moment: clearance 2.0 mm at "
        "150 mm along the body, there (0, 1, 2) mm; the risk is 0.051, and 0.05 is allowed"
    )


@pytest.mark.parametrize(("detail", "where"), [("a wall", "a wall"), ("", "it is not known where")])
def test_where_nobody_says_the_place_what_is_said_stands_for_it(detail: str, where: str) -> None:
    source = ToldRisk(lambda _from, _to: RiskReading(0.9, None, 0.001, "told", detail))
    refused = Rig(risk=source).gate.refuses_rest(Rig().measured(), 0)
    assert f"at any moment: {where}; the risk is 0.9" in refused


def test_the_answers_that_the_risk_is_one_of_go_with_the_decision() -> None:
    answers = RiskAnswers(0.3, 0.01, GIVEN_TIP)
    told = RiskReading(0.01, None, 0.001, "told", answers=answers)
    rig = Rig(risk=ToldRisk(lambda _from, _to: told))
    assert rig.decide(50_100).answers is answers
    assert rig.gate.hold(rig.measured(), 0, STEP_NS).answers is None


def test_a_way_out_does_not_make_a_contact_at_rest_bearable() -> None:
    out = Leaving(at_start=0.9, added=0.0)
    source = ToldRisk(lambda _from, _to: RiskReading(0.9, None, 0.001, "told", leaving=out))
    assert Rig(risk=source).gate.refuses_rest(Rig().measured(), 0)


def test_a_body_whose_risk_is_not_known_may_not_be_energised() -> None:
    assert Rig(risk=ToldRisk(nan)).gate.refuses_rest(Rig().measured(), 0) == (
        "the risk of touching something is not known here: nan is not a probability"
    )
    late = ToldRisk(lambda _from, _to: RiskReading(0.0, None, 1.0, "told"))
    assert "late" in Rig(risk=late).gate.refuses_rest(Rig().measured(), 0)


def test_a_body_that_is_not_measured_may_not_be_energised() -> None:
    rig = Rig(2)
    assert rig.gate.refuses_rest(rig.measured(0, None), 0) == "not measured: axis 1"
    assert rig.risk.asked == []
