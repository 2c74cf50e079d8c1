"""Controllers that learn, and where the tip points: found in the first motions, kept while it
moves."""

from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import ForwardJacobian, load_controller_options
from daemon.control.controller import ControllerError, Observation, steers_direction
from daemon.control.task import angle_between
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.make_controller import make_controller
from daemon.controllers.pointing_jacobian import PointingJacobian
from daemon.learning.forward.pose_kinematics import PoseKinematics
from drivers.pose import Vector
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS
from tests.daemon.controllers.test_learned_kinematics import controller as modelled
from tests.daemon.service.rig import Rig, on_a_rig

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
ROBOT = load_robot(TUBES).robot
CIRCLE = {
    "kind": "circle",
    "center_mm": [36.0, 0.0, 179.0],
    "radius_mm": 5.0,
    "cycle_s": 8.0,
    "pointing": {"kind": "away_from", "point_mm": [-8.0, -12.0, 136.0]},
}
AT = np.array([0.0, 0.5, 1.0, 0.0, 0.0])
SCALE = np.array([1.0, 1.0, 1.0, 20.0, 67.0])
STEP_NS = 25_000_000
TOLD = ForwardJacobian(kind="forward_jacobian")


@pytest.fixture(scope="module")
def tubes() -> PoseKinematics:
    return modelled(adaptation=False).learnt


def made(kind: str, **options: object) -> LearningController:
    controller = make_controller(load_controller_options({"kind": kind, **options}), ROBOT, seed=1)
    assert isinstance(controller, LearningController)
    return controller


def seen(tubes: PoseKinematics, u: Vector, number: int = 0, points: bool = True) -> Observation:
    """The tubes at rest where they shall be, a frame later than the one before."""
    pose = tubes.pose(u)
    still = np.zeros(3)
    return Observation(
        number * STEP_NS, 0.025, u, u, pose.position_mm, still, pose.position_mm, still, True, None,
        pose.direction, pose.direction if points else None, still if points else None,
    )  # fmt: skip


def small_motions(tubes: PoseKinematics, pointing: PointingJacobian, frames: int) -> None:
    random = np.random.default_rng(1)
    for number in range(frames):
        u = AT + 0.05 * SCALE * random.uniform(-1.0, 1.0, 5)
        pointing.observe(seen(tubes, u, number))


def true_rows(tubes: PoseKinematics, u: Vector) -> Vector:
    """(3, m) by differences, directions in mm."""
    steps = 0.01 * np.diag(SCALE)
    rows = [tubes.pose(u + x).direction - tubes.pose(u - x).direction for x in steps]
    return TOLD.pointing_mm_per_rad * np.array(rows).T / 0.02


@pytest.mark.parametrize(
    "kind", ["reward_weighted", pytest.param("forward_jacobian", marks=pytest.mark.long)]
)
def test_the_tip_goes_round_and_points_as_it_is_told(kind: str) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(CIRCLE, {"kind": kind, "babbling": {"duration_s": 10.0}})
        await rig.until_state(OperatingState.ARMED, OperatingState.HOLD, within_s=120.0)
        assert rig.in_state(OperatingState.ARMED), rig.events("cause", "gate_refused")
        tips = [tip for tip in rig.tips if tip.cycle >= 0 and tip.error_mm is not None]
        angles = [tip.error_rad for tip in tips if tip.error_rad is not None]
        assert len(angles) == len(tips)
        assert float(np.mean([tip.error_mm for tip in tips])) < 1.0
        assert np.degrees(np.mean(angles)) < 1.0

    on_a_rig(scene, path=TUBES)


def test_small_motions_tell_how_the_direction_answers(tubes: PoseKinematics) -> None:
    pointing = PointingJacobian(TOLD, SCALE)
    assert not pointing.known
    small_motions(tubes, pointing, 200)
    pointing.begin()
    assert pointing.rows is not None
    true = true_rows(tubes, AT)
    assert np.linalg.norm(pointing.rows * SCALE - true) < 0.1 * np.linalg.norm(true)


def test_on_the_way_it_is_corrected(tubes: PoseKinematics) -> None:
    corrected, kept = PointingJacobian(TOLD, SCALE), PointingJacobian(TOLD, SCALE)
    for one in (corrected, kept):
        small_motions(tubes, one, 200)
        one.begin()
    random, way = np.random.default_rng(2), np.array([0.3, 0.9, -0.7, 1.0, -20.0])
    for number in range(800):
        u = AT + number / 800 * way + 0.02 * SCALE * np.sin(0.2 * number + random.uniform(size=5))
        corrected.observe(seen(tubes, u, number))
    true = true_rows(tubes, AT + way)
    assert corrected.rows is not None and kept.rows is not None
    off, before = (np.linalg.norm(one.rows * SCALE - true) for one in (corrected, kept))
    assert off < 0.5 * before


