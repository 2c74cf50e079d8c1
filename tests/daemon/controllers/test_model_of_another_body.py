"""A model that tells nothing of the body is left out, and the body learnt from first motions."""

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from config.tasks.trajectory import Circle
from daemon.control.controller import ControllerError
from daemon.controllers.learning_controller import LearningController
from sim_backends.plants.soft_arm.soft_arm import SoftArm
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import PISTON_MM2, ClosedLoop, made_learner, pretrained

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

CIRCLE = Circle(kind="circle", center_mm=(0.0, 0.0, 185.0), radius_mm=15.0, cycle_s=9.4)
BEGIN_MM = np.array([15.0, 0.0, 185.0])
OF_ANOTHER_BODY = "the model is of another body"


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)


def mounted_turned(monkeypatch: pytest.MonkeyPatch, by_rad: float) -> None:
    """The arm that the model is of, but turned round its own axis against the tracker's."""
    segments = [
        {"length_mm": 77.5, "rotation_rad": by_rad},
        {"length_mm": 77.5, "rotation_rad": by_rad + 1.047},
    ]
    plant = SoftArmPlant.model_validate({"kind": "soft_arm", "segments": segments})
    monkeypatch.setattr(closed_loop, "soft_arm", lambda _: SoftArm(plant, [PISTON_MM2] * 6))


def begun(learner: LearningController) -> tuple[ClosedLoop, set[str]]:
    """Until it is ready; and what it said of what it did, without how far it was."""
    loop = ClosedLoop(learner)
    loop.start()
    return loop, got_ready(loop)


def got_ready(loop: ClosedLoop) -> set[str]:
    told = set()
    while not loop.controller.ready:
        loop.step(loop.tip_mm, np.zeros(3))
        told.add(loop.proposal.note.split(":")[0])
    return told


@pytest.mark.parametrize("kind", ["forward_jacobian", "reward_weighted"])
def test_small_motions_before_the_start_tell_that_the_model_is_of_another_body(
    kind: str, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounted_turned(monkeypatch, 1.571)
    learner = made_learner(kind, model=model)
    loop, told = begun(learner)
    assert OF_ANOTHER_BODY in told
    assert learner.foresight is None
    loop.lead(BEGIN_MM)
    assert loop.follow(CIRCLE).mean_mm < 0.8


def test_so_do_motions_on_a_path_where_nothing_was_tried_before(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot holds, and whoever resumes it has it learn anew."""
    mounted_turned(monkeypatch, 1.571)
    loop, told = begun(made_learner("forward_jacobian", model=model, probe=False))
    assert told == set()
    with pytest.raises(ControllerError, match=f"{OF_ANOTHER_BODY}: resume, and small motions"):
        loop.lead(BEGIN_MM)
        loop.follow(CIRCLE)
    loop.start()
    assert OF_ANOTHER_BODY in got_ready(loop)
    loop.lead(BEGIN_MM)
    assert loop.follow(CIRCLE).mean_mm < 0.8


def test_the_arm_that_the_model_is_of_is_led_by_it(model: str) -> None:
    learner = made_learner("forward_jacobian", model=model)
    _, told = begun(learner)
    assert OF_ANOTHER_BODY not in told
    assert learner.foresight is not None


@pytest.mark.parametrize("probe", [True, False])
def test_who_shall_not_learn_goes_by_the_model_that_there_is(
    probe: bool, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    mounted_turned(monkeypatch, 1.571)
    learner = made_learner("forward_jacobian", model=model, learning=False, probe=probe)
    loop, _ = begun(learner)
    loop.lead(BEGIN_MM)
    assert learner.foresight is not None
