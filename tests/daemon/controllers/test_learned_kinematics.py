"""A learnt kinematic model at work in the daemon: model or tracker in the loop, adapting or not."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import LearnedKinematics, load_controller_options
from daemon.control.controller import ControllerError, Observation
from daemon.controllers.learned_kinematics import LearnedKinematicsController
from daemon.learning.forward.pose_kinematics import PoseKinematics
from daemon.learning.forward.pose_model import PoseModel
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.daemon.service.rig import Rig, on_a_rig

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
MODEL = "builtin:concentric_tubes_pose.npz"
CIRCLE = {
    "kind": "circle",
    "center_mm": [36.0, 0.0, 179.0],
    "radius_mm": 8.0,
    "cycle_s": 5.0,
    "pointing": {"kind": "away_from", "point_mm": [-8.0, -12.0, 136.0]},
}
AT = np.array([0.0, 2.0, 1.2, 0.0, 0.0])


def controller(**options: object) -> LearnedKinematicsController:
    asked = load_controller_options({"kind": "learned_kinematics", "model": MODEL, **options})
    assert isinstance(asked, LearnedKinematics)
    return LearnedKinematicsController(asked, load_robot(TUBES).robot)


@cache
def nominal() -> PoseKinematics:
    """The model as it was learnt."""
    return controller(adaptation=False).learnt


def observed(u: np.ndarray, off_mm: float = 0.0, **changes: object) -> Observation:
    """A tip that is where the model has it, but for `off_mm` along x."""
    pose = nominal().pose(u)
    tip = pose.position_mm + np.array([off_mm, 0.0, 0.0])
    still = Observation(
        0, 0.025, u, u, tip, np.zeros(3), tip, np.zeros(3), True, None, pose.direction
    )
    return still._replace(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("pointing", [False, True])
def test_the_step_leads_the_tip_where_the_reference_is(pointing: bool) -> None:
    here = observed(AT)
    there = here.tip_mm + np.array([1.0, -0.5, 0.4])
    changes: dict[str, object] = {"reference_mm": there}
    if pointing:
        changes["reference_direction"] = here.tip_direction
        changes["reference_turn"] = np.zeros(3)
    own = controller(adaptation=False, gain_per_s=4.0, damping_mm=1.0)
    own.reset(here)
    step = own.propose(here._replace(**changes)).delta_u  # type: ignore[arg-type]
    moved = own.learnt.pose(AT + step)
    np.testing.assert_allclose(
        moved.position_mm - here.tip_mm, 0.1 * (there - here.tip_mm), atol=0.02
    )
    if pointing:
        assert here.tip_direction is not None
        assert moved.direction @ here.tip_direction == pytest.approx(1.0, abs=1e-5)


def test_with_the_model_in_the_loop_a_tip_that_is_elsewhere_moves_nothing() -> None:
    """It believes its model: only learning from the tracker would change its mind."""
    off = observed(AT, off_mm=4.0)
    reference = {"reference_mm": observed(AT).tip_mm}
    for feedback, moves in (("model", False), ("tracker", True)):
        own = controller(adaptation=False, feedback=feedback, posture_gain_per_s=0.0)
        own.reset(off)
        step = own.propose(off._replace(**reference)).delta_u  # type: ignore[arg-type]
        assert bool(np.abs(step).max() > 1e-3) == moves
    own = controller(feedback="model", posture_gain_per_s=0.0)
    own.reset(off)
    for number in range(60):
        u = AT + 0.004 * number * np.array([1.0, -1.0, 1.0, 0.0, 0.0])
        own.observe(observed(u, off_mm=4.0))
    step = own.propose(off._replace(**reference)).delta_u  # type: ignore[arg-type]
    assert own.adapted > 40
    assert np.abs(step).max() > 1e-3


def test_what_is_not_measured_teaches_nothing() -> None:
    own = controller()
    for number in range(30):
        u = AT + 0.01 * number
        own.observe(observed(u, believed=False))
        own.observe(observed(u, tip_direction=None))
    assert own.adapted == 0


def test_what_was_learnt_is_kept_and_taken_up_again(tmp_path: Path) -> None:
    own = controller()
    for number in range(80):
        own.observe(observed(AT + 0.004 * number, off_mm=5.0))
    own.save(tmp_path / "adapted.npz")
    again = controller(model=str(tmp_path / "adapted.npz"), adaptation=False)
    u = AT + 0.2
    np.testing.assert_array_equal(again.learnt.pose(u).position_mm, own.learnt.pose(u).position_mm)
    assert again.learnt.pose(u).position_mm[0] - nominal().pose(u).position_mm[0] > 3.0


def test_a_model_that_is_none_or_of_another_robot_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ControllerError, match="cannot be loaded"):
        controller(model=str(tmp_path / "nothing.npz"))
    asked = load_controller_options({"kind": "learned_kinematics", "model": MODEL})
    assert isinstance(asked, LearnedKinematics)
    with pytest.raises(ControllerError, match="is for 5 axes"):
        LearnedKinematicsController(asked, load_robot(SOFT_ARM).robot)
    model = PoseModel.load(SHIPPED_ROBOTS.parent / "models" / "concentric_tubes_pose.npz")
    PoseModel(model.lwpr, {}).save(tmp_path / "bare.npz")
    with pytest.raises(ControllerError, match="does not say how axes make its numbers"):
        controller(model=str(tmp_path / "bare.npz"))


def test_where_the_model_knows_nothing_it_leads_nowhere() -> None:
    far = AT + np.array([0.0, 0.0, 0.0, 0.0, 4000.0])
    own = controller(adaptation=False)
    with pytest.raises(ControllerError, match="knows nothing"):
        own.propose(observed(AT)._replace(u=far, targets=far))


@pytest.mark.parametrize(("feedback", "most_mm"), [("model", 0.8), ("tracker", 0.4)])
def test_in_the_daemon_a_circle_with_a_direction_is_followed_and_its_errors_told(
    feedback: str, most_mm: float
) -> None:
    async def scene(rig: Rig) -> None:
        options = {"kind": "learned_kinematics", "model": MODEL, "feedback": feedback}
        await rig.running(CIRCLE, {**options, "damping_mm": 2.0})
        await rig.until_state(OperatingState.ARMED, OperatingState.HOLD, within_s=120.0)
        assert rig.in_state(OperatingState.ARMED)
        followed = [tip for tip in rig.tips if tip.cycle >= 0]
        assert len(followed) > 170
        assert np.mean([tip.error_mm for tip in followed]) < most_mm
        angles = [tip.error_rad for tip in followed if tip.error_rad is not None]
        assert len(angles) == len(followed)
        assert np.sqrt(np.mean(np.square(angles))) < np.radians(0.6)
        assert all(tip.reference_direction is not None for tip in followed)

    on_a_rig(scene, path=TUBES)
