"""The peers that know the robot from its motions, on the arm's physics, frame by frame."""

from pathlib import Path

import numpy as np
import pytest

from config.coupling.limits import LengthLimit
from config.loader import load_robot
from config.tasks.controllers import load_controller_options
from config.tasks.trajectory import Circle
from daemon.array_files import ModelError
from daemon.control.controller import ControllerError, Phase
from daemon.controllers.make_controller import make_controller
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S, ROBOT, made_learner, pretrained, started

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

KINDS = ("gaussian_process", "iterative_learning", "model_predictive")
each = pytest.mark.parametrize("kind", KINDS)
CIRCLE = Circle(
    kind="circle", center_mm=(0.0, 0.0, 185.0), plane="xy", radius_mm=25.0, cycle_s=12.0
)
START_MM = make_trajectory(CIRCLE, Path()).start_mm
LOAD_G = 10.0


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What half of the usual exploration, with nothing at the tip, has taught."""
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)


def rounds(kind: str, model: str, laps: int, **options: object) -> list[float]:
    """Mean errors in mm, with a load that the exploration did not have."""
    loop = started(made_learner(kind, model=model, **options), START_MM, LOAD_G)
    return [loop.follow(CIRCLE).mean_mm for _ in range(laps)]


@pytest.mark.parametrize(("kind", "first_mm"), [*zip(KINDS, (1.1, 2.2, 0.9), strict=True)])
def test_a_circle_is_followed_from_the_first_round_on(
    kind: str, first_mm: float, model: str
) -> None:
    """As well as its kind can: the feedback law alone is behind by what the body is late."""
    assert rounds(kind, model, 1)[0] < first_mm


def test_a_round_that_was_gone_corrects_the_next(model: str) -> None:
    first, second = rounds("iterative_learning", model, 2)
    assert second < 0.5 * first


def test_the_process_goes_on_learning_unless_told_not_to(model: str) -> None:
    online = rounds("gaussian_process", model, 2, lead=False)[1]
    offline = rounds("gaussian_process", model, 2, lead=False, learning=False)[1]
    assert online < 0.95 * offline


def test_the_prediction_leaves_no_error_at_rest(model: str) -> None:
    loop = started(made_learner("model_predictive", model=model, probe=False), START_MM, LOAD_G)
    loop.load_g = 25.0
    away = []
    for _ in range(280):
        loop.step(START_MM, np.zeros(3))
        away.append(loop.tip_mm - START_MM)
    left_mm = np.linalg.norm(np.mean(away[-120:], axis=0))
    assert left_mm < 0.15, "on average: the tracker's noise is not error"


@each
def test_limits_that_couple_axes_are_gone_along(kind: str, model: str) -> None:
    """The tip is asked to where the first two axes together would have to be nearer to 0."""
    both = LengthLimit(
        name="both",
        reason="they would touch",
        kind="length",
        sum={"proximal_1": 1.0, "proximal_2": 1.0},
        lowest_mm=45.0,
    )
    robot = ROBOT.model_copy(update={"coupled_limits": [both]})
    options = load_controller_options({"kind": kind, "model": model, "probe": False})
    loop = started(make_controller(options, robot, seed=1), START_MM)
    lowest = loop.u[:2].sum()
    for _ in range(160):
        loop.step(START_MM + np.array([0.0, 0.0, -40.0]), np.zeros(3))
        lowest = min(lowest, loop.u[:2].sum())
    assert 45.0 - 0.01 < lowest < 47.0


@each
def test_out_of_reach_the_axes_stop_at_their_limits(kind: str, model: str) -> None:
    """The loop itself looks at each step whether it is finite, and within speed and travel."""
    loop = started(made_learner(kind, model=model, probe=False), START_MM)
    for _ in range(300):
        loop.step(np.array([500.0, 0.0, 185.0]), np.zeros(3))
    at_a_limit = (loop.targets < 0.1) | (loop.targets > loop.axes.highest - 0.1)
    assert at_a_limit.any()
    far_mm = np.linalg.norm(loop.tip_mm - START_MM)
    for _ in range(200):
        loop.step(START_MM, np.zeros(3))
    assert np.linalg.norm(loop.tip_mm - START_MM) < 0.85 * far_mm, "and comes back"


@each
def test_the_same_seed_gives_the_same_steps(kind: str, model: str) -> None:
    def steps() -> Vector:
        loop = started(made_learner(kind, model=model, probe=False), START_MM)
        path = make_trajectory(CIRCLE, Path())
        return np.array([loop.step(*path.at(k * DT_S)) for k in range(60)])

    np.testing.assert_array_equal(steps(), steps())


@each
def test_a_tip_that_is_no_number_is_an_error_and_the_next_is_none(kind: str, model: str) -> None:
    loop = started(made_learner(kind, model=model, probe=False), START_MM)
    now = loop.observation(START_MM, np.zeros(3))
    with pytest.raises(ControllerError):
        loop.controller.propose(now._replace(tip_mm=np.full(3, np.nan)))
    assert np.isfinite(loop.controller.propose(now).delta_u).all()


def test_a_tip_that_is_no_number_teaches_the_next_round_nothing(model: str) -> None:
    loop = started(
        made_learner("iterative_learning", model=model, probe=False, set_out_s=0.0), START_MM
    )
    now = loop.observation(START_MM, np.zeros(3))
    for k in range(120):
        seen = now._replace(phase=Phase(k * DT_S % 1.0, 1.0))
        if k == 60:
            with pytest.raises(ControllerError):
                loop.controller.propose(seen._replace(tip_mm=np.full(3, np.nan)))
        else:
            assert np.isfinite(loop.controller.propose(seen).delta_u).all()


@each
def test_what_is_saved_goes_on_elsewhere(kind: str, model: str, tmp_path: Path) -> None:
    """How late the body is, whoever loads finds anew: nobody is led here."""
    options = {"model": model, "lead" if kind == "gaussian_process" else "probe": False}
    loop = started(made_learner(kind, **options), START_MM, LOAD_G)
    path = make_trajectory(CIRCLE, Path())
    for k in range(100):
        loop.step(*path.at(k * DT_S))
    loop.controller.save(tmp_path / "learnt.npz")
    other = made_learner(kind, **options)
    other.load(tmp_path / "learnt.npz")
    now = loop.observation(START_MM, np.zeros(3))
    for one in (loop.controller, other):
        one.reset(now)
    expected = loop.controller.propose(now).delta_u
    np.testing.assert_allclose(other.propose(now).delta_u, expected, atol=1e-6)
    wrong = next(one for one in KINDS if one != kind)
    with pytest.raises(ModelError, match="its controller is"):
        made_learner(wrong, model=model).load(tmp_path / "learnt.npz")


@each
def test_a_model_of_another_robot_is_refused(kind: str, model: str) -> None:
    options = load_controller_options({"kind": kind, "model": model})
    other = load_robot(SHIPPED_ROBOTS / "tendon_arm.yaml").robot
    with pytest.raises(ControllerError, match="does not fit this robot"):
        make_controller(options, other, seed=1)


@each
@pytest.mark.parametrize("robot", ["tendon_arm.yaml", "concentric_tubes.yaml"])
def test_any_robot_can_be_babbled(kind: str, robot: str) -> None:
    made_for = load_robot(SHIPPED_ROBOTS / robot).robot
    controller = make_controller(load_controller_options({"kind": kind}), made_for, seed=1)
    assert not controller.ready
