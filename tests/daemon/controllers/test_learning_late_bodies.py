"""What motions of a body teach that answers late: less than a prompt one's, and no load at once."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from config.tasks.controllers import TipFollowing
from daemon.control.controller import ControllerError, Observation
from daemon.control.lag.body_lag import KNOWN_LAG, known_lag, parts
from daemon.control.tip_following import TipFollower
from daemon.controllers.learning_controller import LearningController
from tests.daemon.control.closed_loop import (
    DT_S,
    ROBOT,
    made_learner,
    pretrained,
    started,
)

pytestmark = pytest.mark.xdist_group("pretrained_arm")  # which is explored once for all tests


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Of the body as made."""
    path = tmp_path_factory.mktemp("model") / "arm.npz"
    pretrained(50, epochs=3).save(path)
    return str(path)


@pytest.mark.parametrize(("lag_s", "counts"), [(0.1, 1.0), (0.3, 0.75), (0.4, 0.5), (1.2, 0.5)])
def test_the_later_a_body_answers_the_less_its_motions_count(lag_s: float, counts: float) -> None:
    follower = TipFollower(TipFollowing(lead=True), ROBOT)
    follower.leading.lag.lag_s = lag_s
    assert follower.learnable == pytest.approx(counts)


@pytest.mark.parametrize(
    ("modelled", "lag_s", "predicted"),
    [
        (True, 0.1, 0.0),
        (True, 0.175, 0.5),
        (True, 0.25, 1.0),
        (False, 0.2, 0.0),
        (False, 0.3, 0.5),
        (False, 0.4, 1.0),
    ],
)
def test_a_model_lets_the_tip_of_prompter_bodies_be_predicted(
    modelled: bool, lag_s: float, predicted: float
) -> None:
    leading = TipFollower(TipFollowing(lead=True), ROBOT).leading
    leading.modelled, leading.lag.lag_s = modelled, lag_s
    assert leading.predicted == pytest.approx(predicted)


def test_a_learner_leads_by_its_model_if_it_has_one(model: str) -> None:
    with_model = made_learner("reward_weighted", model=model, lead=True)
    without = made_learner("reward_weighted", lead=True)
    assert with_model._follower.leading.modelled
    assert not without._follower.leading.modelled


BEGIN_MM = np.array([0.0, 0.0, 300.0])


class LateBody:
    """Its tip is a linear function of the axes as they show: it knows a lag, and nothing else."""

    def __init__(self, late_s: float, learner: LearningController) -> None:
        self.learner = learner
        self.true = 1.5 * np.random.default_rng(3).normal(size=(3, 6))
        self.told = [np.full(6, 20.0)]
        dead_s, self.first_order_s = parts(late_s)
        self.dead_frames = round(dead_s / DT_S)
        self.shown = self.told[0]
        self.noise = np.random.default_rng(4)
        self.before_mm = BEGIN_MM

    def step(self, begins: bool = False) -> str:
        """One frame. What the learner says that it does."""
        due = self.told[max(len(self.told) - 1 - self.dead_frames, 0)]
        self.shown = self.shown - np.expm1(-DT_S / self.first_order_s) * (due - self.shown)
        u, still = self.told[-1], np.zeros(3)
        tip = BEGIN_MM + self.true @ (self.shown - self.told[0])
        velocity, self.before_mm = (tip - self.before_mm) / DT_S, tip
        tip = tip + 0.1 * self.noise.normal(size=3)
        t_ns = round(len(self.told) * DT_S * 1e9)
        seen = Observation(t_ns, DT_S, u, u, tip, velocity, tip, still)
        if begins:
            self.learner.reset(seen)
        self.learner.observe(seen)
        proposal = self.learner.propose(seen)
        self.told.append(u + proposal.delta_u)
        return proposal.note

    def babble(self) -> None:
        """Until the Jacobian is known."""
        self.step(begins=True)
        while not self.learner._jacobian.known:
            self.step()

    @property
    def off(self) -> float:
        """Share of the Jacobian by which the learner's is wrong."""
        off = self.learner._jacobian.at(np.zeros(3), self.told[-1]) - self.true
        return float(np.linalg.norm(off) / np.linalg.norm(self.true))


@pytest.mark.parametrize(
    ("late_s", "said_s", "lead"),
    [
        (0.1, None, True),
        (0.1, None, False),
        (0.3, None, True),
        (0.4, 0.4, True),
        (0.5, None, True),
        (0.5, None, False),
        (1.2, None, True),
        (1.2, None, False),
    ],
)
def test_first_motions_tell_the_jacobian_of_a_body_however_late_it_is(
    late_s: float, said_s: float | None, lead: bool
) -> None:
    """Without a model, and whether or not anybody says how late it is."""
    babbling = {"duration_s": 15.0}
    options = {"babbling": babbling, "lag_s": said_s, "lead": lead}
    body = LateBody(late_s, made_learner("forward_jacobian", **options))
    body.babble()
    assert body.off < 0.15
    assert body.learner._follower.leading.lag.lag_s == pytest.approx(late_s, abs=0.06)


