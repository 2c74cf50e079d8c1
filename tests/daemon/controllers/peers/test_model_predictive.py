"""The prediction of the tip, the disturbance that is observed, and what both are for."""

import numpy as np
import pytest

from daemon.controllers.peers.model_predictive import LaggedTip
from drivers.pose import Vector

DT_S, DEAD_S, LAG_S = 0.025, 0.1, 0.2
ENDS_S = 0.1 * np.arange(1.0, 11.0)


def told(steps: Vector, observer_s: float = 0.2) -> LaggedTip:
    """A tip that was told these, mm along x, from step to step."""
    tip = LaggedTip(DEAD_S, LAG_S, observer_s)
    tip.see(np.zeros(3))
    for mm in steps:
        tip.tell(np.array([mm, 0.0, 0.0]), DT_S)
    return tip


def test_a_step_arrives_after_the_dead_time_and_with_the_lag() -> None:
    coming = told(np.array([1.0])).coming(ENDS_S)[:, 0]
    expected = -np.expm1(-np.maximum(ENDS_S - DEAD_S, 0.0) / LAG_S)
    np.testing.assert_allclose(coming, expected, atol=1e-9)


def test_what_is_foretold_is_what_comes() -> None:
    steps = np.random.default_rng(1).normal(size=60)
    tip = told(steps)
    coming = tip.coming(ENDS_S)
    for _ in range(round(ENDS_S[-1] / DT_S)):
        tip.tell(np.zeros(3), DT_S)
    np.testing.assert_allclose(tip.tip_mm, coming[-1], atol=1e-9)


def test_the_response_is_that_of_even_motions() -> None:
    tip, dense = told(np.zeros(1)), LaggedTip(DEAD_S, LAG_S, 0.2)
    dense.see(np.zeros(3))
    for _ in range(200):  # the second interval, in steps of half a millisecond
        dense.tell(np.array([1.0 / 200, 0.0, 0.0]), 0.1 / 200)
    seen = dense.coming(ENDS_S)[:-2, 0]
    np.testing.assert_allclose(tip.response(ENDS_S)[2:, 1], seen, atol=3e-3)
    assert not np.triu(tip.response(ENDS_S), 1).any()


@pytest.mark.parametrize("speed_mm_s", [0.0, 4.0])
def test_what_no_model_has_is_found_at_rest_and_on_a_straight_way(speed_mm_s: float) -> None:
    tip = told(np.zeros(1))
    for k in range(200):
        tip.tell(np.zeros(3), DT_S)
        tip.see(np.array([7.0 + speed_mm_s * k * DT_S, 0.0, 0.0]))
    last = 7.0 + speed_mm_s * 199 * DT_S
    assert tip.tip_mm[0] == pytest.approx(last, abs=1e-3)
    np.testing.assert_allclose(tip.coming(ENDS_S)[:, 0], last + speed_mm_s * ENDS_S, atol=1e-2)


@pytest.mark.parametrize("unseen", [1, 8])
def test_while_the_tip_is_not_seen_the_disturbance_goes_on_as_it_did(unseen: int) -> None:
    tip, speed_mm_s = told(np.zeros(1)), 4.0
    for k in range(400):
        tip.tell(np.zeros(3), DT_S)
        truth = np.array([speed_mm_s * k * DT_S, 0.0, 0.0])
        if k > 200:
            np.testing.assert_allclose(tip.tip_mm, truth, atol=1e-2)
        if k < 200 or k % unseen == 0:
            tip.see(truth)


def test_an_observer_that_is_slower_lets_less_noise_through() -> None:
    spreads = []
    for observer_s in (0.1, 0.4):
        tip, random, seen = told(np.zeros(1), observer_s), np.random.default_rng(1), []
        for _ in range(400):
            tip.tell(np.zeros(3), DT_S)
            tip.see(0.3 * random.normal(size=3))
            seen.append(tip.tip_mm)
        spreads.append(float(np.std(seen)))
    assert spreads[1] < 0.7 * spreads[0] < 0.25
