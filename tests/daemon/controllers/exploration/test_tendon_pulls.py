"""Each of many tendons is pulled a little; what most of their motions strain is left out then."""

import numpy as np
import pytest

from config.loader import load_robot
from config.robot import Robot
from config.tasks.controllers import Broyden, TipFollowing
from config.tasks.exploration import DesignedExploration, MotorBabbling
from daemon.control.controller import Observation
from daemon.control.tip_following import TipFollower
from daemon.controllers.broyden import BroydenController
from daemon.controllers.exploration.designed_exploration import DesignedExplorationController
from daemon.controllers.exploration.excursions import Excursions
from daemon.controllers.exploration.motor_babbling import Babbling
from daemon.controllers.exploration.tendon_pulls import TendonPulls
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S

FOUR = load_robot(SHIPPED_ROBOTS / "tendon_arm.yaml").robot
TENDONS = 8
ANGLES = 2.0 * np.pi * np.arange(TENDONS) / TENDONS
BENDS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES)]) / np.sqrt(0.5 * TENDONS)
STIFF_N_MM, SOFT_N_MM, STRUNG_N = 8.0, 0.2, 2.5
STIFFNESS = STIFF_N_MM * np.eye(TENDONS) - (STIFF_N_MM - SOFT_N_MM) * BENDS @ BENDS.T
"""N/mm of eight straight tendons, all of which but two ways to bend strain them."""
COUNTS_PER_MM = 60.0
TIP = np.array([0.0, 0.0, 195.0])


def robot(count: int = TENDONS) -> Robot:
    first = FOUR.axes[0]
    axes = [
        first.model_copy(
            update={
                "name": f"tendon_{node}",
                "drive": first.drive.model_copy(update={"node": node}),
            }
        )
        for node in range(1, 1 + count)
    ]
    return FOUR.model_copy(update={"axes": axes})


def seen(targets: Vector, known: bool = True, strung_n: float = STRUNG_N) -> Observation:
    """Of drives that go by whole counts."""
    u = np.round(targets * COUNTS_PER_MM) / COUNTS_PER_MM
    tensions_n = strung_n + STIFFNESS @ u if known else None
    still = np.zeros(3)
    return Observation(0, DT_S, u, u, TIP, still, TIP, still, tensions_n=tensions_n)


def pulled_through(pulls: TendonPulls, strung_n: float = STRUNG_N) -> Vector:
    """(n, m) where the axes were told to be, until it was done."""
    targets, places = np.zeros(TENDONS), [np.zeros(TENDONS)]
    pulls.begin()
    while not pulls.done and len(places) < 60.0 * TENDONS / DT_S:
        observation = seen(targets, strung_n=strung_n)
        targets = observation.targets + pulls.propose(observation)
        targets = np.round(targets * COUNTS_PER_MM) / COUNTS_PER_MM
        places.append(targets)
    return np.array(places)


@pytest.fixture(scope="module")
def known() -> AxisRanges:
    pulls = TendonPulls.of(robot(), AxisRanges.of(robot()))
    assert pulls is not None
    pulled_through(pulls)
    assert pulls.done
    return pulls.axes


def test_few_tendons_need_no_such_pulls() -> None:
    assert TendonPulls.of(FOUR, AxisRanges.of(FOUR)) is None


def test_one_after_the_other_is_pulled_a_little_and_let_go_again() -> None:
    pulls = TendonPulls(robot(), AxisRanges.of(robot()))
    places = pulled_through(pulls)
    assert pulls.done and pulls.note == ""
    assert ((np.abs(places) > 0.1).sum(axis=1) <= 1).all()
    assert (places.max(axis=0) > 0.1).all() and places.max() < 1.0
    assert (STRUNG_N + places @ STIFFNESS).min() > 0.5
    np.testing.assert_allclose(places[-1], 0.0, atol=0.1)


def test_a_pull_ends_before_it_takes_its_neighbours_tension() -> None:
    pulls, strung_n = TendonPulls(robot(), AxisRanges.of(robot())), 0.2
    places = pulled_through(pulls, strung_n)
    assert pulls.done
    assert (strung_n + places @ STIFFNESS).min() > 0.2 * strung_n


