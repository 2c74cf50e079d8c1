"""Both risks of a way, from models of a body in surroundings: what decides, and what is unknown."""

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.shapes import box, joined
from safety.risk.body_risk import BodyRisk, WayRisk
from safety.risk.contact import ContactModel
from safety.risk.model.risk_model import RiskModel, risk_model
from safety.risk.moving_obstacles import MovingBall, Swept
from safety.risk.seen_tip import TipConditioning
from safety.risk.surroundings.distance_grid import DistanceGrid, distance_grid
from safety.risk.surroundings.environment import Environment, environment
from safety.risk_source import GIVEN_TIP, MODEL, SHIFTED, RiskAnswers
from tests.safety.risk.networks import Arrays, model_arrays

INSIDE = (0.0, 0.0, 0.0, 0.0)
ARC_MM = np.linspace(0.0, 200.0, 11)


def arrays() -> Arrays:
    """A straight body of 200 mm whose free end the first input moves along x, 10 mm per unit."""
    made = model_arrays(coefficients=2)
    for name, array in made.items():
        if name.startswith("shapes/") and name.endswith(("weight", "bias")):
            array[:] = 0.0
    made |= {
        "shapes/input_offset": np.zeros(4),
        "shapes/input_scale": np.ones(4),
        "shapes/output_offset_mm": np.zeros(2),
        "shapes/output_scale_mm": np.array(10.0),
        "points/input_scale": np.ones(4),
        "basis/modes": modes(),
        "basis/radius_mm": np.full(11, 5.0),
        "basis/left_out_mm": np.zeros(11),
        "training/inputs": np.array([[first, 0.0, 0.0, 0.0] for first in np.arange(-6.0, 6.1)]),
        "training/reach": np.array(0.8),
    }
    made["shapes/log_diagonal_limits"][:] = (-2.0, 4.0)
    passed_on(made)
    return made


def modes() -> np.ndarray:
    made = np.zeros((2, 11, 3))
    made[0, :, 0] = made[1, :, 1] = ARC_MM / ARC_MM[-1]
    return made


def passed_on(made: Arrays) -> None:
    """The shapes' network says that both components' first coefficient is the first input."""
    trunk, means = made["shapes/trunk.0.weight"], made["shapes/means.0.weight"]
    trunk[0, 0], trunk[1, 0] = 1.0, -1.0  # rectified apart, put together again
    for row in (0, 2):
        means[row, 0], means[row, 1] = 1.0, -1.0


@pytest.fixture(scope="module")
def model() -> RiskModel:
    return risk_model(arrays(), "silu", "relu")


@pytest.fixture(scope="module")
def block() -> Environment:
    """A solid block from x = 40 mm on, near the body's end."""
    return environment(*box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4))


@pytest.fixture(scope="module")
def grid(block: Environment) -> DistanceGrid:
    return distance_grid(block, 2.0, 20.0)


@pytest.fixture
def risk(model: RiskModel, block: Environment, grid: DistanceGrid) -> BodyRisk:
    return BodyRisk(model, block, grid, samples=500)


def told(risk: BodyRisk, u_from: tuple[float, ...], u_to: tuple[float, ...]) -> WayRisk:
    answer = risk.of_way(u_from, u_to)
    assert isinstance(answer, WayRisk), answer
    return answer


def at(first: float) -> tuple[float, ...]:
    return (first, 0.0, 0.0, 0.0)


def test_far_from_everything_no_shape_touches(risk: BodyRisk) -> None:
    answer = told(risk, at(-3.0), at(-2.9))
    assert answer.contact.touching == 0
    assert answer.contact.upper_limit == pytest.approx(3.0 / 500, rel=0.1)
    assert answer.contact.median_mm > 30.0


def test_the_body_point_risk_is_told_beside_it(risk: BodyRisk) -> None:
    beside = risk.beside(at(-2.9))
    assert beside is not None
    assert beside.means_mm.shape == (5, 3)
    assert 0.0 <= beside.body_point_risk <= 1.0
    assert risk.beside(at(8.0)) is None


def test_the_nearer_the_end_of_the_way_the_higher_the_risk(risk: BodyRisk) -> None:
    risks = [told(risk, at(0.0), at(end)).contact.upper_limit for end in (1.0, 3.0, 5.0)]
    assert risks[0] < 0.05
    assert risks[0] <= risks[1] < risks[2]
    assert risks[2] > 0.9


