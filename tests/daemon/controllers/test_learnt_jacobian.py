"""How far what the last motions told of a model's errors is believed while the body is led."""

import numpy as np
import pytest

from daemon.controllers.learnt_jacobian import JacobianCorrection
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
