"""How far what the last motions told of a model's errors is believed while the body is led, and
what they make of a Jacobian without a model."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control.jacobian_estimate import JacobianCorrection, JacobianEstimate
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


def test_without_noise_and_memory_a_correction_is_broydens_own() -> None:
    generator = np.random.default_rng(3)
    jacobian, moved = generator.normal(size=(3, 6)), 0.01 * generator.normal(size=6)
    tip_moved = jacobian @ moved + 0.01 * generator.normal(size=3)
    estimate = JacobianEstimate(jacobian, 1e8 * np.eye(6), noise_mm=1e-9, drift_mm=1e-9)
    estimate.correct(moved, tip_moved)
    missing = tip_moved - jacobian @ moved
    expected = jacobian + np.outer(missing, moved) / (moved @ moved)
    np.testing.assert_allclose(estimate.jacobian, expected, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(estimate.jacobian @ moved, tip_moved, rtol=1e-3)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), axes=st.integers(3, 8))
def test_a_correction_goes_where_the_jacobian_is_uncertain(seed: int, axes: int) -> None:
    """J + (d - J x) x'P / (x'P x + r), with a P that has grown by the distance moved."""
    generator = np.random.default_rng(seed)
    jacobian, spread = generator.normal(size=(3, axes)), generator.normal(size=(axes, axes))
    before = spread @ spread.T
    moved, tip_moved = 0.1 * generator.normal(size=axes), 0.1 * generator.normal(size=3)
    estimate = JacobianEstimate(jacobian, before, noise_mm=0.3, drift_mm=2.0)
    estimate.correct(moved, tip_moved)
    grown = before + 2.0**2 * np.linalg.norm(moved) * np.eye(axes)
    noise = 0.3**2 + 0.1**2 * tip_moved @ tip_moved
    gain = grown @ moved / (moved @ grown @ moved + noise)
    expected = jacobian + np.outer(tip_moved - jacobian @ moved, gain)
    np.testing.assert_allclose(estimate.jacobian, expected, rtol=1e-9, atol=1e-9)
    shrunk = grown - np.outer(gain, grown @ moved)
    np.testing.assert_allclose(estimate.covariance, shrunk, rtol=1e-9, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6))
def test_a_change_after_which_the_tip_could_hardly_move_one_way_is_dropped(seed: int) -> None:
    jacobian = np.random.default_rng(seed).normal(size=(3, 6))
    hardest = np.linalg.svd(jacobian)[2][2]
    estimate = JacobianEstimate(jacobian, 1e8 * np.eye(6), noise_mm=1e-3, drift_mm=1e-9)
    estimate.correct(0.1 * hardest, np.zeros(3))
    np.testing.assert_array_equal(estimate.jacobian, jacobian)
    np.testing.assert_array_equal(estimate.covariance, 1e8 * np.eye(6))
    estimate.correct(0.1 * hardest, 0.05 * jacobian @ hardest)
    assert not np.array_equal(estimate.jacobian, jacobian)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), axes=st.integers(3, 8))
def test_the_estimate_stays_finite_and_its_covariance_one(seed: int, axes: int) -> None:
    generator = np.random.default_rng(seed)
    estimate = JacobianEstimate(
        100.0 * generator.normal(size=(3, axes)), 400.0 * np.eye(axes), 0.3, 25.0
    )
    for _ in range(50):
        size = 10.0 ** generator.uniform(-3, 0)
        estimate.correct(size * generator.normal(size=axes), 5.0 * generator.normal(size=3))
        assert np.isfinite(estimate.jacobian).all()
        assert np.linalg.cond(estimate.jacobian) < 1e3
        assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-6
