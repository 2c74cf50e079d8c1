"""Both controllers that learn: what they learn from, what they keep, and what they hold still.

On the arm's physics with the tracker's noise, frame by frame. Models come from a short exploration:
what is asked is what also a poor model gives.
"""

from pathlib import Path

import numpy as np
import pytest

from config.tasks.exploration import MotorBabbling
from config.tasks.trajectory import Lissajous, Rectangle
from daemon.array_files import ModelError
from daemon.control.controller import ControllerError, Observation
from daemon.control.lag.load import Hung
from daemon.controllers.learning_controller import LearningController
from daemon.controllers.reward_weighted import RewardWeightedController
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.inverse.local_controllers import InverseAnswer
from daemon.learning.samples.motion import MotionSample
from daemon.reference.trajectories import make_trajectory
from drivers.pose import Vector
from tests.daemon.control import closed_loop
from tests.daemon.control.closed_loop import (
    DT_S,
    NOISE_MM,
    ROBOT,
    ClosedLoop,
    Followed,
    made_learner,
    pretrained,
    rectangle,
    started,
    wide_rectangle,
)

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests

WHOLE = rectangle(cycle_s=20.0)
ROUND = WHOLE.model_copy(update={"height_mm": 50.0, "cycle_s": 10.0})
"""Half of it: most of what is learnt, or not, is so wherever the tip goes."""
START_MM = make_trajectory(ROUND, Path()).start_mm
WHOLE_START_MM = make_trajectory(WHOLE, Path()).start_mm
LOAD_G = 14.2
KINDS = ("reward_weighted", "forward_jacobian")
both = pytest.mark.parametrize("kind", KINDS)
inverse, forward = (
    pytest.mark.parametrize("kind", [kept, pytest.param(other, marks=pytest.mark.long)])
    for kept, other in (KINDS, KINDS[::-1])
)
"""Of what either comes to by the same law: one of them each time, and both by `make hil`."""


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What a short exploration with nothing at the tip has taught."""
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)


def followed(loop: ClosedLoop, laps: int = 1, path: Rectangle = ROUND) -> list[Followed]:
    return [loop.follow(path) for _ in range(laps)]


def learner(loop: ClosedLoop) -> LearningController:
    assert isinstance(loop.controller, LearningController)
    return loop.controller


def window_of(loop: ClosedLoop) -> Vector:
    """(n, 6 + 2 m) all samples that the local controllers go by."""
    assert isinstance(loop.controller, RewardWeightedController)
    assert loop.controller._local is not None
    return np.array([np.concatenate(sample) for sample in loop.controller._local.window])


# What is learnt.


@both
def test_a_load_that_was_never_felt_is_learnt_in_a_lap(kind: str, model: str) -> None:
    online, offline = (
        followed(
            started(
                made_learner(kind, model=model, learning=laps > 1, lead=False),
                WHOLE_START_MM,
                LOAD_G,
            ),
            laps,
            WHOLE,
        )
        for laps in (2, 1)
    )
    assert online[0].mean_mm <= offline[0].mean_mm
    assert online[1].mean_mm < 0.85 * offline[0].mean_mm
    assert online[1].mean_mm < 0.8


@inverse
def test_without_a_model_the_first_motions_teach_enough(kind: str) -> None:
    babbling = MotorBabbling(duration_s=30.0).model_dump()
    loop = started(made_learner(kind, babbling=babbling), START_MM, LOAD_G)
    slowly = ROUND.model_copy(update={"cycle_s": 2.0 * ROUND.cycle_s})
    assert followed(loop, path=slowly)[0].mean_mm < 1.2


@forward
def test_without_a_model_a_figure_of_eight_is_followed_round_after_round(kind: str) -> None:
    """It leads where no motion has been, and along each of its ways again and again."""
    eight = Lissajous(
        kind="lissajous", center_mm=(0.0, 0.0, 185.0), amplitude_mm=(30.0, 30.0, 0.0), cycle_s=20.0
    )
    loop = started(made_learner(kind), np.array(eight.center_mm))
    rounds = [loop.follow(eight) for _ in range(2)]
    assert all(one.mean_mm < 2.0 for one in rounds), [one.mean_mm for one in rounds]
    assert rounds[-1].max_mm < 12.0


@pytest.mark.parametrize("answered", [0.0, -1.0, pytest.param(3.0, marks=pytest.mark.long)])
def test_local_controllers_that_the_forward_model_contradicts_are_not_followed(
    answered: float, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Who has learnt from noise that nothing moves would stand, see nothing else, and stand on."""
    loop = started(made_learner("reward_weighted", model=model), START_MM)
    controller = loop.controller
    assert isinstance(controller, RewardWeightedController)
    command = controller._command

    def wrong(tip_mm: Vector, place_mm: Vector, seen: Observation) -> InverseAnswer:
        answer = command(tip_mm, place_mm, seen)
        return answer._replace(delta_u=answered * answer.delta_u, activation=1.0, support=1.0)

    monkeypatch.setattr(controller, "_command", wrong)
    assert followed(loop)[0].mean_mm < 1.0


