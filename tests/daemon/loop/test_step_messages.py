"""What a step came from and what became of it is told as it was."""

import numpy as np

from daemon.control.avoidance import Aside
from daemon.loop.step_messages import SLIDING, RequestedStep, RiskAsked, risk_message
from safety.gate import Decision
from safety.risk_source import GIVEN_TIP, Nearest, RiskAnswers, TipComparison

NEAREST = Nearest(3.5, 80.0, (1.0, 2.0, 80.0), (4.5, 2.0, 80.0), ())
DECISION = Decision(None, 0.4, ("velocity: a",), 0.03, 0.01, "told", "", NEAREST)
ASKED = RiskAsked("body", 0.05, None)
STEP = np.array([0.1, 0.2])


def test_a_step_as_it_was_wanted_tells_nothing_of_turning_aside() -> None:
    told = risk_message(7, 1_000, RequestedStep(STEP), DECISION, ASKED)
    assert (told.aside_arc_mm, told.aside_clearance_mm, told.given_up_mm) == (None, None, None)
    assert told.reasons == ["velocity: a"]


def test_a_step_that_was_turned_aside_tells_the_nearest_part_and_what_the_tip_gave_up() -> None:
    aside = Aside(STEP, 120.0, 0.75, 0.04)
    told = risk_message(7, 1_000, RequestedStep(STEP, aside), DECISION, ASKED)
    assert (told.aside_arc_mm, told.aside_clearance_mm, told.given_up_mm) == (120.0, 0.75, 0.04)
    assert told.reasons == ["velocity: a", SLIDING]


def test_where_only_the_whole_body_is_known_its_clearance_is_told() -> None:
    told = risk_message(
        7, 1_000, RequestedStep(STEP, Aside(STEP, None, 0.5, None)), DECISION, ASKED
    )
    assert (told.aside_arc_mm, told.aside_clearance_mm, told.given_up_mm) == (None, 0.5, None)


def test_what_the_gate_was_told_and_made_of_it_stands_beside() -> None:
    compared = TipComparison(0.5, 0.2, 1.25, "")
    told = risk_message(7, 1_000, RequestedStep(STEP), DECISION, ASKED._replace(compared=compared))
    assert (told.sequence, told.t_ns, told.source, told.threshold) == (7, 1_000, "body", 0.05)
    assert (told.scale, told.contact_risk, told.body_point_risk) == (0.4, 0.03, 0.01)
    assert (told.clearance_mm, told.arc_mm, told.means_mm) == (3.5, 80.0, None)
    assert (told.place_mm, told.obstacle_mm) == ([1.0, 2.0, 80.0], [4.5, 2.0, 80.0])
    assert (told.tip_statistic, told.tip_off_mm) == (0.5, 1.25)


def test_which_answer_the_risk_is_stands_beside_the_others() -> None:
    decision = DECISION._replace(answers=RiskAnswers(0.2, 0.03, GIVEN_TIP))
    told = risk_message(7, 1_000, RequestedStep(STEP), decision, ASKED)
    assert (told.model_risk, told.given_tip_risk, told.decided_by) == (0.2, 0.03, "tip")
    alone = risk_message(7, 1_000, RequestedStep(STEP), DECISION, ASKED)
    assert (alone.model_risk, alone.given_tip_risk, alone.decided_by) == (None, None, "")
