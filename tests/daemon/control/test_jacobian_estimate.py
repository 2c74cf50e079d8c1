"""How far what the last motions told of a model's errors is believed while the body is led."""

import numpy as np
import pytest

from daemon.control.jacobian_estimate import JacobianCorrection
from drivers.pose import Vector

AXES = 6
MODEL = 40.0 * np.random.default_rng(5).normal(size=(3, AXES))
OFF = 15.0 * np.random.default_rng(6).normal(size=(3, AXES))


def corrected(turns_every: int | None, samples: int = 60) -> list[float]:
    """What it is worth after each motion of a body that differs from the model by OFF, the other
    way round after every so many motions."""
    random, worths = np.random.default_rng(7), []
    correction = JacobianCorrection(AXES, 0.3, 50.0, 0.5)
    for k in range(samples):
        sign = 1.0 if turns_every is None or k // turns_every % 2 == 0 else -1.0
        moved: Vector = 0.05 * random.normal(size=AXES)
        seen = (MODEL + sign * OFF) @ moved + 0.1 * random.normal(size=3)
        correction.correct(MODEL, moved, seen)
        worths.append(correction.worth)
    return worths


def test_a_difference_that_lasts_is_believed() -> None:
    worths = corrected(None)
    assert worths[0] == 0.0, "nothing was foretold yet"
    assert min(worths[30:]) > 0.6


@pytest.mark.parametrize("turns_every", [1, 2, 3])
def test_a_difference_that_keeps_turning_round_is_not(turns_every: int) -> None:
    worths = corrected(turns_every)
    assert np.mean(worths[10:]) < 0.15
    assert all(0.0 <= worth <= 1.0 for worth in worths)


def test_all_of_what_is_worth_believing_counts_only_where_the_body_was_seen_to_change() -> None:
    correction = JacobianCorrection(AXES, 0.3, 50.0, 0.5)
    correction.foretold = np.array([10.0, 10.0, 10.0, 30.0])
    assert correction.worth > 0.9
    assert correction.counting == pytest.approx(0.4 * correction.worth)
    correction.changed = 1.0
    assert correction.counting == correction.worth


def test_a_difference_becomes_smaller_by_what_is_made_up_for_elsewhere() -> None:
    correction, gains = JacobianCorrection(AXES, 0.3, 50.0, 0.5), np.array([1.3, 1.0, 0.9])
    correction.difference = (gains - 1.0)[:, None] * MODEL + OFF
    correction.rescale(MODEL, gains)
    np.testing.assert_allclose(gains[:, None] * correction.difference, OFF)
    correction.rescale(MODEL, np.ones(3))
    np.testing.assert_allclose(correction.difference, (gains - 1.0)[:, None] * MODEL + OFF)


def left_after(motions: int, changed: bool) -> float:
    """Of a difference that is a sixth of the model, the share that is not known yet."""
    random, off = np.random.default_rng(9), MODEL / 6.0
    correction = JacobianCorrection(AXES, 0.3, 50.0, 0.5)
    correction.changed = float(changed)
    for _ in range(motions):
        moved: Vector = 0.1 * random.normal(size=AXES)
        correction.correct(MODEL, moved, (MODEL + off) @ moved)
    return float(np.linalg.norm(correction.difference - off) / np.linalg.norm(off))


def test_a_body_that_was_loaded_is_learnt_in_a_third_of_the_motions() -> None:
    """A small difference is mostly hysteresis, but not where something was hung on just before."""
    assert left_after(12, changed=True) < left_after(36, changed=False)


def wandered(turning_share: float, turns_every: int, motions: int = 600) -> float:
    """How far what is believed is from the model on average, in shares of the model, of a body that
    is the model's but for a hysteresis, which turns round after so many motions along one line."""
    random, away = np.random.default_rng(11), []
    turning = 40.0 * turning_share * np.random.default_rng(12).normal(size=(3, AXES))
    correction = JacobianCorrection(AXES, 0.3, 50.0, 0.5)
    line = random.normal(size=AXES)
    for k in range(motions):
        if k % turns_every == 0:
            line = random.normal(size=AXES)
        sign = 1.0 if k // turns_every % 2 == 0 else -1.0
        moved: Vector = 0.05 * (line + 0.3 * random.normal(size=AXES))
        correction.correct(MODEL, moved, (MODEL + sign * turning) @ moved)
        away.append(correction.worth * np.linalg.norm(correction.difference))
    return float(np.mean(away) / np.linalg.norm(MODEL))


def test_a_large_hysteresis_is_not_taken_for_another_body() -> None:
    """It makes much of the motions unexplained, as a load does; but a load is soon explained."""
    assert wandered(0.6, turns_every=2) < 0.1
    assert wandered(0.6, turns_every=5) < 0.19


def seen_to_answer(answers: Vector, motions: int = 60, noise_mm: float = 0.1) -> JacobianCorrection:
    """What has taken motions of a body whose tip goes (3, 3) times what the model says."""
    random = np.random.default_rng(7)
    correction = JacobianCorrection(AXES, 0.3, 50.0, 0.5)
    for _ in range(motions):
        moved: Vector = 0.05 * random.normal(size=AXES)
        seen = answers @ MODEL @ moved + noise_mm * random.normal(size=3)
        correction.correct(MODEL, moved, seen)
    return correction


CROSSWISE = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def test_a_model_is_contradicted_where_motions_go_elsewhere_than_it_says() -> None:
    assert seen_to_answer(-np.eye(3)).contradicted
    assert seen_to_answer(CROSSWISE @ np.diag([1.0, 1.0, -1.0])).contradicted
    assert not seen_to_answer(-np.eye(3), motions=15).contradicted, "few motions tell little"


@pytest.mark.parametrize("of_it", [0.4, 0.8, 1.0, 1.5, 2.5])
def test_a_body_that_goes_more_or_less_than_the_model_says_does_not_contradict_it(
    of_it: float,
) -> None:
    assert not seen_to_answer(of_it * np.eye(3)).contradicted


def test_a_tip_that_is_held_fast_does_not_contradict_it() -> None:
    held = seen_to_answer(0.02 * np.eye(3), noise_mm=0.05)
    assert held.foretold[2] > held.went_mm2, "the model says much that does not come"
    assert not held.contradicted
