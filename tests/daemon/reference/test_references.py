"""References that are not trajectories: the way to the start, and teleoperation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.reference.reference import Blend
from daemon.reference.teleoperation import SetpointReference
from drivers.pose import Vector

FROM = np.array([0.0, 0.0, 168.0])
TO = np.array([12.0, -50.0, 185.0])
PERIOD_NS = 25_000_000
SPEED = 10.0


def test_a_blend_begins_and_ends_at_rest_and_keeps_its_speed() -> None:
    blend = Blend(FROM, TO, SPEED)
    times = np.linspace(0.0, blend.duration_s, 400)
    speeds = np.array([np.linalg.norm(blend.at(t)[1]) for t in times])
    assert speeds.max() <= SPEED * (1 + 1e-9)
    assert speeds.max() > 0.99 * SPEED
    assert speeds[0] == 0.0
    assert speeds[-1] == 0.0
    np.testing.assert_allclose(blend.at(-1.0)[0], FROM)
    np.testing.assert_allclose(blend.at(blend.duration_s + 1.0)[0], TO)


def test_a_blend_goes_straight_and_its_velocity_is_its_slope() -> None:
    blend = Blend(FROM, TO, SPEED)
    for t_s in np.linspace(0.1, blend.duration_s - 0.1, 20):
        slope = (blend.at(t_s + 1e-5)[0] - blend.at(t_s - 1e-5)[0]) / 2e-5
        np.testing.assert_allclose(blend.at(t_s)[1], slope, atol=1e-4)
        assert np.linalg.norm(np.cross(blend.at(t_s)[0] - FROM, TO - FROM)) < 1e-6


def test_a_blend_from_where_the_tip_is_takes_no_time() -> None:
    blend = Blend(TO, TO, SPEED)
    assert blend.duration_s == 0.0
    np.testing.assert_array_equal(blend.at(0.0)[0], TO)
    np.testing.assert_array_equal(blend.at(0.0)[1], 0.0)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan")])
def test_a_blend_needs_a_speed(speed: float) -> None:
    with pytest.raises(ValueError, match="no way"):
        Blend(FROM, TO, speed)


def test_a_blend_needs_places() -> None:
    with pytest.raises(ValueError, match="no way"):
        Blend(np.array([0.0, np.nan, 0.0]), TO, SPEED)


def test_without_a_setpoint_the_reference_stands_where_it_began() -> None:
    reference = SetpointReference(FROM, SPEED)
    for k in range(5):
        position, velocity = reference.advance(k * PERIOD_NS)
        np.testing.assert_array_equal(position, FROM)
        np.testing.assert_array_equal(velocity, 0.0)
    assert not reference.valid(0)


def test_a_setpoint_is_approached_no_faster_than_allowed_and_met() -> None:
    reference = SetpointReference(FROM, SPEED)
    reference.set(0, TO, 100.0)
    before = FROM
    for k in range(400):
        position, velocity = reference.advance(k * PERIOD_NS)
        assert np.linalg.norm(position - before) <= SPEED * 0.025 * (1 + 1e-9)
        np.testing.assert_allclose(velocity * 0.025, position - before, atol=1e-9)
        before = position
    np.testing.assert_allclose(position, TO, atol=1e-9)
    np.testing.assert_allclose(velocity, 0.0, atol=1e-9)


def test_when_a_setpoint_expires_the_reference_stops_there() -> None:
    reference = SetpointReference(FROM, SPEED)
    reference.set(0, TO, 0.25)
    assert reference.valid(250_000_000)
    assert not reference.valid(250_000_001)
    for k in range(40):
        reference.advance(k * PERIOD_NS)
    position, velocity = reference.advance(41 * PERIOD_NS)
    assert np.linalg.norm(position - FROM) == pytest.approx(0.25 * SPEED)
    np.testing.assert_array_equal(velocity, 0.0)


def test_after_an_interruption_the_reference_does_not_make_up_for_it() -> None:
    reference = SetpointReference(FROM, SPEED)
    reference.set(0, TO, 0.1)
    for k in range(80):
        before, _ = reference.advance(k * PERIOD_NS)
    reference.set(80 * PERIOD_NS, TO, 1.0)
    after, _ = reference.advance(80 * PERIOD_NS)
    assert np.linalg.norm(after - before) <= SPEED * 0.025 * (1 + 1e-9)


def test_a_moving_setpoint_is_followed_between_messages() -> None:
    reference = SetpointReference(FROM, SPEED)
    velocity = np.array([4.0, 0.0, 0.0])
    reference.advance(0)
    reference.set(0, FROM, 1.0, velocity)
    for k in range(1, 30):
        position, moving = reference.advance(k * PERIOD_NS)
    np.testing.assert_allclose(position, FROM + velocity * 29 * 0.025, atol=1e-9)
    np.testing.assert_allclose(moving, velocity, atol=1e-9)


@settings(max_examples=50, deadline=None)
@given(
    values=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=2, max_size=4),
    valid_s=st.sampled_from([0.0, -1.0, float("nan"), float("inf"), 0.2]),
)
def test_a_setpoint_that_makes_no_sense_is_refused_and_changes_nothing(
    values: list[float], valid_s: float
) -> None:
    sound = len(values) == 3 and bool((np.abs(values) <= 1e5).all()) and valid_s == 0.2
    reference = SetpointReference(FROM, SPEED)
    position: Vector = np.array(values)
    if sound:
        reference.set(0, position, valid_s)
        reference.advance(0)
        assert np.isfinite(reference.advance(PERIOD_NS)[0]).all()
        return
    with pytest.raises(ValueError, match="set-point"):
        reference.set(0, position, valid_s)
    assert not reference.valid(0)
    assert np.isfinite(reference.advance(PERIOD_NS)[0]).all()
