"""What is under way counts with what the last motions made of what was told."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.control.lag.answer import ON_A_PATH_S, ON_THE_WAY_BACK_S, Answer
from drivers.pose import Vector

DT_S = 0.025
LAG_S = 0.4
SOFTER = np.array([[1.3, 0.15, 0.0], [-0.1, 1.2, 0.0], [0.0, 0.0, 1.25]])


def answered(arrived_mm: Vector, tip_mm: Vector, memory_s: float = ON_A_PATH_S) -> Answer:
    """(n, 3) step by step."""
    answer = Answer()
    for k, (arrived, tip) in enumerate(zip(arrived_mm, tip_mm, strict=True)):
        answer.add(k * DT_S, DT_S, tip, arrived, LAG_S, memory_s)
    return answer


def straight(mm_s: float, steps: int = 40) -> Vector:
    """(n, 3) along a diagonal."""
    along = np.array([0.8, 0.6, 0.0])
    return np.asarray(mm_s * DT_S * np.arange(steps)[:, None] * along)


def test_before_anything_is_seen_a_tip_goes_where_it_is_told_to() -> None:
    np.testing.assert_array_equal(Answer().matrix, np.eye(3))
    rest = np.zeros((40, 3))
    np.testing.assert_allclose(answered(rest, rest).matrix, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("memory_s", [ON_A_PATH_S, ON_THE_WAY_BACK_S])
def test_along_the_way_it_is_known_how_far_and_how_far_aside_the_tip_goes(memory_s: float) -> None:
    told = straight(30.0)
    answer = answered(told, told @ SOFTER.T, memory_s)
    next_mm = told[-1] - told[-5]
    missed_mm = np.linalg.norm(SOFTER @ next_mm - answer.matrix @ next_mm)
    assert missed_mm < 0.15 * np.linalg.norm(SOFTER @ next_mm - next_mm)


def test_across_the_way_nothing_is_known_and_nothing_is_said() -> None:
    told = straight(30.0)
    across = np.array([-0.6, 0.8, 0.0])
    np.testing.assert_allclose(answered(told, told @ SOFTER.T).matrix @ across, across, atol=1e-6)


def test_noise_alone_makes_a_tip_answer_no_otherwise() -> None:
    told = straight(5.0, 400)
    noisy = told + 0.2 * np.random.default_rng(2).normal(size=told.shape)
    assert np.linalg.norm(answered(told, noisy).matrix - np.eye(3)) < 0.15


def test_what_was_a_second_ago_is_forgotten_on_a_path_and_not_on_a_way_back() -> None:
    told, after = straight(30.0), 40
    tip = told @ SOFTER.T
    rest = np.ones((after, 1))
    told, tip = (np.concatenate([way, rest * way[-1]]) for way in (told, tip))
    along = np.array([0.8, 0.6, 0.0])
    left = [
        float(np.linalg.norm(answered(told, tip, memory_s).matrix @ along - along))
        for memory_s in (ON_A_PATH_S, ON_THE_WAY_BACK_S)
    ]
    assert left[0] < 0.8 * left[1]


def test_another_body_is_begun_anew() -> None:
    told = straight(30.0)
    answer = answered(told, told @ SOFTER.T)
    answer.begin()
    np.testing.assert_array_equal(answer.matrix, np.eye(3))


def zigzag(period_s: float, steps: int = 600) -> Vector:
    """(n, 3) to and fro by 6 mm, while a circle of 20 mm/s is gone."""
    times = DT_S * np.arange(steps)
    circle = np.column_stack([np.cos(times), np.sin(times), np.zeros(steps)])
    swing = np.abs((2.0 * times / period_s) % 2.0 - 1.0)
    return np.asarray(20.0 * circle + 6.0 * swing[:, None] * np.array([0.6, -0.8, 0.0]))


def with_play(told_mm: Vector, half_mm: float) -> Vector:
    """(n, 3) where the tip is behind play in each direction."""
    tip_mm = told_mm.copy()
    for k in range(1, len(tip_mm)):
        low, high = told_mm[k] - half_mm, told_mm[k] + half_mm
        tip_mm[k] = np.clip(tip_mm[k - 1], low, high)
    return tip_mm


def test_before_anything_is_seen_nothing_is_believed() -> None:
    assert Answer().worth == 0.0


def test_a_body_that_answers_alike_for_longer_than_it_is_late_is_gone_by() -> None:
    told = zigzag(0.9)
    noise = 0.2 * np.random.default_rng(5).normal(size=told.shape)
    assert answered(told, told @ SOFTER.T + noise).worth == 1.0


@pytest.mark.parametrize("half_mm", [1.5, 2.5])
def test_what_play_shows_for_a_moment_is_not_gone_by(half_mm: float) -> None:
    told = zigzag(0.9)
    assert answered(told, with_play(told, half_mm)).worth < 0.5


def test_noise_is_not_gone_by() -> None:
    told = zigzag(0.9)
    noise = 0.5 * np.random.default_rng(5).normal(size=told.shape)
    assert answered(told, told + noise).worth < 0.3


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 10**6), size_mm=st.floats(0.0, 1e3))
def test_whatever_is_seen_what_is_to_be_told_stays_in_proportion(seed: int, size_mm: float) -> None:
    generator = np.random.default_rng(seed)
    matrix = answered(*(size_mm * generator.normal(size=(2, 40, 3)))).matrix
    values = np.linalg.svd(matrix)[1]
    assert values.max() <= 1.8 + 1e-9
    assert values.min() >= 0.6 - 1e-9
