"""What makes a pneumatic arm hard to follow with: each effect by itself, against what it is."""

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from sim_backends.plants.plant import FloatArray, TipLoad
from sim_backends.plants.soft_arm.gas import ATMOSPHERE_MPA
from sim_backends.plants.soft_arm.soft_arm import SoftArm

PISTON_MM2 = np.pi / 4.0 * 25.0**2
PERIOD_S = 0.025
ELASTIC = SoftArmPlant(kind="soft_arm", hysteresis=0.0, creep=0.0)
PUSHED = np.array([20.0, 0.0, 0.0, 0.0, 10.0, 0.0])
FREE = TipLoad()


def built(**figures: float) -> SoftArm:
    return SoftArm(ELASTIC.model_copy(update=figures), [PISTON_MM2] * 6)


def tips(arm: SoftArm, shafts: FloatArray, dt_s: float = PERIOD_S) -> FloatArray:
    return np.array([arm.step(place, FREE, dt_s).tip.position_mm for place in shafts])


def ramp(seconds: float) -> FloatArray:
    """To a place and back, in two seconds, then rest."""
    t_s = np.arange(PERIOD_S, seconds, PERIOD_S)
    return np.asarray(np.clip(1.0 - np.abs(t_s - 1.0), 0.0, 1.0)[:, None] * PUSHED)


def test_a_dead_time_shows_the_same_motion_later() -> None:
    prompt, late = tips(built(), ramp(4.0)), tips(built(dead_time_s=0.25), ramp(4.0))
    np.testing.assert_allclose(late[10:], prompt[:-10], atol=1e-5)
    assert np.abs(late[:10] - late[0]).max() < 1e-6
    assert np.abs(late - prompt).max() > 5.0


def test_play_leaves_the_tip_where_it_is_until_it_is_taken_up() -> None:
    tight, loose = built(), built(backlash_mm=0.15)
    out, back = PUSHED, PUSHED - 0.29 * np.sign(PUSHED)
    for arm in (tight, loose):
        arm.step(out, FREE, 100.0)
        arm.step(out, FREE, 100.0)
    stays = loose.step(out, FREE, 100.0).tip.position_mm
    np.testing.assert_allclose(loose.step(back, FREE, 100.0).tip.position_mm, stays, atol=1e-6)
    moved_mm = tight.step(back, FREE, 100.0).tip.position_mm - stays
    assert np.linalg.norm(moved_mm) > 0.3


def left_to_go(lag_s: float, lags: int) -> FloatArray:
    """(lags,) share of a small step's way that is left after 1, 2, ... lags."""
    arm = built(pneumatic_lag_s=lag_s)
    rest = arm.step(np.zeros(6), FREE, 100.0).tip.position_mm
    small = 0.02 * PUSHED
    way = tips(arm, np.tile(small, (100 * lags, 1)), lag_s / 100.0)[99::100] - rest
    whole = arm.step(small, FREE, 1e3).tip.position_mm - rest
    return np.asarray(1.0 - way @ whole / (whole @ whole))


@pytest.mark.parametrize("lag_s", [0.1, 0.5, 1.0])
def test_the_tip_comes_to_rest_exponentially_in_proportion_to_the_lag(lag_s: float) -> None:
    """A chamber that gets longer takes up more gas, so its time constant is above the line's."""
    left = left_to_go(lag_s, 4)
    np.testing.assert_allclose(left[1:] / left[:-1], left[0], rtol=0.02)
    np.testing.assert_allclose(left, left_to_go(0.1, 4), rtol=1e-3)
    assert 1.0 <= -1.0 / np.log(left[0]) < 1.6


def test_gas_escapes_at_the_rate_of_the_leak() -> None:
    """Stiff against the gas, lines keep their volume, and the gauge pressure decays by e^-rt."""
    arm = built(leak_per_hour=2.0, axial_stiffness_n=1e5, bending_stiffness_n_mm2=1e7)
    start = arm.chamber_pressure_mpa - ATMOSPHERE_MPA
    tips(arm, np.zeros((360, 6)), 5.0)
    left = (arm.chamber_pressure_mpa - ATMOSPHERE_MPA) / start
    np.testing.assert_allclose(left, np.exp(-2.0 * 0.5), rtol=5e-3)


def test_a_sound_arm_loses_no_gas() -> None:
    arm = built()
    start = arm.chamber_pressure_mpa
    tips(arm, np.zeros((360, 6)), 5.0)
    np.testing.assert_allclose(arm.chamber_pressure_mpa, start, rtol=1e-9)


def test_an_aged_arm_is_an_arm_of_less_stiffness() -> None:
    aged = built(ageing=0.2, ageing_time_h=1.0)
    aged.step(PUSHED, FREE, 1e6)
    old = aged.step(PUSHED, FREE, 1e6).tip.position_mm
    # Shear and torsion follow bending and stretching, so all of the section is softer alike.
    softer = built(bending_stiffness_n_mm2=0.8 * 8.0e3, axial_stiffness_n=0.8 * 130.0)
    free = np.zeros(6)
    softer_moves = softer.step(PUSHED, FREE, 1e6).tip.position_mm
    new = built().step(PUSHED, FREE, 1e6).tip.position_mm
    assert np.linalg.norm(old - new) > 3.0
    # The softer arm was filled as it stood then, a little longer: the rest of the difference.
    assert np.linalg.norm(old - softer_moves) < 0.3 * np.linalg.norm(old - new)
    aged.reset()
    young = aged.step(free, FREE, 0.0).tip.position_mm
    np.testing.assert_allclose(young, built().step(free, FREE, 0.0).tip.position_mm, atol=1e-9)


def area_of_loop(hysteresis: float) -> float:
    """How far apart the ways there and back are, as a share of the way."""
    arm = built(hysteresis=hysteresis)
    up = np.linspace(0.0, 1.0, 41)[:, None] * PUSHED
    there, back = tips(arm, up, 10.0), tips(arm, up[::-1], 10.0)[::-1]
    return float(np.linalg.norm(there - back, axis=1).max() / np.linalg.norm(there[-1] - there[0]))


def test_the_loop_is_wider_with_more_hysteresis_and_none_without() -> None:
    widths = [area_of_loop(share) for share in (0.0, 0.15, 0.5)]
    assert widths[0] < 1e-4
    assert 0.04 < widths[1] < widths[2] / 1.5
    assert widths[2] < 0.15


def test_the_same_steps_after_a_reset_give_the_same_bits() -> None:
    arm = built(
        dead_time_s=0.2, backlash_mm=0.1, leak_per_hour=0.1, ageing=0.1, hysteresis=0.4, creep=0.2
    )
    arm.reset()
    first = tips(arm, ramp(3.0))
    arm.reset()
    assert (tips(arm, ramp(3.0)) == first).all()