def test_what_is_touched_on_the_way_counts_though_both_ends_are_free(
    model: RiskModel, risk: BodyRisk
) -> None:
    thin = environment(*box((4.0, 60.0, 60.0), (25.0, 0.0, 200.0), 4))
    between = BodyRisk(model, thin, distance_grid(thin, 2.0, 20.0), samples=500)
    free = [told(between, at(place), at(place)).contact.touching for place in (-1.5, 5.5)]
    assert max(free) < 50
    assert told(between, at(-1.5), at(5.5)).contact.touching > 400


def test_it_says_where(risk: BodyRisk) -> None:
    worst = told(risk, at(2.0), at(2.5)).contact.worst
    assert worst.arc_mm == 200.0
    assert worst.nearest_mm[0] == pytest.approx(40.0, abs=2.5)


@pytest.mark.parametrize(
    "u", [at(8.0), (0.0, 2.0, 0.0, 0.0), at(np.nan), at(np.inf)], ids=["far", "aside", "nan", "inf"]
)
def test_outside_what_was_learned_nobody_knows(risk: BodyRisk, u: tuple[float, ...]) -> None:
    for way in ((INSIDE, u), (u, INSIDE)):
        answer = risk.of_way(*way)
        assert isinstance(answer, str)
        assert "outside what the model has learned: u = (" in answer


def test_a_network_that_has_no_finite_answer_knows_nothing(
    block: Environment, grid: DistanceGrid
) -> None:
    broken = arrays()
    broken["shapes/means.0.weight"][0, 0] = 1e38
    broken["shapes/output_scale_mm"] = np.array(1e300)
    answer = BodyRisk(risk_model(broken, "silu", "relu"), block, grid).of_way(INSIDE, at(5.0))
    assert isinstance(answer, str)
    assert "no finite answer at u = (5, 0, 0, 0)" in answer


def test_the_same_question_has_the_same_answer_whatever_was_asked_before(
    model: RiskModel, block: Environment, grid: DistanceGrid
) -> None:
    def asked(*questions: tuple[float, float]) -> tuple[float, float, float]:
        risk = BodyRisk(model, block, grid, samples=500)
        answers = [told(risk, at(start), at(end)) for start, end in questions]
        last = answers[-1].contact
        return last.probability, last.upper_limit, last.lowest_5_percent_mm

    alone = asked((2.0, 4.0))
    assert asked((2.0, 5.0), (2.0, 3.0), (2.0, 4.0)) == alone
    assert asked((-1.0, 0.0), (2.0, 4.0)) == alone
    assert asked((2.0, 4.0), (2.0, 4.0)) == alone


THRESHOLD = 0.05


def test_far_from_everything_there_is_no_room_to_speak_of(risk: BodyRisk) -> None:
    assert risk.clearance(at(-3.0), THRESHOLD) is None


@pytest.mark.parametrize("u", [at(1.5), at(2.0), at(2.5)])
def test_room_gets_less_along_its_slope_and_with_none_left_the_risk_is_as_high(
    risk: BodyRisk, u: tuple[float, ...]
) -> None:
    clearance = risk.clearance(u, THRESHOLD)
    assert clearance is not None
    assert clearance.u == u
    assert clearance.slope[0] == pytest.approx(-10.0, rel=0.1)  # of x, for each unit
    assert clearance.slope[1:] == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    there = at(u[0] - (clearance.clearance_mm - 3.0) / clearance.slope[0])
    assert told(risk, there, there).contact.upper_limit < THRESHOLD
    beyond = at(u[0] - (clearance.clearance_mm + 4.0) / clearance.slope[0])
    assert told(risk, beyond, beyond).contact.upper_limit > THRESHOLD


def test_a_higher_risk_that_may_be_taken_leaves_more_room(risk: BodyRisk) -> None:
    clearances = [risk.clearance(at(2.5), threshold) for threshold in (0.0, 0.01, 0.1, 0.3)]
    distances = [clearance.clearance_mm for clearance in clearances if clearance is not None]
    assert len(distances) == 4
    assert distances == sorted(distances)
    assert distances[0] < distances[-1] - 1.0


def test_where_the_network_gives_nothing_nobody_knows_the_room(
    block: Environment, grid: DistanceGrid
) -> None:
    broken = arrays()
    broken["shapes/means.0.weight"][0, 0] = 1e38
    broken["shapes/output_scale_mm"] = np.array(1e300)
    risk = BodyRisk(risk_model(broken, "silu", "relu"), block, grid)
    assert risk.clearance(at(5.0), THRESHOLD) is None