@pytest.mark.parametrize(("memory_samples", "grown"), [(None, 1.0), (20.0, 1.5)])
def test_fields_that_forget_learn_another_body(
    memory_samples: float | None, grown: float, model: str
) -> None:
    """One that goes half as far again: nothing of that is left to a correction."""
    fields = PretrainedModel.load(Path(model), ROBOT).fields
    place = fields.centres[len(fields.centres) // 2] * fields.scale
    tip_mm, u, random = place[:3], place[3:], np.random.default_rng(1)
    controller = made_learner("forward_jacobian", model=model, memory_samples=memory_samples)
    jacobian = controller._jacobian
    before = jacobian.at(tip_mm, u)
    for _ in range(200):
        moved = 2.5 * random.normal(size=6)
        controller._work_in(MotionSample(tip_mm, u, moved, 1.5 * before @ moved), np.ones(3))
    jacobian.believed = 0.0
    after = jacobian.at(tip_mm, u)
    assert (after * before).sum() / (before**2).sum() == pytest.approx(grown, abs=0.1)


@pytest.mark.parametrize("hung", [Hung(), Hung(2.0, 0.5)])
@both
def test_what_is_made_up_for_where_the_body_is_led_is_not_learnt_once_more(
    kind: str, hung: Hung, model: str
) -> None:
    """A body of which a third more comes upwards than was told, and one that is loaded besides."""
    fields = PretrainedModel.load(Path(model), ROBOT).fields
    place = fields.centres[len(fields.centres) // 2] * fields.scale
    tip_mm, u, random = place[:3], place[3:], np.random.default_rng(1)
    controller, gains = made_learner(kind, model=model, lead=True), np.array([1.0, 1.0, 1.33])
    leading = controller._follower.leading
    leading.gains, leading.load.hung = gains, hung
    leading.load.rest_mm = np.array([0.0, 0.0, 230.0])
    came = gains[:, np.newaxis] * leading.load.matrix_at(tip_mm)
    before = controller._jacobian.at(tip_mm, u)
    for _ in range(20):
        moved = 2.5 * random.normal(size=6)
        middle = controller._jacobian.at(tip_mm + 0.5 * before @ moved, u + 0.5 * moved)
        controller._waiting.append(MotionSample(tip_mm, u, moved, came @ middle @ moved))
        controller.learn()
    np.testing.assert_allclose(controller._jacobian.at(tip_mm, u), before, rtol=0.02, atol=0.02)


@pytest.mark.parametrize("gains", [np.zeros(3), np.full(3, np.nan), np.ones(2)])
def test_what_was_learnt_besides_no_gains_is_refused(gains: Vector, model: str) -> None:
    jacobian = made_learner("forward_jacobian", model=model)._jacobian
    arrays = jacobian.to_arrays()
    jacobian.restore(arrays)
    with pytest.raises(ValueError, match="not three above 0"):
        jacobian.restore({**arrays, "correction_gains": gains})


def test_babbling_that_shows_nothing_is_not_enough() -> None:
    hardly = {"duration_s": 5.0, "reach_share": 1e-4, "dither_share": 0.0}
    loop = ClosedLoop(made_learner("reward_weighted", babbling=hardly))
    loop.start()
    with pytest.raises(ControllerError, match="let them be longer or wider"):
        loop.explore()


@both
def test_without_learning_nothing_changes(kind: str, model: str) -> None:
    """Offline is what the model says, whatever happens: also after a lap under a load. What is
    found where the body is led is not of the model."""
    controller = made_learner(kind, model=model, learning=False, lead=False)
    loop = started(controller, START_MM, LOAD_G)
    followed(loop)
    untouched = made_learner(kind, model=model, learning=False, lead=False)
    untouched.reset(loop.observation(START_MM, np.zeros(3)))
    for reference in START_MM + np.eye(3):
        asked = loop.observation(reference, np.zeros(3))
        expected = untouched.propose(asked).delta_u
        np.testing.assert_array_equal(controller.propose(asked).delta_u, expected)


@both
def test_who_shall_not_learn_needs_a_model(kind: str) -> None:
    with pytest.raises(ControllerError, match="give `model`"):
        made_learner(kind, learning=False)


# What never gets in.


def poisoned(measured_mm: Vector, frame: int) -> Vector | None:
    """What a bad tracker makes of a measurement: far off, not there, or not a number."""
    if frame % 40 == 7:
        return np.asarray(measured_mm + np.array([15.0, -10.0, 8.0]))
    if frame % 97 == 11:
        return np.full(3, np.nan)
    return None if frame % 53 in (20, 21) else measured_mm


def test_outliers_gaps_and_what_is_no_number_teach_nothing(model: str) -> None:
    loop = started(made_learner("reward_weighted", model=model), START_MM)
    frames = iter(range(10**9))
    loop.seen = lambda measured_mm: poisoned(measured_mm, next(frames))
    (lap,) = followed(loop)
    assert_sound(window_of(loop))
    assert lap.true_mean_mm < 1.0


def test_a_frozen_tracker_teaches_nothing(model: str) -> None:
    loop = started(made_learner("reward_weighted", model=model), START_MM)
    followed(loop)
    last = loop.tip_mm
    before = window_of(loop)
    loop.seen = lambda _: last
    for _ in range(200):
        loop.step(last + np.array([20.0, 0.0, 0.0]), np.zeros(3))
    after = window_of(loop)
    assert_sound(after)
    assert len(after) <= len(before) + 3


def test_a_robot_that_is_held_teaches_nothing(model: str) -> None:
    """The gate refuses every step; somebody pushes the tip about."""
    loop = started(made_learner("reward_weighted", model=model), START_MM)
    followed(loop)
    before = window_of(loop)
    loop.permitted = lambda step: np.zeros_like(step)
    push_mm = np.zeros(3)
    loop.seen = lambda measured_mm: measured_mm + push_mm
    for k in range(250):
        push_mm[:] = 8.0 * np.sin(k / 25.0) * np.array([1.0, 0.5, 0.0])
        loop.step(START_MM + np.array([5.0, 0.0, 0.0]), np.zeros(3))
    after = window_of(loop)
    assert len(after) <= len(before) + 3


def test_steps_that_are_made_smaller_are_learnt_as_they_were(model: str) -> None:
    """What counts is where the axes went, not where they were sent."""
    loop = started(made_learner("reward_weighted", model=model), START_MM)
    loop.permitted = lambda step: 0.5 * step
    followed(loop)
    assert_sound(window_of(loop))


def assert_sound(samples: Vector) -> None:
    """Each is a motion that the axes can have caused."""
    assert len(samples) > 20
    assert np.isfinite(samples).all()
    tip_mm, u = samples[:, :3], samples[:, 3:9]
    delta_u, delta_tip = samples[:, 9:15], samples[:, 15:]
    assert (np.abs(tip_mm - [0.0, 0.0, 185.0]) < [40.0, 70.0, 25.0]).all()
    held_back_mm = 4.0  # samples are of the body's free axes, which friction keeps from the others
    assert ((u >= -held_back_mm) & (u <= 50.0 + held_back_mm)).all()
    moved_mm = np.linalg.norm(delta_tip, axis=1)
    per_travel = moved_mm / np.linalg.norm(delta_u / 50.0, axis=1)
    assert moved_mm.max() < 8.0
    assert per_travel.max() < 400.0
    residuals = delta_tip - delta_u @ np.linalg.lstsq(delta_u, delta_tip, rcond=None)[0]
    assert np.median(np.abs(residuals)) < 5.0 * NOISE_MM


# What is kept.


@both
def test_who_goes_on_and_who_loads_it_do_the_same_to_the_last_bit(
    kind: str, model: str, tmp_path: Path
) -> None:
    """How late the body is, whoever loads finds anew: nobody is led here."""
    loop = started(made_learner(kind, model=model, lead=False), START_MM, LOAD_G)
    followed(loop)
    loop.controller.save(tmp_path / "learnt.npz")
    loaded = made_learner(kind, model=model, lead=False)
    loaded.load(tmp_path / "learnt.npz")
    assert_alike(loop, loaded)


@both
def test_what_was_learnt_without_a_model_is_kept_as_well(kind: str, tmp_path: Path) -> None:
    loop = started(made_learner(kind, babbling={"duration_s": 20.0}, lead=False), START_MM)
    loop.controller.save(tmp_path / "learnt.npz")
    loaded = made_learner(kind, model=str(tmp_path / "learnt.npz"), lead=False)
    assert loaded.ready
    assert_alike(loop, loaded)


def assert_alike(loop: ClosedLoop, other: LearningController) -> None:
    """Both are told the same for some seconds, learn from it, and say the same."""
    trajectory = make_trajectory(ROUND, Path())
    observation = loop.observation(START_MM, np.zeros(3))
    loop.controller.reset(observation)
    other.reset(observation)
    for k in range(200):
        seen = loop.observation(*trajectory.at(k * DT_S))
        other.observe(seen)
        theirs = other.propose(seen).delta_u
        other.learn()
        loop.controller.observe(seen)
        ours = loop.controller.propose(seen).delta_u
        loop.controller.learn()
        np.testing.assert_array_equal(ours, theirs)
        loop.targets = loop.targets + ours
        loop.measure()


def led(
    model: str, learns: bool, learn_calls: int, monkeypatch: pytest.MonkeyPatch
) -> tuple[LearningController, ClosedLoop]:
    """To the start of a path, with so much time between frames."""
    monkeypatch.setattr(closed_loop, "LEARN_CALLS", learn_calls)
    controller = made_learner("forward_jacobian", model=model, lead=True, learning=learns)
    return controller, started(controller, START_MM)


def test_steps_are_the_same_whether_or_not_there_was_time_between_frames(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a step tells of lag and hysteresis is put off, and not left out."""
    _, without = led(model, False, 0, monkeypatch)
    controller, with_time = led(model, False, 3, monkeypatch)
    assert controller._follower.leading.lag.lag_s > 0.0
    np.testing.assert_array_equal(without.targets, with_time.targets)


@pytest.mark.parametrize(("learn_calls", "put_off"), [(0, 1), (3, 0)])
def test_a_frame_is_learnt_from_when_there_is_time_and_else_with_the_next_one(
    learn_calls: int, put_off: int, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller, loop = led(model, True, learn_calls, monkeypatch)
    seen: list[int] = []
    samples = controller._samples
    add = samples.add

    def added(observation: Observation) -> MotionSample | None:
        seen.append(observation.t_ns)
        return add(observation)

    monkeypatch.setattr(samples, "add", added)
    frames = []
    for _ in range(20):
        loop.step(START_MM, np.zeros(3))
        frames.append(loop.t_ns)
    assert seen[put_off:] == frames[: len(frames) - put_off]


@both
def test_a_file_of_another_kind_or_none_is_refused(kind: str, model: str, tmp_path: Path) -> None:
    other = KINDS[1 - KINDS.index(kind)]
    loop = started(made_learner(other, model=model), START_MM)
    loop.controller.save(tmp_path / "other.npz")
    (tmp_path / "none.npz").write_bytes(b"nothing")
    controller = made_learner(kind, model=model)
    with pytest.raises(ModelError, match="its controller is"):
        controller.load(tmp_path / "other.npz")
    with pytest.raises(ModelError, match=r"none\.npz"):
        controller.load(tmp_path / "none.npz")
    with pytest.raises(ControllerError, match="cannot be loaded"):
        made_learner(kind, model=str(tmp_path / "absent.npz"))


@both
def test_nothing_is_saved_before_anything_is_learnt(kind: str, tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="nothing is learnt yet"):
        made_learner(kind).save(tmp_path / "learnt.npz")


# The axes that the tip does not need.


def drift_per_lap(laps: list[Followed]) -> float:
    """How far the axes' mean posture goes from the second lap to the last, per lap, in mm."""
    postures = [lap.u.mean(axis=0) for lap in laps[1:]]
    return float(np.linalg.norm(postures[-1] - postures[0])) / (len(postures) - 1)


@pytest.fixture(scope="module")
def unattracted_mm(model: str) -> float:
    """The drift per lap of axes that nothing draws to a posture."""
    controller = made_learner("reward_weighted", model=model, posture_gain_per_s=0.0)
    return drift_per_lap(followed(started(controller, WHOLE_START_MM), 3, WHOLE))


@inverse
def test_the_attractor_keeps_the_posture_over_many_laps(
    kind: str, model: str, unattracted_mm: float
) -> None:
    """Off, every lap ends with the axes elsewhere, how far is chance; on, they come back to where
    they were. A posture may be changed on the way."""
    loop = started(made_learner(kind, model=model, posture_gain_per_s=0.3), WHOLE_START_MM)
    laps = followed(loop, 3, WHOLE)
    assert drift_per_lap(laps) < min(0.25 * unattracted_mm, 0.4)
    posture = np.array([32.0, 32.0, 32.0, 18.0, 18.0, 18.0])
    learner(loop).set_posture(posture)
    (after,) = followed(loop, path=WHOLE)
    assert mean_distance(after.u, posture) < 0.8 * mean_distance(laps[0].u, posture)
    assert after.mean_mm < laps[0].mean_mm + 0.15


def test_another_posture_gives_other_axes_at_the_same_error(model: str) -> None:
    """Of either kind: whoever learns, its steps are brought to a posture by the same law."""
    laps = {}
    for first in (18.0, 32.0):
        posture = (first, first, first, 25.0, 25.0, 25.0)
        options = {"model": model, "posture": posture, "posture_gain_per_s": 0.3}
        loop = started(made_learner("forward_jacobian", **options), START_MM)
        (laps[first],) = followed(loop)
    low, high = laps[18.0], laps[32.0]
    assert (high.u - low.u)[:, :3].mean() > 5.0
    assert high.mean_mm == pytest.approx(low.mean_mm, abs=0.15)


def mean_distance(u: Vector, posture: Vector) -> float:
    return float(np.linalg.norm(u - posture, axis=1).mean())


@both
@pytest.mark.parametrize("posture", [np.full(6, np.nan), np.zeros(5)])
def test_a_posture_that_is_none_is_refused(kind: str, posture: Vector, model: str) -> None:
    with pytest.raises(ValueError, match="6 finite numbers"):
        made_learner(kind, model=model).set_posture(posture)


# Beyond reach.


@inverse
def test_out_of_reach_nothing_winds_up(kind: str, model: str) -> None:
    """A while at a place that cannot be reached, and it comes back as if it never was."""
    loop = started(made_learner(kind, model=model), START_MM)
    for _ in range(240):
        loop.step(START_MM + np.array([0.0, 0.0, 80.0]), np.zeros(3))
    loop.lead(START_MM)
    assert np.linalg.norm(loop.tip_mm - START_MM) < 1.5
    assert followed(loop)[0].mean_mm < 0.8


@pytest.mark.parametrize("fallback", [True, False])
def test_what_is_under_way_is_known_whoever_makes_the_step_and_after_a_hold(fallback: bool) -> None:
    options = {"babbling": {"duration_s": 12.0}, "fallback": fallback}
    loop = ClosedLoop(made_learner("reward_weighted", **options))
    loop.start()
    loop.explore()
    leading = learner(loop)._follower.leading
    for _ in range(2):
        loop.start()
        here = loop.tip_mm
        for k in range(40):
            loop.step(here + 0.25 * k * np.array([1.0, 0.0, 0.0]), np.array([10.0, 0.0, 0.0]))
        assert leading.left_mm[0] > 0.3, "a tip that is a tenth of a second late, at 10 mm/s"


def test_the_paper_s_law_follows_by_itself(model: str) -> None:
    """No fallback, no feed-forward: 14.2 g are learnt all the same, and lag is what remains."""
    slow = wide_rectangle(cycle_s=40.0).model_copy(update={"height_mm": 20.0, "cycle_s": 24.0})
    loop = started(
        made_learner("reward_weighted", model=model, paper=True),
        make_trajectory(slow, Path()).start_mm,
        LOAD_G,
    )
    laps = [loop.follow(slow) for _ in range(2)]
    assert laps[1].mean_mm < 2.5
