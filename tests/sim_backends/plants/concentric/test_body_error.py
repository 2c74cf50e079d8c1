"""Sets of tubes that are off by as much as is asked for."""

import numpy as np
import pytest

from config.emulation.plants import ConcentricTubesPlant
from config.loader import load_robot
from sim_backends.plants.concentric.body_error import body_error, matched_variation
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes, variation
from sim_backends.plants.plant import TipLoad
from tests import SHIPPED_ROBOTS

ROBOT = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot


def plant() -> ConcentricTubesPlant:
    assert ROBOT.emulation is not None
    assert isinstance(ROBOT.emulation.plant, ConcentricTubesPlant)
    return ROBOT.emulation.plant


@pytest.mark.parametrize(("seed", "mean_mm"), [(1, 3.0), (3, 3.0), (2, 4.6)])
def test_a_matched_set_is_off_by_what_was_asked_for(seed: int, mean_mm: float) -> None:
    other = matched_variation(plant(), ROBOT.axes, seed, mean_mm)
    found = body_error(plant(), other, ROBOT.axes)
    assert found.mean_mm == pytest.approx(mean_mm, rel=0.01)
    assert mean_mm < found.rms_mm < found.highest_mm < 12.0
    assert max(abs(tube.turned_rad) for tube in other.tubes) < np.radians(9.0)
    made = variation(plant(), seed)
    assert [tube.sections for tube in other.tubes] == [tube.sections for tube in made.tubes]
    assert other == matched_variation(plant(), ROBOT.axes, seed, mean_mm)


def test_a_set_that_is_further_off_by_itself_stays_as_it_is() -> None:
    other = matched_variation(plant(), ROBOT.axes, 3, 0.5)
    assert max(abs(tube.turned_rad) for tube in other.tubes) < 1e-4
    assert body_error(plant(), other, ROBOT.axes).mean_mm > 2.0


def test_the_same_set_is_not_off() -> None:
    assert body_error(plant(), plant(), ROBOT.axes).highest_mm == 0.0


def test_what_homing_left_turns_a_tube_as_its_axis_would() -> None:
    tubes = tuple(tube.model_copy(update={"turned_rad": 0.1}) for tube in plant().tubes)
    off = ConcentricTubes(plant().model_copy(update={"tubes": tubes}))
    turned = ConcentricTubes(plant())
    at = np.array([0.2, 1.0, -0.4, 0.0, 2.0])
    by_axes = at + np.array([0.1, 0.1, 0.1, 0.0, 0.0])
    one = off.step(at, TipLoad(), 0.025).tip.position_mm
    other = turned.step(by_axes, TipLoad(), 0.025).tip.position_mm
    np.testing.assert_allclose(one, other, atol=0.5)  # they came there by other ways, and rub
