"""The filter of three values, against a textbook Kalman filter of all six states at once."""

import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise, kinematic_state_transition
from filterpy.kalman import KalmanFilter
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.estimation.constant_velocity import ConstantVelocity

NOISE, ACCELERATION, RATE = 0.04, 2500.0, 900.0

step = st.tuples(st.floats(1e-3, 0.5), st.lists(st.floats(-50.0, 50.0), min_size=3, max_size=3))


class Witness:
    """The same in matrices, by a third party's library."""

    def __init__(self, values: list[float]) -> None:
        made = KalmanFilter(dim_x=6, dim_z=3)
        made.H = np.hstack([np.eye(3), np.zeros((3, 3))])
        made.R = NOISE * np.eye(3)
        made.x = np.array([*values, 0.0, 0.0, 0.0])
        made.P = np.diag([NOISE] * 3 + [RATE] * 3)
        self.filter = made

    def advance(self, dt_s: float) -> None:
        self.filter.F = np.kron(kinematic_state_transition(1, dt_s), np.eye(3))
        self.filter.Q = Q_discrete_white_noise(
            2, dt_s, ACCELERATION, block_size=3, order_by_dim=False
        )
        self.filter.predict()


@settings(max_examples=50, deadline=None)
@given(st.lists(step, min_size=1, max_size=12))
def test_it_is_the_kalman_filter_of_constant_velocity(
    steps: list[tuple[float, list[float]]],
) -> None:
    began = [1.0, -2.0, 3.0]
    ours, witness = ConstantVelocity(NOISE, ACCELERATION), Witness(began)
    ours.begin(began, RATE)
    for dt_s, measured in steps:
        ahead, variance = ours.ahead(dt_s), ours.variance(dt_s)
        ours.advance(dt_s)
        witness.advance(dt_s)
        assert ours.values == ahead
        assert ours.variance(0.0) == variance
        assert variance == pytest.approx(witness.filter.P[0, 0], rel=1e-6)
        innovation = tuple(np.subtract(measured, ours.values).tolist())
        witness.filter.update(np.array(measured))
        assert ours.surprise(innovation, 0.0) == pytest.approx(
            witness.filter.mahalanobis**2, rel=1e-6, abs=1e-9
        )
        ours.correct(innovation)
        state = np.array([*ours.values, *ours.rates])
        np.testing.assert_allclose(state, witness.filter.x, rtol=1e-6, atol=1e-6)


def test_a_filter_that_begins_again_knows_nothing_of_what_was_before() -> None:
    used, fresh = ConstantVelocity(NOISE, ACCELERATION), ConstantVelocity(NOISE, ACCELERATION)
    used.begin((9.0, 9.0, 9.0), RATE)
    for _ in range(10):
        used.advance(0.025)
        used.correct((1.0, 2.0, 3.0))
    for each in (used, fresh):
        each.begin((1.0, 2.0, 3.0), RATE)
        each.advance(0.025)
        each.correct((0.1, 0.2, 0.3))
    assert used.values == fresh.values
    assert used.rates == fresh.rates
    assert used.variance(0.1) == fresh.variance(0.1)
