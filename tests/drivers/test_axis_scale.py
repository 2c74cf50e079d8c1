"""Counts, mm, rad, mL and N of each kind of axis."""

import ast
from math import pi
from pathlib import Path
from typing import Any, Literal, cast, get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter

import config.axis
from config.axis import Axis, LinearAxis, Quantity
from drivers.axis_scale import axis_scale, count_limits

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
    assert TENDON.tension_range_n == (0.5, 20.0)
    assert CYLINDER.tension_range_n is None


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


class Carriage(LinearAxis):
    """A kind of axis that nothing but its class knows: a rack and its pinion."""

    kind: Literal["carriage"] = "carriage"
    pinion_teeth: int
    pitch_mm: float

    @property
    def units_per_turn(self) -> float:
        return self.pinion_teeth * self.pitch_mm


def test_an_axis_of_a_new_kind_needs_its_class_alone() -> None:
    one = Carriage.model_validate(
        {"drive": DRIVE, **LINEAR, "pinion_teeth": 20, "pitch_mm": 2.0, "gear_ratio": 5.0}
    )
    scale, limits = axis_scale(cast(Axis, one)), count_limits(cast(Axis, one))
    assert (scale.unit, scale.counts(40.0), scale.ml_per_mm) == ("mm", 20_000, None)
    assert (limits.lowest, limits.highest, limits.max_velocity) == (-5_000, 25_000, 5_000)
    assert scale.force(1000) == pytest.approx(0.4 * 5.0 * 2 * pi / 0.04)
    assert (one.tension_range_n, one.piston_area_mm2) == (None, None)
    assert one.key("quick_stop_deceleration") == "quick_stop_deceleration_mm_s2"


@pytest.mark.parametrize("one", [CYLINDER, TENDON, ROTATION], ids=lambda one: one.kind)
def test_the_keys_of_the_unit_free_face_are_those_of_the_file(one: Axis) -> None:
    for quantity in get_args(Quantity):
        assert getattr(one, quantity) == getattr(one, one.key(quantity))


def test_positions_of_a_rotation_count_on_from_turn_to_turn() -> None:
    twice = ROTATION.model_copy(update={"travel_rad": (-2 * pi, 2 * pi)})
    assert count_limits(twice).highest == 4000


def test_nobody_else_asks_an_axis_for_its_kind() -> None:
    """A kind of axis is known to config/axis.py alone: all others use the unit-free face."""
    kinds = {kind.__name__ for kind in get_args(get_args(Axis)[0])} | {"LinearAxis", "RotaryAxis"}
    root = Path(config.axis.__file__).parents[1]
    for floor in ("config", "safety", "drivers", "sim_backends", "daemon"):
        for path in (root / floor).rglob("*.py"):
            text = path.read_text()
            if path.name == "axis.py" or not any(kind in text for kind in kinds):
                continue  # most files, which need not be parsed
            names = {n.id for n in ast.walk(ast.parse(text)) if isinstance(n, ast.Name)}
            assert not names & kinds, path
