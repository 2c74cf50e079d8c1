"""A cubic of all axes tells the Jacobian where the body is one, and gives way where it is none."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from daemon.learning.forward.cubic_shape import CubicShape, unforetold, unforetold_by_cubics
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
from daemon.learning.forward.stop_operators import StopOperators
from daemon.learning.samples.motion import MotionTable
from drivers.pose import Vector
from tests.daemon.learning.frames_of_arm import ARM, arm_dataset

AXES = 3
TRAVEL_MM = 50.0


def cubic(u: Vector) -> Vector:
    """(n, 3) tips of (n, 3) axes."""
    x = (u - 25.0) / 25.0
    a, b, c = x.T
    return np.stack([20.0 * a + 9.0 * a * b, 25.0 * b - 8.0 * c**3, 15.0 * c + 6.0 * a * b * c], 1)


def wavy(u: Vector) -> Vector:
    """No cubic: four waves along the travel."""
    return np.asarray(20.0 * np.sin(8.0 * np.pi * u / TRAVEL_MM))


def motions(tips: object, count: int = 600, lines: int = 30, noise_mm: float = 0.05) -> MotionTable:
    """Small motions from all over the travel."""
    assert callable(tips)
    random = np.random.default_rng(3)
    u = random.uniform(0.0, TRAVEL_MM, (count, AXES))
    moved = random.normal(0.0, 0.7, u.shape)
    seen = tips(u + moved) - tips(u) + noise_mm * random.normal(size=u.shape)
    return MotionTable(tips(u), u, moved, seen, np.arange(count) * lines // count)


def jacobian(u: Vector) -> Vector:
    """(3, 3) of `cubic`, by differences."""
    steps = 1e-4 * np.eye(AXES)
    return np.asarray(((cubic(u + steps) - cubic(u - steps)) / 2e-4).T)


def test_the_jacobian_of_a_cubic_body_is_found_from_small_noisy_motions() -> None:
    shape = CubicShape.of(motions(cubic))
    assert shape is not None
    for u in np.random.default_rng(4).uniform(5.0, 45.0, (20, AXES)):
        np.testing.assert_allclose(shape.jacobian(u), jacobian(u), atol=0.06)


def test_of_an_axis_that_stood_but_for_its_encoder_nothing_is_made_up() -> None:
    """As long a way as others' is taken for its travel: in shares of its own, a millimetre of it
    would be many thousands of ways, and what follows them step by step take seconds."""
    seen, random = motions(cubic), np.random.default_rng(5)
    u, moved = seen.u.copy(), seen.delta_u.copy()
    u[:, 2] = 10.0 + 1e-3 * random.integers(-1, 2, len(u))
    moved[:, 2] = 1e-3 * random.integers(-1, 2, len(u))
    tips = cubic(u + moved) - cubic(u) + 0.2 * random.normal(size=(len(u), 3))
    shape = CubicShape.of(replace(seen, u=u, delta_u=moved, delta_tip_mm=tips))
    assert shape is not None
    assert shape.held_back.travel.min() > 0.9 * TRAVEL_MM
    assert np.abs(shape.jacobian(u[0])[:, 2]).max() < 0.5


def along_lines(share: float, noise_mm: float = 0.05) -> MotionTable:
    """Motions of the cubic body along 40 lines, whose axes hold back a share of them."""
    random, stops = np.random.default_rng(6), StopOperators(np.array([share]))
    ends = random.uniform(0.0, TRAVEL_MM, (41, AXES))
    u = np.concatenate([np.linspace(*way, 31)[:-1] for way in pairwise(ends)])
    tips = cubic(TRAVEL_MM * np.array([stops.follow(place / TRAVEL_MM)[0] for place in u]))
    seen = np.diff(tips, axis=0) + noise_mm * random.normal(size=(len(u) - 1, 3))
    return MotionTable(tips[:-1], u[:-1], np.diff(u, axis=0), seen, np.arange(len(u) - 1) // 30)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5])
def test_what_axes_that_turn_keep_back_is_found_and_is_not_in_the_jacobian(share: float) -> None:
    shape = CubicShape.of(along_lines(share))
    assert shape is not None
    assert shape.held_back.share == pytest.approx(share, abs=0.03)
    for u in np.random.default_rng(4).uniform(10.0, 40.0, (20, AXES)):
        np.testing.assert_allclose(shape.jacobian(u), jacobian(u), atol=0.15)


@pytest.mark.parametrize(("count", "lines"), [(80, 30), (600, 9)])
def test_few_motions_or_lines_tell_no_shape(count: int, lines: int) -> None:
    assert CubicShape.of(motions(cubic, count, lines)) is None


def test_what_is_left_of_other_lines_tells_whether_the_body_is_a_cubic() -> None:
    assert unforetold_by_cubics(motions(cubic)) < 0.2
    assert unforetold_by_cubics(motions(wavy)) > 0.9


def test_nothing_is_left_of_what_was_said_rightly_and_all_of_silence() -> None:
    table = motions(cubic)
    assert unforetold(table, table.delta_tip_mm) == 0.0
    assert unforetold(table, np.zeros_like(table.delta_tip_mm)) == 1.0


def off(model: PretrainedModel) -> float:
    """Share of the arm's Jacobians, all over where it was explored."""
    wrong = right = 0.0
    for u in np.random.default_rng(5).uniform(17.0, 33.0, (40, 6)):
        steps = 1e-3 * np.eye(6)
        exact = np.array([(ARM.tip(u + s)[0] - ARM.tip(u - s)[0]) / 2e-3 for s in steps]).T
        wrong += float(((model.jacobian(ARM.tip(u)[0], u) - exact) ** 2).sum())
        right += float((exact**2).sum())
    return float(np.sqrt(wrong / right))


def test_a_model_goes_by_the_shape_where_that_foretells_better_than_its_fields() -> None:
    dataset = arm_dataset(60)
    model = PretrainedModel.of(pretrain(dataset, PretrainingSettings(epochs=3)), dataset)
    assert model.shape is not None
    by_fields = replace(model)
    vars(by_fields)["shape"] = None
    assert off(model) < 0.7 * off(by_fields)


def test_a_model_goes_by_its_fields_where_the_body_is_no_cubic() -> None:
    dataset = arm_dataset(60)
    model = PretrainedModel.of(pretrain(dataset, PretrainingSettings(epochs=3)), dataset)
    random = np.random.default_rng(6).permutation(len(model.motions))
    shuffled = replace(model.motions, u=model.motions.u[random])
    assert replace(model, motions=shuffled).shape is None
