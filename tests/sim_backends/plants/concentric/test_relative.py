"""What shapes a body of tubes, and grids of it."""

import numpy as np
import pytest

from config.loader import load_robot
from sim_backends.plants.concentric.concentric_tubes import ConcentricTubes
from sim_backends.plants.concentric.relative import Poses, RelativeRangeError, RelativeTubes
from sim_backends.plants.plant import TipLoad
from tests import SHIPPED_ROBOTS
from tests.sim_backends.plants.concentric.tube_sets import plant_config, tube

AXES = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot.axes
OUT = (20.0, 87.0)


def grid(points: int, extension_mm: tuple[float, float] = OUT) -> Poses:
    return RelativeTubes(plant_config(), AXES, extension_mm).poses(points)


def test_a_grid_has_every_combination_once_with_all_ends() -> None:
    poses = grid(5)
    assert len(np.unique(poses.configuration.round(9), axis=0)) == 5**3
    np.testing.assert_allclose(poses.configuration.min(axis=0), [-np.pi, -np.pi, 20.0])
    np.testing.assert_allclose(poses.configuration.max(axis=0), [np.pi, np.pi, 87.0])
    assert np.isfinite(poses.tip_mm).all()
    np.testing.assert_allclose(np.linalg.norm(poses.direction, axis=1), 1.0)


def test_the_poses_are_those_of_the_plant_without_weight_and_friction() -> None:
    """Rolled and pushed forward, which the relative configuration leaves out."""
    config = plant_config(friction_nmm=0.0)
    light = tuple(one.model_copy(update={"mass_mg_mm": 0.0}) for one in config.tubes)
    plant = ConcentricTubes(config.model_copy(update={"tubes": light}))
    poses = grid(4)
    for configuration, tip_mm in zip(poses.configuration[::7], poses.tip_mm[::7], strict=True):
        pair, inner, out_mm = configuration
        plant.reset()
        plant.step(np.array([0.0, 0.0, 0.0, 0.0, 87.0]), TipLoad(), 0.1)
        plant.step(np.array([0.0, pair, inner, 0.0, 87.0]), TipLoad(), 0.1)
        state = plant.step(np.array([0.0, pair, inner, 6.0, out_mm + 6.0]), TipLoad(), 0.1)
        # At ±π the shapes of both ways round are the same but for the last bits.
        expected = tip_mm + np.array([0.0, 0.0, 6.0])
        np.testing.assert_allclose(state.tip.position_mm, expected, atol=1e-3)


def test_angles_come_round_and_extensions_do_not() -> None:
    tubes = RelativeTubes(plant_config(), AXES, OUT)
    assert tubes.periods == (2.0 * np.pi, 2.0 * np.pi, None)
    poses = grid(5)
    low = poses.configuration[:, 0] == poses.configuration[:, 0].min()
    high = poses.configuration[:, 0] == poses.configuration[:, 0].max()

    def sorted_tips(mask: np.ndarray) -> np.ndarray:
        rows = np.lexsort(poses.configuration[mask][:, 1:].T)
        return np.asarray(poses.tip_mm[mask][rows])

    np.testing.assert_allclose(sorted_tips(low), sorted_tips(high), atol=1e-6)


def test_where_two_shapes_are_stable_it_is_the_one_that_is_drawn_in_with() -> None:
    """Where the inner tube is turned against the middle of the pair decides, and no more."""
    poses = grid(40, (0.5, 87.0))
    pair, inner, out_mm = poses.configuration.T
    rows = (np.abs(pair) < 0.1) & (out_mm == out_mm.min()) & (np.abs(inner) > 3.0)
    assert rows.sum() >= 4
    against = (inner - 0.5 * pair + np.pi) % (2.0 * np.pi) - np.pi
    sides = np.sign(poses.tip_mm[rows, 1]) * np.sign(against[rows])
    assert len(set(sides.tolist())) == 1
    assert np.abs(poses.tip_mm[rows, 1]).min() > 3.0


def test_without_a_word_the_range_is_as_far_as_the_axes_go() -> None:
    robot = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
    assert robot.emulation is not None
    tubes = RelativeTubes(robot.emulation.plant, robot.axes)  # type: ignore[arg-type]
    np.testing.assert_allclose((tubes.lowest[2], tubes.highest[2]), (0.0, 87.0))


@pytest.mark.parametrize(
    ("extension_mm", "text"),
    [((87.0, 20.0), "from lowest to highest"), ((0.0, 110.0), "pass each other")],
)
def test_what_cannot_be_is_refused(extension_mm: tuple[float, float], text: str) -> None:
    with pytest.raises(RelativeRangeError, match=text):
        RelativeTubes(plant_config(), AXES, extension_mm)


def test_bodies_that_have_no_relative_configuration_are_refused() -> None:
    single = plant_config(tubes=(tube(100.0, 1e-3),))
    with pytest.raises(RelativeRangeError, match="one shape only"):
        RelativeTubes(single, AXES)
    with pytest.raises(RelativeRangeError, match="in front of a plate"):
        RelativeTubes(plant_config(mouth="plate"), AXES)


@pytest.mark.parametrize("points", [1, 1000])
def test_a_grid_is_neither_a_point_nor_endless(points: int) -> None:
    with pytest.raises(RelativeRangeError, match="a grid of"):
        grid(points)
