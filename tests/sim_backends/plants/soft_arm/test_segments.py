"""Arms of other segments than two of three chambers each, by their options alone."""

import numpy as np
import pytest

from config.emulation.plants import SoftArmPlant
from sim_backends.plants.plant import GRAVITY_N_G, BodyState, FloatArray, TipLoad, variation
from sim_backends.plants.soft_arm.soft_arm import SoftArm

PISTON_MM2 = np.pi / 4.0 * 25.0**2
ELASTIC = {"kind": "soft_arm", "hysteresis": 0.0, "creep": 0.0, "mass_g": 27.0}
LONG_S = 60.0


def built(*segments: dict[str, float], **figures: object) -> SoftArm:
    plant = SoftArmPlant.model_validate({**ELASTIC, "segments": list(segments), **figures})
    return SoftArm(plant, [PISTON_MM2] * plant.chambers)


def moved(arm: SoftArm, pistons: list[float], load: TipLoad | None = None) -> BodyState:
    """From rest to there, and left alone for long."""
    arm.reset()
    state = arm.step(np.zeros(arm.actuator_count), load or TipLoad(), LONG_S)
    for share in np.linspace(0.1, 1.0, 10):
        state = arm.step(share * np.array(pistons), load or TipLoad(), LONG_S)
    return state


def turned(by_rad: float) -> FloatArray:
    c, s = np.cos(by_rad), np.sin(by_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize("chambers", [3, 4, 6])
def test_a_segment_at_rest_is_stretched_by_its_pre_pressure(chambers: int) -> None:
    """In closed form: the chambers' push less half of the weight, over EA."""
    arm = built({"length_mm": 100.0, "chambers": chambers})
    stretch = (chambers * 0.04 * 95.0 - 0.5 * GRAVITY_N_G * 27.0) / 130.0
    expected = [0.0, 0.0, 100.0 * (1.0 + stretch)]
    np.testing.assert_allclose(moved(arm, [0.0] * chambers).tip.position_mm, expected, atol=0.01)


@pytest.mark.parametrize("chambers", [3, 4, 5])
def test_each_chamber_bends_it_away_from_itself_and_all_alike(chambers: int) -> None:
    arm = built({"length_mm": 100.0, "chambers": chambers})
    first = moved(arm, [15.0] + [0.0] * (chambers - 1)).tip.position_mm
    assert first[0] < -5.0
    assert abs(first[1]) < 1e-4
    for index in range(1, chambers):
        pistons = [15.0 * float(one == index) for one in range(chambers)]
        expected = turned(2.0 * np.pi * index / chambers) @ first
        np.testing.assert_allclose(moved(arm, pistons).tip.position_mm, expected, atol=1e-3)


def test_a_segment_that_is_turned_bends_the_same_arm_elsewhere() -> None:
    straight = moved(built({"length_mm": 100.0}), [15.0, 5.0, 0.0]).tip.position_mm
    other = moved(built({"length_mm": 100.0, "rotation_rad": 0.7}), [15.0, 5.0, 0.0])
    np.testing.assert_allclose(other.tip.position_mm, turned(0.7) @ straight, atol=1e-3)


def test_actuators_are_the_chambers_of_one_segment_after_the_other() -> None:
    """The last of three segments moves the tip alone; what is below it stays."""
    arm = built(
        {"length_mm": 60.0}, {"length_mm": 40.0, "chambers": 4}, {"length_mm": 50.0}, mass_g=1.0
    )
    rest = moved(arm, [0.0] * 10)
    far = moved(arm, [0.0] * 7 + [20.0, 0.0, 0.0])
    places = np.linalg.norm(far.centreline_mm - rest.centreline_mm, axis=1)
    below = rest.centreline_mm[:, 2] < 0.6 * rest.centreline_mm[-1, 2]
    assert places[-1] > 5.0
    assert places[below].max() < 0.5
    near = moved(arm, [20.0] + [0.0] * 9)
    assert near.tip.position_mm[0] < -20.0


def test_a_shorter_arm_bears_more_before_it_leans() -> None:
    """Euler's load goes with one over the length squared."""
    load = TipLoad(mass_g=40.0)
    leans = []
    for length_mm in (80.0, 160.0):
        arm = built({"length_mm": length_mm})
        without = moved(arm, [10.0, 0.0, 0.0]).tip.position_mm[0]
        leans.append(moved(arm, [10.0, 0.0, 0.0], load).tip.position_mm[0] / without)
    assert 1.0 < leans[0] < 1.2 < leans[1]


def test_other_arms_of_a_design_have_its_segments() -> None:
    one = SoftArmPlant.model_validate({**ELASTIC, "segments": [{"length_mm": 100.0}]})
    three = SoftArmPlant.model_validate({**ELASTIC, "segments": [{"length_mm": 50.0}] * 3})
    for plant in (one, three):
        other = variation(plant, 3)
        assert other != plant
        assert len(other.chamber_area_ratios) == plant.chambers
        turns = [segment.rotation_rad for segment in other.segments]
        assert turns[0] == 0.0
        assert len(set(turns)) == len(turns)
        SoftArm(other, [PISTON_MM2] * plant.chambers)


def test_it_needs_a_piston_for_each_chamber() -> None:
    plant = SoftArmPlant.model_validate({**ELASTIC, "segments": [{"length_mm": 100.0}]})
    with pytest.raises(ValueError, match="3 pistons"):
        SoftArm(plant, [PISTON_MM2] * 6)
