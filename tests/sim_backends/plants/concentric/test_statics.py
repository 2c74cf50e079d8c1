"""Statics of concentric tubes in cases whose answer is known."""

from math import cos, sin, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.pose import rotate
from sim_backends.plants.concentric.concentric_tubes import statics_of
from sim_backends.plants.concentric.statics import Setting
from sim_backends.plants.concentric.statics_kernels import FloatArray
from tests.sim_backends.plants.concentric.tube_sets import (
    BENT,
    DOWN,
    GJ,
    NO_FORCE,
    PAIR_MM,
    energy,
    equal_setting,
    equal_tubes,
    plant_config,
    settled,
)

Z = np.array([0.0, 0.0, 1.0])


def paper_setting(pair: float, inner: float, out_mm: float, tip_n: FloatArray) -> Setting:
    return Setting(np.array([0.0, pair, inner]), np.array([0.0, -17.0, out_mm - 121.0]), tip_n)


def test_one_tube_is_an_arc() -> None:
    statics = equal_tubes(1)
    found = settled(statics, equal_setting(statics, [0.4], NO_FORCE))
    radius, turn = 1.0 / BENT, BENT * PAIR_MM
    sideways = radius * (1.0 - cos(turn))
    expected = [sideways * sin(0.4), -sideways * cos(0.4), radius * sin(turn)]
    np.testing.assert_allclose(found.march.position_mm[-1], expected, atol=1e-4)
    assert found.determinant == 1.0


def test_equal_tubes_that_bend_alike_keep_their_curvature() -> None:
    one, three = equal_tubes(1), equal_tubes(3)
    alone = settled(one, equal_setting(one, [0.7], NO_FORCE))
    found = settled(three, equal_setting(three, [0.7] * 3, NO_FORCE))
    np.testing.assert_allclose(found.march.position_mm[-1], alone.march.position_mm[-1], atol=1e-6)
    np.testing.assert_allclose(found.march.twist_rad_mm, 0.0, atol=1e-12)


def test_equal_tubes_that_bend_against_each_other_are_straight() -> None:
    statics = equal_tubes(2)
    found = settled(statics, equal_setting(statics, [0.0, np.pi], NO_FORCE))
    np.testing.assert_allclose(found.march.position_mm[-1], [0.0, 0.0, PAIR_MM], atol=1e-6)


@pytest.mark.parametrize("transmission_mm", [0.0, 40.0, 120.0])
def test_the_determinant_of_an_opposed_pair_is_what_its_linear_equation_gives(
    transmission_mm: float,
) -> None:
    """δ'' = -c δ with δ(0) = ℓ δ'(0): δ'(L)/δ'(0) = cos - ℓ √c sin, of √c L."""
    statics = equal_tubes(2, transmission_mm=transmission_mm)
    found = settled(statics, equal_setting(statics, [0.0, np.pi], NO_FORCE))
    rate = sqrt(1.3) * BENT
    turn = rate * PAIR_MM
    expected = cos(turn) - transmission_mm * rate * sin(turn)
    assert expected > 0.0
    assert found.determinant == pytest.approx(expected, rel=1e-6)


def test_an_opposed_pair_that_is_bent_too_much_does_not_stay_straight() -> None:
    """cos √c L is negative: straight, it would be on a ridge."""
    statics = equal_tubes(2, curvature_per_mm=12e-3)
    found = settled(statics, equal_setting(statics, [0.0, np.pi], NO_FORCE))
    assert np.hypot(*found.march.position_mm[-1, :2]) > 10.0
    assert found.determinant > 0.0
    again = settled(statics, equal_setting(statics, [0.0, np.pi], NO_FORCE))
    np.testing.assert_array_equal(again.march.position_mm, found.march.position_mm)


