"""Counts, mm, rad, mL and N of each kind of axis."""

from math import pi
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from config.axis import Axis
from drivers.axis_scale import axis_scale, count_limits, tension_range_n

DRIVE = {"bus": "can0", "node": 1, "counts_per_turn": 4000, "rated_torque_nmm": 400.0}
LINEAR = {
    "name": "a",
    "travel_mm": [-10.0, 50.0],
    "max_velocity_mm_s": 10.0,
    "max_acceleration_mm_s2": 100.0,
    "quick_stop_deceleration_mm_s2": 200.0,
    "following_error_mm": 1.0,
}


def axis(**keys: Any) -> Axis:
    base = {} if keys["kind"] == "tube_rotation" else LINEAR
    return TypeAdapter[Axis](Axis).validate_python({"drive": DRIVE, **base, **keys})


CYLINDER = axis(kind="linear_stepper", lead_mm=2.0, bore_mm=16.0)
TENDON = axis(
    kind="tendon_motor", spool_radius_mm=5.0, min_tension_n=0.5, max_tension_n=20.0, gear_ratio=10.0
)
ROTATION = axis(
    kind="tube_rotation",
    name="r",
    travel_rad=[-pi, pi],
    max_velocity_rad_s=1.0,
    max_acceleration_rad_s2=5.0,
    quick_stop_deceleration_rad_s2=10.0,
    following_error_rad=0.1,
)


def test_a_lead_screw_turns_counts_into_travel_and_volume() -> None:
    scale = axis_scale(CYLINDER)
    assert scale.counts(1.0) == 2000
    assert scale.position(2000) == 1.0
    assert scale.volume_ml(2000) == pytest.approx(pi * 8.0**2 / 1000)
    assert scale.counts_of_volume(pi * 8.0**2 / 1000) == 2000


def test_a_screw_without_a_cylinder_has_no_volume() -> None:
    scale = axis_scale(axis(kind="linear_stepper", lead_mm=2.0))
    assert scale.volume_ml(2000) is None
    with pytest.raises(ValueError, match="no cylinder"):
        scale.counts_of_volume(1.0)


def test_a_spool_turns_torque_into_tension() -> None:
    scale = axis_scale(TENDON)
    assert scale.counts(2 * pi * 5.0) == 40_000
    assert scale.force(500) == pytest.approx(0.5 * 400.0 * 10.0 / 5.0)
    assert tension_range_n(TENDON) == (0.5, 20.0)
    assert tension_range_n(CYLINDER) is None


def test_a_rotation_is_measured_in_rad_and_newton_millimetres() -> None:
    scale = axis_scale(ROTATION)
    assert (scale.unit, scale.counts(2 * pi)) == ("rad", 4000)
    assert scale.force(1000) == pytest.approx(400.0)


def test_a_translation_is_a_lead_screw() -> None:
    assert axis_scale(axis(kind="tube_translation", lead_mm=4.0)).counts(4.0) == 4000


def test_an_inverted_axis_counts_and_pulls_the_other_way() -> None:
    inverted = axis_scale(
        axis(kind="linear_stepper", lead_mm=2.0, drive={**DRIVE, "inverted": True})
    )
    assert inverted.counts(1.0) == -2000
    assert inverted.force(100) < 0
    limits = count_limits(
        axis(kind="linear_stepper", lead_mm=2.0, drive={**DRIVE, "inverted": True})
    )
    assert (limits.lowest, limits.highest) == (-100_000, 20_000)
    assert limits.max_velocity == 20_000


def test_limits_are_whole_counts_of_the_configured_units() -> None:
    limits = count_limits(CYLINDER)
    assert (limits.lowest, limits.highest, limits.max_velocity) == (-20_000, 100_000, 20_000)
    assert (limits.max_acceleration, limits.max_lag) == (200_000, 2_000)


@given(st.floats(-1e3, 1e3), st.sampled_from([CYLINDER, TENDON, ROTATION]))
def test_there_and_back_is_within_half_a_count(position: float, one: Axis) -> None:
    scale = axis_scale(one)
    half_a_count = abs(scale.position(0.5))
    assert scale.position(scale.counts(position)) == pytest.approx(position, abs=half_a_count)
