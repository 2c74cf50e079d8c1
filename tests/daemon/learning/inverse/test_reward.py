"""What motions cost, and how sharply the reward tells them apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.learning.inverse.local_controller_settings import LocalControllerSettings, typical_steps
from daemon.learning.inverse.reward import attractor_step, costs, effective_samples, reward_scale
from tests.daemon.learning.exploring_arm import exploration

STEPS = np.array([0.5, 1.0, 2.0])


def settings(**options: object) -> LocalControllerSettings:
    return LocalControllerSettings(1.0, STEPS, **options)  # type: ignore[arg-type]


def test_the_cheapest_step_leads_to_the_posture_not_away_from_it() -> None:
    u, posture = np.array([4.0, -3.0, 1.0]), np.array([1.0, 2.0, 1.0])
    asked = settings(attractor_gain=0.25, attractor_steps=None)
    arrived = u + attractor_step(asked, u, posture) * STEPS
    assert arrived - posture == pytest.approx(0.75 * (u - posture))


def test_a_far_posture_is_approached_in_typical_steps() -> None:
    far = attractor_step(settings(attractor_steps=1.0), np.zeros(3), np.array([1e3, 1e3, 1e3]))
    near = attractor_step(settings(attractor_steps=1.0), np.zeros(3), np.array([0.1, 0.0, 0.0]))
    assert np.sqrt(np.mean(far**2)) == pytest.approx(1.0)
    assert near[0] == pytest.approx(0.1 * 0.1 / STEPS[0])


def test_a_cost_is_quadratic_in_the_distance_from_the_cheapest_step() -> None:
    weighting = np.array([[2.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 3.0]])
    asked = settings(weighting=weighting)
    u, posture = np.array([1.0, 0.0, -1.0]), np.zeros(3)
    cheapest = attractor_step(asked, u, posture)
    away = np.array([0.3, -0.2, 0.1])
    assert costs(asked, u, cheapest * STEPS, posture) == 0.0
    for times in (1.0, 2.0):
        cost = costs(asked, u, (cheapest + times * away) * STEPS, posture)
        assert cost == pytest.approx(times**2 * away @ weighting @ away)


def test_costs_of_many_motions_are_those_of_each() -> None:
    random = np.random.default_rng(0)
    u, delta_u, posture = random.normal(size=(5, 3)), random.normal(size=(5, 3)), np.ones(3)
    many = costs(settings(), u, delta_u, posture)
    assert many == pytest.approx([costs(settings(), u[k], delta_u[k], posture) for k in range(5)])


def test_a_typical_step_costs_one_if_nothing_draws() -> None:
    assert costs(settings(), np.zeros(3), STEPS, np.zeros(3)) == pytest.approx(1.0)


@given(unit=st.floats(1e-6, 1e6), seed=st.integers(0, 10))
def test_the_unit_of_costs_does_not_matter_to_the_mean_rule(unit: float, seed: int) -> None:
    random = np.random.default_rng(seed)
    weights, cost = random.random(20), random.random(20)
    scale = reward_scale(settings(), weights, cost)
    assert reward_scale(settings(), weights, unit * cost) * unit == pytest.approx(scale)
    assert scale == pytest.approx(3.0 * weights.sum() / (weights @ cost))


def test_the_printed_rule_is_the_mean_cost() -> None:
    weights, cost = np.array([1.0, 3.0]), np.array([2.0, 6.0])
    assert reward_scale(settings(sigma_rule="printed"), weights, cost) == pytest.approx(5.0)


@given(seed=st.integers(0, 50), kappa=st.floats(0.5, 100.0), least=st.floats(2.0, 40.0))
def test_the_effective_sample_rule_is_as_sharp_as_it_may_be(
    seed: int, kappa: float, least: float
) -> None:
    random = np.random.default_rng(seed)
    weights, cost = random.random(50) ** 2, random.exponential(size=50)
    asked = settings(sigma_rule="ess", kappa=kappa, effective_samples=least)
    scale = reward_scale(asked, weights, cost)
    sharpest = reward_scale(settings(kappa=kappa), weights, cost)
    assert 0.0 <= scale <= sharpest
    if scale > 0.0:
        assert effective_samples(weights, cost, scale) >= least * (1.0 - 1e-9)
    if 0.0 < scale < sharpest:
        assert effective_samples(weights, cost, scale) == pytest.approx(least, rel=1e-6)
    if scale == 0.0:
        assert effective_samples(weights, cost, 0.0) <= least * (1.0 + 1e-9)


def test_steps_that_cost_nothing_give_no_infinite_sharpness() -> None:
    scale = reward_scale(settings(), np.ones(3), np.zeros(3))
    assert np.isfinite(scale)
    assert effective_samples(np.ones(3), np.zeros(3), scale) == pytest.approx(3.0)


def test_no_samples_give_no_sharpness() -> None:
    assert reward_scale(settings(), np.zeros(2), np.ones(2)) == 0.0


def test_weights_too_small_to_be_squared_still_count() -> None:
    assert effective_samples(np.full(4, 1e-200), np.zeros(4), 1.0) == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"ridge": 0.0}, "ridge must be above 0"),
        ({"kappa": np.nan}, "kappa must be above 0"),
        ({"attractor_gain": 1.0}, "attractor_gain must be"),
        ({"prior_mass": -1.0}, "prior_mass must not"),
        ({"weighting": np.ones(2)}, "weighting must be"),
        ({"weighting": -np.ones(3)}, "positive definite"),
        ({"sigma_rule": "median"}, "there is no 'median'"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        settings(**options)


def test_typical_steps_are_root_mean_squares() -> None:
    samples = exploration(50)
    tip_step_mm, axis_steps = typical_steps(samples)
    lengths = [np.linalg.norm(sample.delta_tip_mm) for sample in samples]
    assert tip_step_mm == pytest.approx(np.sqrt(np.mean(np.square(lengths))))
    assert axis_steps[2] == pytest.approx(
        np.sqrt(np.mean([sample.delta_u[2] ** 2 for sample in samples]))
    )
    with pytest.raises(ValueError, match="no samples"):
        typical_steps([])