def test_tubes_in_one_plane_stay_in_it() -> None:
    statics = statics_of(plant_config(), ideal=True)
    found = settled(statics, paper_setting(0.0, 0.0, 50.0, np.array([0.0, -0.1, 0.05])))
    np.testing.assert_allclose(found.march.position_mm[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(found.march.angle_rad, 0.0, atol=1e-12)


def test_a_beam_under_its_own_weight_sags_as_the_formula_says() -> None:
    """w L⁴ / 8 EI for a straight, level beam."""
    statics = equal_tubes(1, curvature_per_mm=0.0, weight_n_mm=1e-5)
    found = settled(statics, equal_setting(statics, [0.0], NO_FORCE))
    expected = 1e-5 * PAIR_MM**4 / (8.0 * 50_000.0)
    assert found.march.position_mm[-1] @ DOWN == pytest.approx(expected, rel=1e-4)


def test_a_beam_with_a_load_at_its_tip_bends_as_the_formula_says() -> None:
    """F L³ / 3 EI."""
    statics = equal_tubes(1, curvature_per_mm=0.0)
    force = np.array([1e-3, 0.0, 0.0])
    found = settled(statics, equal_setting(statics, [0.0], force))
    expected = 1e-3 * PAIR_MM**3 / (3.0 * 50_000.0)
    assert found.march.position_mm[-1, 0] == pytest.approx(expected, rel=1e-4)


ANGLE = st.floats(-3.0, 3.0)
OUT = st.floats(25.0, 86.0)


@settings(max_examples=25, deadline=None)
@given(pair=ANGLE, inner=ANGLE, out_mm=OUT, fx=st.floats(-0.1, 0.1), fy=st.floats(-0.1, 0.1))
def test_torques_add_up_and_moments_vanish_at_the_end(
    pair: float, inner: float, out_mm: float, fx: float, fy: float
) -> None:
    statics = statics_of(plant_config(friction_nmm=0.0))
    found = settled(statics, paper_setting(pair, inner, out_mm, np.array([fx, fy, 0.02])))
    march, layout = found.march, found.layout
    np.testing.assert_allclose(march.moment_nmm[-1], 0.0, atol=1e-4)
    np.testing.assert_allclose(march.twist_rad_mm[-1], 0.0, atol=1e-8)
    # The moment at the mouth is that of all forces in front of it, tube by tube.
    lever, ends = march.position_mm[-1], np.array([fx, fy, 0.02])
    moment = np.cross(lever, ends)
    for k in range(len(layout.bending_n_mm2)):
        own_n = layout.force_n[k, 0] - layout.force_n[k, 1]
        middle = 0.5 * (march.position_mm[k] + march.position_mm[k + 1])
        moment += np.cross(middle, own_n)
    np.testing.assert_allclose(march.moment_nmm[0], moment[:2], atol=0.02)
    torques = float(statics.tubes.torsion_n_mm2 @ march.twist_rad_mm[0])
    assert torques == pytest.approx(moment[2], abs=0.02)


@settings(max_examples=25, deadline=None)
@given(roll=ANGLE, pair=ANGLE, inner=ANGLE, out_mm=OUT)
def test_all_tubes_turned_alike_turn_the_body(
    roll: float, pair: float, inner: float, out_mm: float
) -> None:
    statics = statics_of(plant_config(), ideal=True)
    setting = paper_setting(pair, inner, out_mm, NO_FORCE)
    found = settled(statics, setting)
    rolled = settled(statics, setting._replace(rotation_rad=setting.rotation_rad + roll))
    turn = np.array([cos(0.5 * roll), 0.0, 0.0, sin(0.5 * roll)])
    expected = np.array([rotate(turn, p) for p in found.march.position_mm])
    np.testing.assert_allclose(rolled.march.position_mm, expected, atol=1e-6)


@pytest.mark.parametrize("force", [NO_FORCE, np.array([0.03, -0.02, 0.04])], ids=["free", "loaded"])
@pytest.mark.parametrize(
    "collars_mm", [[-3.0, -25.0, -90.0], [-1.0, -30.0, -60.0]], ids=["short", "long"]
)
def test_what_tubes_push_and_turn_with_is_the_slope_of_their_energy(
    force: FloatArray, collars_mm: list[float]
) -> None:
    """By central differences; tubes whose ends lie apart."""
    statics = statics_of(plant_config(friction_nmm=0.0))
    statics.interval_mm = 0.25
    setting = Setting(np.array([0.3, 1.6, -0.8]), np.array(collars_mm), force)
    found = settled(statics, setting)

    def slope(field: str, i: int, step: float) -> float:
        values = []
        for sign in (1.0, -1.0):
            moved = getattr(setting, field).copy()
            moved[i] += sign * step
            there = statics.near(
                setting._replace(**{field: moved}), found.base, statics.no_sliders()
            )
            assert there is not None
            values.append(energy(statics, there))
        return (values[0] - values[1]) / (2.0 * step)

    torques = -statics.tubes.torsion_n_mm2 * found.base[:3]
    pushes = statics.pushes(found)
    for i in range(3):
        assert torques[i] == pytest.approx(slope("rotation_rad", i, 1e-3), abs=2e-3)
        assert pushes[i] == pytest.approx(slope("collar_mm", i, 0.25), abs=2e-3)


def test_a_stiffer_transmission_twists_less() -> None:
    setting = paper_setting(1.5, -1.0, 40.0, NO_FORCE)
    twisting = settled(statics_of(plant_config(), ideal=True), setting)
    rigid = settled(statics_of(plant_config(twisting_transmissions=False), ideal=True), setting)
    np.testing.assert_array_equal(rigid.march.angle_rad[0], setting.rotation_rad)
    behind = twisting.march.angle_rad[0] - setting.rotation_rad
    np.testing.assert_allclose(behind, -setting.collar_mm * twisting.base[:3], atol=1e-12)
    assert np.linalg.norm(twisting.march.position_mm[-1] - rigid.march.position_mm[-1]) > 1.0


def test_flush_and_fully_pushed_tubes_have_no_interval_without_length() -> None:
    statics = statics_of(plant_config(), ideal=True)
    for out_mm in (0.0, 1e-7, 86.9999999, 87.0):
        found = settled(statics, paper_setting(0.5, 0.2, out_mm, NO_FORCE))
        assert np.diff(found.layout.node_mm).min() > 0.01


def test_an_inner_tube_that_is_drawn_in_carries_the_tip_within() -> None:
    """Its tip then is not where the others end."""
    statics = statics_of(plant_config(), ideal=True)
    setting = paper_setting(0.5, 0.2, -10.0, np.array([0.05, 0.0, 0.0]))
    found = settled(statics, setting)
    tip = found.layout.tip_node
    assert found.layout.node_mm[tip] == pytest.approx(140.0)
    assert found.layout.node_mm[-1] == pytest.approx(150.0)
    np.testing.assert_array_equal(found.layout.force_n[tip:], 0.0)


def test_the_twist_of_a_pair_is_that_of_a_pendulum() -> None:
    """First integral: a'²/2 + (1+ν) κ² cos a is the same everywhere."""
    statics = equal_tubes(2)
    found = settled(statics, equal_setting(statics, [0.0, 2.0], NO_FORCE))
    angle = found.march.angle_rad[:, 1] - found.march.angle_rad[:, 0]
    rate = found.march.twist_rad_mm[:, 1] - found.march.twist_rad_mm[:, 0]
    whole = 0.5 * rate**2 + 50_000.0 / GJ * BENT**2 * np.cos(angle)
    np.testing.assert_allclose(whole, whole[0], rtol=1e-6)
    assert abs(rate[0]) > 1e-3


def test_tips_of_a_motion_are_those_of_its_places_alone_however_gently_it_goes() -> None:
    """It begins fast, goes on gently, and leaps in the middle."""
    statics = statics_of(plant_config(), ideal=True)
    at = np.concatenate([0.1 * np.arange(8), 0.8 + 1e-3 * np.arange(12), 1.4 + 1e-3 * np.arange(6)])
    rotation = np.stack([0.3 * at, at, 2.0 * at], axis=1)
    collar = np.stack([0.0 * at, -17.0 + at, -70.0 + 5.0 * at], axis=1)
    tips, directions = statics.tips(rotation, collar)
    for row, (turned, pushed) in enumerate(zip(rotation, collar, strict=True)):
        tip, direction = statics.tips(turned[None], pushed[None])
        np.testing.assert_allclose(tips[row], tip[0], atol=1e-5)
        np.testing.assert_allclose(directions[row], direction[0], atol=1e-7)
