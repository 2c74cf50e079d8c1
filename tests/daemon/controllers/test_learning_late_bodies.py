"""What motions of a body teach that answers late: less than a prompt one's, and no load at once."""

import numpy as np
import pytest

from config.tasks.controllers import TipFollowing
from daemon.control.controller import Observation
from daemon.control.lag.body_lag import parts
from daemon.control.tip_following import TipFollower
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
    pretrained(60, epochs=8).save(path)
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


@pytest.mark.parametrize(("late_s", "said_s"), [(0.1, None), (0.4, 0.4)])
def test_first_motions_tell_the_jacobian_of_a_body_that_is_as_late_as_it_is_taken_for(
    late_s: float, said_s: float | None
) -> None:
    """Without a model, and whether or not anybody says how late it is."""
    babbling = {"duration_s": 15.0}
    learner = made_learner("forward_jacobian", babbling=babbling, lag_s=said_s)
    random = np.random.default_rng(3)
    true = 1.5 * random.normal(size=(3, 6))
    dead_s, first_order_s = parts(late_s)
    told = [np.full(6, 20.0)]
    shown, frames, still = told[0], 0, np.zeros(3)
    while not learner._jacobian.known:
        frames += 1
        due = told[max(len(told) - 1 - round(dead_s / DT_S), 0)]
        shown = shown - np.expm1(-DT_S / first_order_s) * (due - shown)
        tip, u = true @ shown + 0.1 * random.normal(size=3), told[-1]
        seen = Observation(round(frames * DT_S * 1e9), DT_S, u, u, tip, still, tip, still)
        if frames == 1:
            learner.reset(seen)
        learner.observe(seen)
        told.append(u + learner.propose(seen).delta_u)
    off = learner._jacobian.at(still, told[-1]) - true
    assert np.linalg.norm(off) < 0.15 * np.linalg.norm(true)


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