def test_a_direction_that_is_hidden_is_told(tubes: PoseKinematics) -> None:
    pointing = PointingJacobian(TOLD, SCALE)
    small_motions(tubes, pointing, 99)
    for number in range(200):
        pointing.observe(seen(tubes, AT, number)._replace(tip_direction=None))
    with pytest.raises(ControllerError, match="showed the tip's direction 99 times"):
        pointing.begin()


def babbled(tubes: PoseKinematics, one: LearningController, points: bool) -> int:
    """Steps until it is ready, with axes that follow it."""
    u, number = AT.copy(), 0
    one.reset(seen(tubes, u, points=points))
    while not one.ready:
        here = seen(tubes, u, number, points)
        one.observe(here)
        u, number = u + one.propose(here).delta_u, number + 1
        assert number < 2000
    return number


def test_what_is_seen_while_it_is_held_is_no_first_motion(tubes: PoseKinematics) -> None:
    one = made("forward_jacobian", babbling={"duration_s": 8.0}, lead=False)
    one.reset(seen(tubes, AT))
    u = AT.copy()
    for number in range(40):
        here = seen(tubes, u, number)
        one.observe(here)
        u = u + one.propose(here).delta_u
    kept = len(one._pointing._first)
    for number in range(40, 2000):
        one.observe(seen(tubes, u, number))
        one.learn()
    assert len(one._pointing._first) <= kept + 2, "the last one is taken in after the next"


def turned(tubes: PoseKinematics, one: LearningController) -> float:
    """rad that are left of 0.1 rad after some steps."""
    u = AT.copy()
    wanted = tubes.pose(AT).direction + 0.1 * np.cross(tubes.pose(AT).direction, [0.0, 0.0, 1.0])
    wanted /= np.linalg.norm(wanted)

    def told(number: int) -> Observation:
        at = tubes.pose(AT).position_mm
        here = seen(tubes, u, 10_000 + number)
        return here._replace(reference_mm=at, reference_direction=wanted)

    one.reset(told(0))
    for number in range(160):
        here = told(number)
        one.observe(here)
        u = u + one.propose(here).delta_u
    return angle_between(tubes.pose(u).direction, wanted)


def test_a_hand_that_points_a_tip_that_is_led_is_told_that_small_motions_come_first(
    tubes: PoseKinematics,
) -> None:
    one = made("forward_jacobian", babbling={"duration_s": 8.0}, lead=False)
    babbled(tubes, one, points=False)
    one.propose(seen(tubes, AT, 3000, points=False))
    pointed = seen(tubes, AT, 3001)
    one.observe(pointed)
    with pytest.raises(ControllerError, match="resume, and small motions show it"):
        one.propose(pointed)
    assert babbled(tubes, one, points=False) > 300, "what it was asked for once is not forgotten"
    assert turned(tubes, one) < 0.02


def test_a_hand_that_points_during_first_motions_has_them_show_what_turns_the_tip(
    tubes: PoseKinematics,
) -> None:
    one, u = made("forward_jacobian", babbling={"duration_s": 8.0}, lead=False), AT.copy()
    one.reset(seen(tubes, u, points=False))
    for number in range(300):
        here = seen(tubes, u, number, points=False)
        one.observe(here)
        u = u + one.propose(here).delta_u
    while not one.ready:
        number += 1
        here = seen(tubes, u, number)
        one.observe(here)
        u = u + one.propose(here).delta_u
    assert number > 600
    assert one._pointing.known


@pytest.mark.parametrize("kind", ["forward_jacobian", "reward_weighted"])
def test_who_knows_only_where_the_tip_goes_finds_out_what_turns_it_and_keeps_it(
    kind: str, tubes: PoseKinematics, tmp_path: Path
) -> None:
    one = made(kind, babbling={"duration_s": 8.0}, lead=False)
    assert babbled(tubes, one, points=False) > 300
    assert babbled(tubes, one, points=False) == 0
    assert babbled(tubes, one, points=True) > 300, "it did not look where the tip pointed"
    assert turned(tubes, one) < 0.02
    one.save(tmp_path / "learnt.npz")
    kept = str(tmp_path / "learnt.npz")
    again = made(kind, model=kept, pointing_mm_per_rad=50.0, lead=False)
    assert babbled(tubes, again, points=True) == 0
    first, other = one._pointing.rows, again._pointing.rows
    assert first is not None and other is not None
    np.testing.assert_allclose(other, 2.0 * first)
    assert turned(tubes, again) < 0.02


def test_the_paper_s_law_leads_the_tip_and_no_direction() -> None:
    assert steers_direction(made("reward_weighted"))
    assert not steers_direction(made("reward_weighted", paper=True))