def test_a_way_out_of_what_is_touched_says_what_it_adds(risk: BodyRisk) -> None:
    out = told(risk, at(5.0), at(4.0)).leaving
    assert out is not None
    assert out.at_start > 0.9
    assert out.added < 0.02
    for start, end in ((4.0, 5.0), (5.0, 5.0), (-3.0, -4.0)):
        assert told(risk, at(start), at(end)).leaving is None


def test_a_way_out_of_one_thing_into_another_says_that_too(
    model: RiskModel, risk: BodyRisk
) -> None:
    """Deep in a block, through free space to just before a second one, which is passed."""
    behind = box((4.0, 60.0, 60.0), (10.0, 0.0, 200.0), 4)
    two = environment(*joined([box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4), behind]))
    between = BodyRisk(model, two, distance_grid(two, 2.0, 20.0), samples=500)
    through = told(between, at(3.2), at(-2.0)).leaving
    assert through is not None
    assert through.added > 0.3


# A body that was seen to be off from the middle of what it may be.


def test_what_the_body_is_off_by_counts_and_never_makes_the_risk_less(risk: BodyRisk) -> None:
    def at_rest(first: float) -> float:
        told = risk.of_way(at(first), at(first))
        assert isinstance(told, WayRisk)
        return told.contact.upper_limit

    plain = at_rest(1.5)
    risk.take_as_shifted(np.array([10.0, 0.0]))
    towards = at_rest(1.5)
    risk.take_as_shifted(np.array([-10.0, 0.0]))
    away = at_rest(1.5)
    risk.take_as_shifted(None)
    assert plain < 0.05 < towards
    assert away == plain == at_rest(1.5)


def test_the_room_is_that_of_the_body_as_it_was_seen(risk: BodyRisk) -> None:
    plain = risk.clearance(at(1.5), 0.05)
    risk.take_as_shifted(np.array([5.0, 0.0]))
    shifted = risk.clearance(at(1.5), 0.05)
    risk.take_as_shifted(None)
    assert plain is not None
    assert shifted is not None
    assert shifted.clearance_mm < plain.clearance_mm - 3.0


def test_far_from_everything_the_shift_is_not_asked_for(risk: BodyRisk) -> None:
    far = risk.of_way(at(-5.0), at(-4.9))
    risk.take_as_shifted(np.array([3.0, 0.0]))
    still_far = risk.of_way(at(-5.0), at(-4.9))
    risk.take_as_shifted(None)
    assert isinstance(far, WayRisk)
    assert isinstance(still_far, WayRisk)
    assert still_far.contact.lowest_1_percent_mm == far.contact.lowest_1_percent_mm


# A body whose tip is measured.


@pytest.fixture
def seeing(model: RiskModel, block: Environment, grid: DistanceGrid) -> BodyRisk:
    given = TipConditioning(model.basis, 0.5, 0.05)
    return BodyRisk(model, block, grid, samples=500, given=given)


def see(risk: BodyRisk, model: RiskModel, first: float, off_mm: float, agrees: bool) -> None:
    """At the first input's place, so much nearer to the block than the mean is."""
    mixture = model.shapes.mixture(at(first))
    assert mixture is not None
    basis = model.basis
    mean = mixture.weights @ mixture.means_mm
    tip = basis.base_mm[-1] + mean @ basis.modes[:, -1] + np.array([off_mm, 0.0, 0.0])
    risk.see(mixture, tip, None, agrees)


def test_a_tip_that_is_farther_away_than_it_might_be_lets_through_what_the_model_refuses(
    seeing: BodyRisk, model: RiskModel
) -> None:
    alone = told(seeing, at(2.0), at(2.1))
    assert alone.answers == RiskAnswers(alone.contact.upper_limit, None, MODEL)
    assert alone.contact.upper_limit > 0.05
    see(seeing, model, 2.0, -6.0, agrees=True)
    given = told(seeing, at(2.0), at(2.1))
    assert given.answers.decided_by == GIVEN_TIP
    assert given.answers.given_tip == given.contact.upper_limit < 0.05
    assert given.contact.median_mm == pytest.approx(alone.contact.median_mm + 6.0, abs=1.0)