def test_what_bends_is_left_and_what_strains_is_not(known: AxisRanges) -> None:
    for bend in BENDS.T:
        np.testing.assert_allclose(known.less_together(bend, 0.0), bend, atol=0.1)
    strain = np.where(np.arange(TENDONS) % 2 == 0, 1.0, -1.0)
    assert np.abs(known.less_together(strain, 0.0)).max() < 0.1
    assert np.abs(known.unstrained(np.tile(strain, (3, 1)))).max() < 0.1


def test_first_motions_of_many_tendons_bend_the_body_and_slacken_none(known: AxisRanges) -> None:
    babbling, targets = Babbling(MotorBabbling(), known, seed=1), np.zeros(TENDONS)
    places = []
    while not babbling.done:
        targets = targets + babbling.propose(seen(targets))
        places.append(targets)
    assert (STRUNG_N + np.array(places) @ STIFFNESS).min() > 1.0
    assert (np.ptp(np.array(places) @ BENDS, axis=0) > 1.0).all()


def test_how_far_tendons_that_strain_each_other_moved_the_tip_slows_no_step(
    known: AxisRanges,
) -> None:
    law = TipFollower(TipFollowing(max_tip_speed_mm_s=100.0), robot())
    law.axes = known
    strain = np.where(np.arange(TENDONS) % 2 == 0, 1.0, -1.0)
    bends = np.vstack([8.0 * BENDS.T, np.zeros(TENDONS)])
    jacobian = bends + 25.0 * np.outer(np.ones(3), strain)
    wanted = np.array([0.3, -0.2, 0.0])
    step = law.axis_step(jacobian, wanted, seen(np.zeros(TENDONS)), np.zeros(TENDONS))
    np.testing.assert_allclose(bends @ step, wanted, atol=0.02)


def test_an_exploration_of_many_tendons_pulls_first_and_has_all_of_its_time_then() -> None:
    options = DesignedExploration(kind="designed_exploration", duration_s=4.0)
    control, targets = DesignedExplorationController(options, robot(), 1), np.zeros(TENDONS)
    control.reset(seen(targets))
    notes: list[str] = []
    moved = 0
    while not control.ready and len(notes) < 120.0 / DT_S:
        proposal = control.propose(seen(targets))
        moved += len(notes) > 0 and proposal.note.startswith("tries")
        targets = seen(targets).targets + proposal.delta_u
        notes.append(proposal.note)
    assert notes[0] == "finds how tendon_1 strains the others"
    assert control.ready and moved == pytest.approx(4.0 / DT_S, abs=3)


def test_what_a_controller_without_a_model_measures_of_many_tendons_slackens_none(
    known: AxisRanges,
) -> None:
    excursions, targets = Excursions(Broyden(kind="broyden", lead=True), known), np.zeros(TENDONS)
    truth = np.vstack([8.0 * BENDS.T, np.zeros(TENDONS)])
    places: list[Vector] = []
    while not excursions.done:
        now = seen(targets)._replace(t_ns=round(len(places) * DT_S * 1e9))
        excursions.observe(now._replace(tip_mm=TIP + truth @ now.u))
        targets = targets + excursions.propose(now)
        places.append(targets)
    assert (STRUNG_N + np.array(places) @ STIFFNESS).min() > 1.0
    found = excursions.jacobian / known.scale
    np.testing.assert_allclose(found @ BENDS, truth @ BENDS, atol=0.3)


def test_a_controller_without_a_model_pulls_many_tendons_first() -> None:
    controller = BroydenController(Broyden(kind="broyden", lead=True), robot())
    controller.reset(seen(np.zeros(TENDONS)))
    assert "strains" in controller.propose(seen(np.zeros(TENDONS))).note


def test_nothing_is_pulled_while_nobody_knows_the_tensions() -> None:
    pulls = TendonPulls(robot(), AxisRanges.of(robot()))
    assert not pulls.propose(seen(np.zeros(TENDONS), known=False)).any()
