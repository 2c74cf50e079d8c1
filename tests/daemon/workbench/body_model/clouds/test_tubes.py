"""Clouds of concentric tubes: axes that come round, a body that is as long as its axes say, and
many bodies of one design."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from config.loader import RobotFile, load_robot
from daemon.robot.axes import AxisRanges
from daemon.workbench.body_model.clouds.centreline_fit import VisibleSurface
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset, CloudDatasetError
from daemon.workbench.body_model.clouds.cloud_import import (
    ImportSettings,
    import_clouds,
    surface_of,
)
from daemon.workbench.body_model.clouds.cloud_table import TABLE
from daemon.workbench.body_model.clouds.collection import CollectionSettings
from daemon.workbench.body_model.clouds.configurations import Candidates
from daemon.workbench.body_model.clouds.emulated_body import (
    Bodies,
    EmulatedBody,
    evenly_spaced,
)
from daemon.workbench.body_model.clouds.parallel_collection import collect
from tests import SHIPPED_ROBOTS, SOFT_ARM
from tests.daemon.workbench.body_model.clouds.test_collection import Silent
from tests.daemon.workbench.body_model.small_clouds import TENDON_ARM

pytestmark = pytest.mark.xdist_group(
    "clouds_of_tubes"
)  # whose clouds are collected once for all tests

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
SETTINGS = CollectionSettings(training=8, test=2, starts=2, points=200, bodies=20)


def tubes() -> RobotFile:
    return load_robot(TUBES)


def some_ways(robot_path: Path, count: int) -> np.ndarray:
    candidates = Candidates(load_robot(robot_path).robot, seed=5)
    parameters = candidates.parameters(0, 10 * count)
    possible = [u for u in candidates.actuation(parameters) if candidates.possible(u)]
    return np.array(possible[:count])


def test_axes_that_come_round_are_sampled_once_round() -> None:
    ranges = AxisRanges.of(tubes().robot)
    np.testing.assert_allclose(ranges.period, [2.0 * np.pi] * 3 + [0.0] * 2)
    candidates = Candidates(tubes().robot, seed=1)
    u = candidates.actuation(candidates.parameters(0, 400))
    assert np.abs(u[:, :3]).max() <= np.pi + 1e-9
    assert (np.ptp(u, axis=0) > 0.97 * np.array([2.0 * np.pi] * 3 + list(ranges.travel[3:]))).all()


def test_an_axis_that_does_not_go_all_the_way_round_is_sampled_as_far_as_it_goes() -> None:
    robot = tubes().robot
    axes = [
        axis.model_copy(update={"travel_rad": (-1.0, 2.0)}) if axis.unit == "rad" else axis
        for axis in robot.axes
    ]
    lowest, highest = AxisRanges.of(robot.model_copy(update={"axes": axes})).one_round
    assert (lowest[0], highest[0]) == (-1.0, 2.0)


@pytest.mark.parametrize("path", [SOFT_ARM, TENDON_ARM, TUBES], ids=lambda path: path.stem)
def test_a_body_is_where_and_as_long_as_its_extent_says(path: Path) -> None:
    robot = load_robot(path).robot
    assert robot.emulation is not None
    body = EmulatedBody(robot)
    nodes = None
    for u in some_ways(path, 4):
        extent = robot.emulation.plant.extent(u.tolist())
        line = body.go(u).centreline_mm
        np.testing.assert_allclose(line[0], [0.0, 0.0, extent.begin_mm], atol=1e-6)
        length_mm = np.linalg.norm(np.diff(line, axis=0), axis=1).sum()
        assert abs(np.log(length_mm / extent.length_mm)) < 2.0 * extent.stretch
        assert nodes in (None, len(line))
        nodes = len(line)


def test_nodes_are_put_evenly_where_they_are_not_and_else_are_left() -> None:
    turn = np.linspace(0.0, 1.5, 17) ** 1.4
    arc = 50.0 * np.column_stack([1.0 - np.cos(turn), 0.0 * turn, np.sin(turn)])
    even = evenly_spaced(arc, 30)
    chords = np.linalg.norm(np.diff(even, axis=0), axis=1)
    assert len(even) == 30
    assert chords.max() < 1.001 * chords.min()
    np.testing.assert_allclose(np.linalg.norm(even - [50.0, 0.0, 0.0], axis=1), 50.0, atol=0.01)
    np.testing.assert_allclose(even[[0, -1]], arc[[0, -1]])
    assert evenly_spaced(even, 30) is even


def test_bodies_of_one_design_differ_and_are_the_same_again() -> None:
    u = some_ways(TUBES, 1)[0]
    random, again = np.random.default_rng(1), np.random.default_rng(1)
    tips = [
        [bodies.rested(draws).go(u).tip.position_mm for _ in range(4)]
        for bodies, draws in (
            (Bodies(tubes().robot, 100), random),
            (Bodies(tubes().robot, 100), again),
            (Bodies(tubes().robot, 0), random),
        )
    ]
    np.testing.assert_array_equal(tips[0], tips[1])
    assert np.ptp(tips[0], axis=0).max() > 0.3
    assert np.ptp(tips[2], axis=0).max() == 0.0


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> CloudDataset:
    path = tmp_path_factory.mktemp("tubes") / "clouds.npz"
    with ThreadPoolExecutor(1) as pool:
        collect(tubes(), SETTINGS, path, pool, Silent())
    return CloudDataset.load(path, tubes().robot)


def test_tubes_are_found_in_their_clouds_however_far_they_are_out(collected: CloudDataset) -> None:
    true_mm, found_mm = collected.true_centrelines_mm, collected.centrelines_mm
    assert true_mm is not None
    off = np.linalg.norm(true_mm.astype(np.float64) - found_mm, axis=3)
    assert np.median(off) < 0.5
    assert np.quantile(off, 0.99) < 1.5
    begins = found_mm[:, :, 0, 2] - collected.configurations[:, None, 3]
    assert np.abs(begins).max() < 0.2


def test_clouds_say_which_axes_come_round(collected: CloudDataset) -> None:
    np.testing.assert_allclose(collected.period, [2.0 * np.pi] * 3 + [0.0] * 2)
    assert collected.provenance["settings"]["bodies"] == 20


@pytest.mark.parametrize("period", [[1.0], [-1.0] * 5, "round", [None] * 5])
def test_periods_that_are_none_are_refused(collected: CloudDataset, period: object) -> None:
    provenance = {**collected.provenance, "period": period}
    arrays = {
        name: np.asarray(getattr(collected, name))
        for name in ("configurations", "starts", "clouds_mm", "centrelines_mm", "fit_error_mm")
    }
    arrays |= {
        name: np.asarray(getattr(collected, name))
        for name in ("forces", "test", "block", "radius_mm")
    }
    with pytest.raises(CloudDatasetError, match="period must be"):
        CloudDataset.checked(arrays, provenance)


def test_the_surface_of_tubes_is_that_of_the_thickest_all_along() -> None:
    emulation = tubes().robot.emulation
    assert emulation is not None
    surface = VisibleSurface.of(emulation.plant, [0.0, 0.0, 0.0, 4.0, 10.0])
    assert surface.tube_radius_mm == 1.4
    assert surface.begin_mm == 4.0
    assert surface.length_mm == pytest.approx(150.0 + 53.5 + 6.0)


def test_clouds_of_a_real_set_are_fitted_as_long_as_its_axes_say(
    collected: CloudDataset, tmp_path: Path
) -> None:
    """The length that is stated is that with all axes at zero."""
    robot = tubes().robot
    rows = [["file", *(axis.name for axis in robot.axes), "test"]]
    for i, u in enumerate(collected.configurations):
        for j, cloud in enumerate(collected.clouds_mm[i]):
            np.savez(tmp_path / f"c{i}_{j}.npz", points=cloud)
            rows.append([f"c{i}_{j}.npz", *map(repr, u.tolist()), str(int(i < 2))])
    (tmp_path / TABLE).write_text("\n".join(",".join(row) for row in rows))
    known = surface_of(robot)
    assert known is not None
    assert known[0].length_mm == pytest.approx(150.0 + 53.5)
    with ThreadPoolExecutor(1) as pool:
        made = import_clouds(robot, tmp_path, ImportSettings(*known, points=200), pool, Silent())
    true_mm = collected.true_centrelines_mm
    assert true_mm is not None
    tips_off = np.linalg.norm(made.centrelines_mm[:, :, -1] - true_mm[:, :, -1], axis=2)
    assert np.median(tips_off) < 1.0
    assert tips_off.max() < 3.0
    np.testing.assert_allclose(made.period[:3], 2.0 * np.pi)