def test_while_the_tip_decides_the_model_is_asked_in_spare_time(
    seeing: BodyRisk, model: RiskModel
) -> None:
    """With the room, and of the body at rest: no step sweeps the model's own shapes as well."""
    at_rest = told(seeing, at(2.0), at(2.0)).answers
    see(seeing, model, 2.0, -6.0, agrees=True)
    assert told(seeing, at(2.0), at(2.1)).answers.model is None
    seeing.clearance(at(2.0), THRESHOLD)
    beside = told(seeing, at(2.0), at(2.1)).answers
    assert (beside.model, beside.decided_by) == (at_rest.model, GIVEN_TIP)
    see(seeing, model, 2.0, -6.0, agrees=False)
    assert told(seeing, at(2.0), at(2.0)).answers.model == at_rest.model
    seeing.clearance(at(2.0), THRESHOLD)
    see(seeing, model, 2.0, -6.0, agrees=True)
    assert told(seeing, at(2.0), at(2.1)).answers.model is None, "none of long ago"


def test_a_tip_that_is_nearer_makes_the_risk_higher(seeing: BodyRisk, model: RiskModel) -> None:
    alone = told(seeing, at(1.0), at(1.1)).contact.upper_limit
    see(seeing, model, 1.0, 26.0, agrees=True)
    assert alone < 0.05 < 0.9 < told(seeing, at(1.0), at(1.1)).contact.upper_limit


def test_against_the_model_a_tip_only_makes_the_risk_higher(
    seeing: BodyRisk, model: RiskModel
) -> None:
    alone = told(seeing, at(2.0), at(2.1))
    see(seeing, model, 2.0, -6.0, agrees=False)
    away = told(seeing, at(2.0), at(2.1))
    assert away.answers.decided_by == MODEL
    assert away.contact.upper_limit == alone.contact.upper_limit
    assert away.answers.given_tip is not None
    assert away.answers.given_tip < 0.05
    see(seeing, model, 2.0, 16.0, agrees=False)
    nearer = told(seeing, at(2.0), at(2.1))
    assert nearer.answers.decided_by == GIVEN_TIP
    assert nearer.contact.upper_limit > alone.contact.upper_limit


def test_against_the_model_the_body_that_is_off_everywhere_is_asked_for_as_well(
    seeing: BodyRisk, model: RiskModel
) -> None:
    plain = told(seeing, at(1.5), at(1.5)).contact.upper_limit
    see(seeing, model, 1.5, -3.0, agrees=True)
    seeing.take_as_shifted(np.array([10.0, 0.0]))
    assert told(seeing, at(1.5), at(1.5)).answers.decided_by == GIVEN_TIP
    see(seeing, model, 1.5, -3.0, agrees=False)
    shifted = told(seeing, at(1.5), at(1.5))
    assert shifted.answers.decided_by == SHIFTED
    assert shifted.contact.upper_limit > 0.05 > plain


def test_a_tip_that_is_no_number_or_forgotten_leaves_the_model_alone(
    seeing: BodyRisk, model: RiskModel
) -> None:
    alone = told(seeing, at(2.0), at(2.1))
    see(seeing, model, 2.0, np.nan, agrees=True)
    assert told(seeing, at(2.0), at(2.1)).answers == alone.answers
    see(seeing, model, 2.0, -6.0, agrees=True)
    seeing.forget_tip()
    assert told(seeing, at(2.0), at(2.1)).answers == alone.answers


def test_who_is_not_to_look_at_tips_does_not(
    risk: BodyRisk, seeing: BodyRisk, model: RiskModel
) -> None:
    see(risk, model, 2.0, -6.0, agrees=True)
    assert told(risk, at(2.0), at(2.1)).answers == told(seeing, at(2.0), at(2.1)).answers


def test_far_from_everything_a_tip_that_fits_decides_and_no_other_is_asked_for(
    seeing: BodyRisk, model: RiskModel
) -> None:
    see(seeing, model, -5.0, 1.0, agrees=True)
    far = told(seeing, at(-5.0), at(-4.9))
    assert far.answers == RiskAnswers(None, far.contact.upper_limit, GIVEN_TIP)
    assert far.contact.not_surely_clear == 0
    see(seeing, model, -5.0, 1.0, agrees=False)
    far = told(seeing, at(-5.0), at(-4.9))
    assert far.answers == RiskAnswers(far.contact.upper_limit, None, MODEL)


