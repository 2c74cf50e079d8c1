"""The rough idea of where the tip is, and how hard tendons pull."""

import numpy as np

from daemon.controllers.exploration.walls import QuadraticGuess
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests.daemon.control.closed_loop import ROBOT

AXES = AxisRanges.of(ROBOT)


def tips(u: Vector) -> Vector:
    """A quadratic."""
    x = u / 25.0 - 1.0
    return np.stack(
        [30.0 * x[:, 0] - 8.0 * x[:, 1] * x[:, 4], 20.0 * x[:, 3], 180.0 - 15.0 * x[:, 2] ** 2],
        axis=1,
    )


def test_it_knows_nothing_before_it_has_seen_something() -> None:
    assert np.isnan(QuadraticGuess(AXES, 3).at(np.full((2, 6), 25.0))).all()


def test_it_finds_what_is_quadratic_in_the_axes() -> None:
    random, guess = np.random.default_rng(1), QuadraticGuess(AXES, 3)
    seen = random.uniform(0.0, 50.0, (2000, 6))
    for u, tip in zip(seen, tips(seen), strict=True):
        guess.add(u, tip)
    asked = random.uniform(0.0, 50.0, (50, 6))
    assert np.abs(guess.at(asked) - tips(asked)).max() < 1.0


def test_one_place_is_enough_for_a_first_guess() -> None:
    guess = QuadraticGuess(AXES, 3)
    for _ in range(10):
        guess.add(np.full(6, 25.0), np.array([1.0, 2.0, 180.0]))
    np.testing.assert_allclose(guess.at(np.full((1, 6), 25.0)), [[1.0, 2.0, 180.0]], atol=0.5)