@pytest.mark.parametrize("lead", [True, False])
def test_how_late_a_body_is_that_was_learnt_without_a_model_is_kept(
    lead: bool, tmp_path: Path
) -> None:
    kind, babbling = "forward_jacobian", {"duration_s": 15.0}
    body = LateBody(0.5, made_learner(kind, babbling=babbling, lead=lead))
    body.babble()
    lag = body.learner._follower.leading.lag
    body.learner.save(tmp_path / "learnt.npz")
    for said_s in (None, 0.3):
        model = str(tmp_path / "learnt.npz")
        again = made_learner(kind, model=model, lead=lead, lag_s=said_s)
        known = again._follower.leading.lag
        assert known.lag_s == (said_s or lag.lag_s)
        assert said_s or known.dead_share == lag.dead_share


@pytest.mark.parametrize("known", [[-0.1, 0.4], [0.5, 1.5], [9.0, 0.4], [0.5]])
def test_a_file_that_has_a_body_late_as_none_can_be_is_refused(known: list[float]) -> None:
    with pytest.raises(ValueError, match="how late the body is"):
        known_lag({KNOWN_LAG: np.array(known)})


def test_a_pause_while_it_works_out_how_late_the_body_is_begins_nothing_anew() -> None:
    body = LateBody(0.5, made_learner("forward_jacobian", babbling={"duration_s": 15.0}))
    body.step(begins=True)
    while body.step() != "works out how late the body follows":
        assert not body.learner._jacobian.known
    frames = len(body.told)
    body.babble()
    assert (len(body.told) - frames) * DT_S < 5.0
    assert body.off < 0.15


def test_first_motions_that_were_nearly_enough_go_on_by_themselves() -> None:
    """As of a stiff body, whose tip goes less far."""
    body = LateBody(0.5, made_learner("forward_jacobian", babbling={"duration_s": 4.0}))
    body.babble()
    assert len(body.told) * DT_S > 2 * 4.0
    assert body.off < 0.3


@pytest.mark.parametrize("of_its_motion", [0.02, 0.04])
def test_first_motions_of_a_tip_that_goes_little_but_visibly_go_on_wider(
    of_its_motion: float,
) -> None:
    body = LateBody(0.1, made_learner("reward_weighted"))
    body.true = of_its_motion * body.true
    body.babble()
    went = np.ptp(np.array(body.told), axis=0) / body.learner._follower.axes.scale
    assert (went > 2 * body.learner._options.babbling.reach_share).all(), "further than asked for"
    assert body.off < 0.5


def test_first_motions_that_show_hardly_anything_go_on_wider_before_they_are_over() -> None:
    body = LateBody(0.1, made_learner("reward_weighted"))
    body.true = 0.03 * body.true
    body.babble()
    assert len(body.told) * DT_S < 1.6 * body.learner._options.babbling.duration_s
    assert body.off < 0.5


def test_first_motions_of_a_supple_body_become_calmer_and_tell_as_much() -> None:
    """A tip that goes four times as far as a usual one would leave the tracker's sight."""
    body = LateBody(0.1, made_learner("reward_weighted"))
    body.true = 4.0 * body.true
    body.babble()
    calm = np.array(body.told)[-round(20.0 / DT_S) :]
    away_mm = np.linalg.norm((calm - body.told[0]) @ body.true.T, axis=1)
    assert away_mm.max() < 45.0
    assert np.linalg.norm(np.diff(calm, axis=0) @ body.true.T, axis=1).max() < 150.0 * DT_S
    assert body.off < 0.1


def test_first_motions_of_a_tip_that_was_held_are_gone_on_with_once_it_is_free() -> None:
    body = LateBody(0.5, made_learner("forward_jacobian", babbling={"duration_s": 4.0}))
    answers, body.true = body.true, np.zeros((3, 6))
    with pytest.raises(ControllerError, match="first motions gave"):
        body.babble()
    assert len(body.told) * DT_S < 1.5 * 4.0
    body.true = answers
    with suppress(ControllerError):
        body.babble()
    body.babble()
    assert body.learner._jacobian.known


def test_motions_of_a_body_that_is_not_led_count_in_full() -> None:
    assert TipFollower(TipFollowing(), ROBOT).learnable == 1.0


@pytest.mark.parametrize(("lag_s", "at_once"), [(0.1, True), (0.6, False)])
def test_what_was_hung_on_is_learnt_from_motions_at_once_unless_they_come_late(
    lag_s: float, at_once: bool, model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    controller = made_learner("forward_jacobian", model=model, lead=True)
    loop = started(controller, np.array([30.0, 0.0, 185.0]))
    told: list[bool] = []
    monkeypatch.setattr(controller._jacobian, "body_changed", lambda: told.append(True))
    controller._follower.leading.lag.lag_s = lag_s
    controller._follower.leading.jumps += 1
    for _ in range(3):
        loop.step(loop.tip_mm, np.zeros(3))
    assert bool(told) == at_once