def test_who_is_not_to_look_at_tips_makes_no_shapes_for_them(
    model: RiskModel, block: Environment, grid: DistanceGrid, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[object] = []

    class Counted(ContactModel):
        def __init__(self, *arguments: object) -> None:
            made.append(arguments)
            super().__init__(*arguments)  # type: ignore[arg-type]

    for name in ("body_risk", "seen_tip", "way_contact"):
        monkeypatch.setattr(f"safety.risk.{name}.ContactModel", Counted)
    BodyRisk(model, block, grid, samples=50)
    without = len(made)
    BodyRisk(model, block, grid, samples=50, given=TipConditioning(model.basis, 0.5, None))
    assert (without, len(made) - without) == (5, 8)


def test_another_tip_is_another_answer_from_the_same_place(
    seeing: BodyRisk, model: RiskModel
) -> None:
    """Where a way began is remembered, with the tip that it was asked for with."""
    answers = []
    for off_mm in (-6.0, 6.0, -6.0):
        see(seeing, model, 2.0, off_mm, agrees=True)
        answers.append([told(seeing, at(2.0), at(end)).contact.median_mm for end in (2.1, 2.2)])
    assert answers[0] == answers[2] != answers[1]


def test_the_room_is_that_of_the_body_given_its_tip(seeing: BodyRisk, model: RiskModel) -> None:
    alone = seeing.clearance(at(3.4), THRESHOLD)
    see(seeing, model, 3.4, -6.0, agrees=True)
    away = seeing.clearance(at(3.4), THRESHOLD)
    see(seeing, model, 3.4, -6.0, agrees=False)
    against = seeing.clearance(at(3.4), THRESHOLD)
    assert alone is not None
    assert away is not None
    assert away.clearance_mm > alone.clearance_mm + 3.0
    assert away.slope[0] == pytest.approx(-10.0, rel=0.15)
    assert away.parts[0].slope[0] == pytest.approx(-10.0, rel=0.3)
    assert against == alone


def test_given_the_tip_less_of_what_the_basis_leaves_out_is_added(
    block: Environment, grid: DistanceGrid
) -> None:
    """It is among the shapes already; the model alone is as thick as it was."""
    thick = arrays()
    thick["basis/left_out_mm"][:] = 4.0
    model = risk_model(thick, "silu", "relu")
    given = TipConditioning(model.basis, 0.5, None)
    risk = BodyRisk(model, block, grid, samples=500, given=given)
    counts = []
    for one in (risk, BodyRisk(risk_model(arrays(), "silu", "relu"), block, grid, 500, 0, given)):
        see(one, model, 2.6, 7.0, agrees=True)
        one.clearance(at(2.6), THRESHOLD)
        found = told(one, at(2.6), at(2.6))
        assert found.answers.decided_by == GIVEN_TIP
        assert found.answers.given_tip is not None
        assert found.answers.model is not None
        counts.append((found.answers.model, found.answers.given_tip))
    assert counts[0][0] > counts[1][0] + 0.1
    assert 0.0 < counts[0][1] - counts[1][1] < 0.5 * (counts[0][0] - counts[1][0])


def test_among_other_surroundings_the_body_can_still_be_seen(
    seeing: BodyRisk, model: RiskModel
) -> None:
    farther = environment(*box((40.0, 60.0, 60.0), (62.0, 0.0, 200.0), 4))
    other = seeing.among(farther, distance_grid(farther, 2.0, 20.0))
    see(other, model, 3.0, -6.0, agrees=True)
    assert told(other, at(3.0), at(3.1)).answers.decided_by == GIVEN_TIP


def test_what_moves_counts_given_the_tip_as_well(seeing: BodyRisk, model: RiskModel) -> None:
    ball = MovingBall((-40.0, 0.0, 190.0), 5.0, (0.0, 0.0, 0.0))
    seeing.take_moving(Swept.of([(ball, 1.0)]))
    see(seeing, model, -2.9, -1.0, agrees=True)
    free = told(seeing, at(-2.0), at(-1.9))
    assert free.answers.decided_by in (MODEL, GIVEN_TIP)
    assert free.contact.upper_limit < 0.05
    near = told(seeing, at(-2.9), at(-3.0))
    assert near.answers.decided_by == GIVEN_TIP
    assert near.contact.upper_limit > 0.1
    clearance = seeing.clearance(at(-2.7), THRESHOLD)
    assert clearance is not None
    assert clearance.parts == ()
