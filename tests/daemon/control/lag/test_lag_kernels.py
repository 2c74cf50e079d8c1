"""What small matrices tell of how a tip answers: as numpy has it, and no error of no numbers."""

import numpy as np
import pytest

from daemon.control.lag import lag_kernels as kernels
from drivers.pose import Vector

_ONE = np.eye(3)
_KEPT = 0.9


@pytest.fixture
def random() -> np.random.Generator:
    return np.random.default_rng(3)


def test_the_answer_explains_what_came_of_all_motions_best(random: np.random.Generator) -> None:
    told, made = np.zeros((3, 3)), np.zeros((3, 3))
    all_told, all_made = np.zeros((3, 3)), np.zeros((3, 3))
    for _ in range(20):
        due, came = random.normal(size=3), random.normal(size=3)
        all_told = _KEPT * all_told + np.outer(due, due)
        all_made = _KEPT * all_made + np.outer(came, due)
        answer = kernels.add_answer(told, made, _KEPT, due, came, _ONE)
        best = (all_made + _ONE) @ np.linalg.inv(all_told + _ONE)
        np.testing.assert_allclose(answer, best, rtol=1e-12)


def test_what_a_matrix_foretold_is_held_against_what_came(random: np.random.Generator) -> None:
    foretold, matrix = np.ones(4), _ONE + random.normal(size=(3, 3))
    due, came = random.normal(size=3), random.normal(size=3)
    said, lacked = (matrix - _ONE) @ due, came - due
    kernels.add_foretold(foretold, _KEPT, 0.5, matrix, due, came)
    seen = np.array([said @ lacked, said @ said, lacked @ lacked, 3.0])
    np.testing.assert_allclose(foretold, _KEPT + 0.5 * seen, rtol=1e-12)


def test_the_tip_goes_as_wanted_when_it_is_told_that(random: np.random.Generator) -> None:
    answer, loaded = (_ONE + 0.1 * random.normal(size=(3, 3)) for _ in range(2))
    gains, wanted = random.uniform(0.5, 2.0, 3), random.normal(size=3)
    told = kernels.to_tell(answer, gains, loaded, wanted)
    np.testing.assert_allclose(answer @ (gains * (loaded @ told)), wanted, rtol=1e-12)


@pytest.mark.parametrize("strange", [np.nan, np.inf])
def test_of_what_is_no_number_comes_no_number_and_no_error(strange: float) -> None:
    broken: Vector = _ONE.copy()
    broken[1, 1] = strange
    assert np.isnan(kernels.to_tell(broken, np.ones(3), _ONE, np.ones(3))).all()
    assert np.isnan(kernels.add_answer(broken, _ONE, 1.0, np.ones(3), np.ones(3), _ONE)).all()


def test_gains_are_those_of_the_delay_that_is_nearest_to_the_lag() -> None:
    told = np.full((3, 3), 1e6)
    sums = np.stack([told, told * np.array([[0.5], [1.5], [2.0]])])
    gains = kernels.gains(np.array([0.0, 0.1, 0.2]), 0.12, sums, 1.0, 0.0)
    np.testing.assert_allclose(gains, 1.5, rtol=1e-4)


def test_play_is_gone_through_before_an_axis_moves_anything() -> None:
    within, reach = np.array([0.0, 0.5, -1.0]), np.ones(3)
    now, farther = kernels.within_play(within, np.array([0.3, 2.0, -0.1]), reach)
    np.testing.assert_allclose(now, [0.3, 1.0, -1.0])
    np.testing.assert_allclose(farther, [0.3, 0.5, 0.0])


def test_a_step_is_longer_by_what_play_takes_of_it() -> None:
    step, within = np.array([1.0, -1.0, 0.1, 0.0]), np.array([0.5, 0.5, -1.0, 0.0])
    longer = kernels.with_play(step, within, np.ones(4), 3.0)
    np.testing.assert_allclose(longer, [1.5, -2.5, 0.4, 0.0])


def test_an_axis_that_hardly_moves_has_not_turned() -> None:
    forth = kernels.turned(np.full(3, 0.5), np.array([1.0, -1.0, 1e-9]), 0.2, 1e-6)
    np.testing.assert_allclose(forth, [0.6, 0.4, 0.5])
