"""Collecting clouds: the paper's protocol, the same whoever carries it out and however often."""

import shutil
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.loader import RobotFile
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION, EXIT_OK, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.host.processes import Share
from daemon.workbench.body_model.clouds import parallel_collection
from daemon.workbench.body_model.clouds.centreline_fit import (
    FittedCentreline,
    VisibleSurface,
    fit_centreline,
)
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
from daemon.workbench.body_model.clouds.collection import (
    CollectionError,
    CollectionSettings,
    fitted_at,
    planned,
    possible_ones,
    seen_at,
)
from daemon.workbench.body_model.clouds.parallel_collection import collect, collect_share
from daemon.workbench.body_model.evaluation.evaluation import off_curves
from tests.daemon.workbench.body_model.small_clouds import TENDON_ARM, tendon_arm

pytestmark = pytest.mark.xdist_group(
    "cloud_collection"
)  # whose clouds are collected once for all tests

POINTS = 128
SETTINGS = CollectionSettings(training=13, test=3, starts=2, points=POINTS)


class Silent:
    """A `Progress`."""

    def __init__(self) -> None:
        self.begun: list[tuple[str, float, float]] = []
        self.done = 0.0

    def begin(self, what: str, total: float, done: float = 0.0) -> None:
        self.begun.append((what, total, done))
        self.done = done

    def advance(self, by: float = 1.0) -> None:
        self.done += by

    def reach(self, done: float, total: float = 0.0, what: str = "") -> None:
        raise AssertionError("it is told in parts")


@pytest.fixture
def worker() -> Iterator[Executor]:
    with ThreadPoolExecutor(1) as pool:
        yield pool


@pytest.fixture(scope="module")
def collected(tmp_path_factory: pytest.TempPathFactory) -> tuple[CloudDataset, Path, Silent]:
    path, heard = tmp_path_factory.mktemp("clouds") / "clouds.npz", Silent()
    with ThreadPoolExecutor(1) as pool:
        return collect(tendon_arm(), SETTINGS, path, pool, heard), path, heard


Collected = tuple[CloudDataset, Path, Silent]


def test_all_that_was_wanted_is_there(collected: Collected) -> None:
    made, path, heard = collected
    assert made.clouds_mm.shape == (16, 2, POINTS, 3)
    assert made.test.sum() == 3
    phases = ("what it can hold", "clouds", "centrelines")
    assert heard.begun == [(phase, 16, 0) for phase in phases]
    assert heard.done == 16
    assert [one.name for one in path.parent.iterdir()] == ["clouds.npz"]
    assert CloudDataset.load(path, tendon_arm().robot).sha256 == made.sha256
    assert made.provenance["settings"]["starts"] == 2


@pytest.mark.long
def test_shares_of_two_machines_put_together_are_the_same_data_set(
    collected: Collected, tmp_path: Path, worker: Executor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parallel_collection, "_PART", 8)  # of 16: one for each
    folders = [tmp_path / "one", tmp_path / "other"]

    def round_of_both() -> list[CloudDataset | None]:
        made = [
            collect_share(
                tendon_arm(), SETTINGS, folder / "c.npz", worker, Silent(), Share(index, 2)
            )
            for index, folder in enumerate(folders, 1)
        ]
        for one, other in (folders, folders[::-1]):  # as rsync would
            for path in (one / "c.npz.parts").glob("*"):
                shutil.copy(path, other / "c.npz.parts" / path.name)
        return made

    for folder in folders:
        folder.mkdir()
    assert round_of_both() == [None, None]  # clouds
    parts = sorted(path.name[-8:] for path in (folders[0] / "c.npz.parts").glob("*.0*.npz"))
    assert parts == ["0000.npz", "0001.npz"]
    assert round_of_both() == [None, None]  # centrelines
    whole = collect(tendon_arm(), SETTINGS, folders[1] / "c.npz", worker, Silent())
    assert whole.sha256 == collected[0].sha256


def test_tendons_hold_at_every_configuration(collected: Collected) -> None:
    made, _, _ = collected
    assert (made.forces > 0.0).mean() > 0.99
    assert made.forces.max() < 20.0


def test_clouds_are_of_the_body(collected: Collected) -> None:
    made, _, _ = collected
    away = made.clouds_mm[:, :, :, None] - made.centrelines_mm[:, :, None]
    nearest = np.linalg.norm(away, axis=4).min(axis=3)
    assert np.quantile(nearest, 0.95) < made.radius_mm
    assert np.median(nearest) > 2.0


def test_centrelines_are_fitted_to_the_clouds(collected: Collected) -> None:
    """Near to the true ones, which are kept to be compared with, and not the same."""
    made, _, _ = collected
    assert made.true_centrelines_mm is not None
    assert made.provenance["centrelines"] == "fitted to the clouds"
    off = off_curves(made.centrelines_mm, made.true_centrelines_mm)
    assert 0.05 < np.median(off) < 0.5
    robot = tendon_arm().robot
    assert robot.emulation is not None
    surface = VisibleSurface.of(robot.emulation.plant, made.configurations[5])
    fit = fit_centreline(made.clouds_mm[5, 0], surface, made.centrelines_mm.shape[2])
    np.testing.assert_array_equal(made.centrelines_mm[5, 0], fit.nodes_mm.astype(np.float32))


def test_clouds_are_moved_by_what_the_cameras_are_off(collected: Collected) -> None:
    """By the same for all, and that is told; how far centrelines may still be off, too."""
    made, _, _ = collected
    which = np.array([3, 14])
    seen = seen_at(
        tendon_arm().robot, SETTINGS, which, made.configurations[which], made.starts[which]
    )
    moved = made.clouds_mm[which] - seen["clouds_mm"]
    told = made.provenance["clouds_moved_by_mm"]
    assert 0.1 < np.linalg.norm(told) < 1.5
    np.testing.assert_allclose(moved, np.broadcast_to(told, moved.shape), atol=1e-3)
    assert made.fit_error_mm[0] < 0.1
    assert 0.05 < made.fit_error_mm[4:].min() <= made.fit_error_mm.max() < 1.5


def test_a_cloud_in_which_no_body_lies_is_no_part_of_a_collection(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def nowhere(points: Any, *_: object, **__: object) -> FittedCentreline:
        return FittedCentreline(np.zeros((3, 3)), np.zeros(24), 9.0, 0.4, 0.5)

    monkeypatch.setattr("daemon.workbench.body_model.clouds.collection.fit_centreline", nowhere)
    clouds = np.zeros((1, 2, POINTS, 3), np.float32)
    with pytest.raises(CollectionError, match="no body lies in the cloud with the axes at"):
        fitted_at(tendon_arm().robot, np.zeros((1, 4)), clouds, 19, np.zeros(3))


def test_where_it_came_from_shows_in_its_shape(collected: Collected) -> None:
    made, _, _ = collected
    tips = made.centrelines_mm[:, :, -1]
    apart = np.linalg.norm(tips[:, 0] - tips[:, 1], axis=1)
    assert np.median(apart) > 0.3
    assert apart.max() < 40.0


def test_starts_are_other_configurations(collected: Collected) -> None:
    made, _, _ = collected
    for u, origins in zip(made.configurations, made.starts, strict=True):
        for origin in origins:
            assert not np.array_equal(u, origin)
            assert (made.configurations == origin).all(axis=1).any()


def test_what_is_seen_does_not_depend_on_what_else_is_seen(collected: Collected) -> None:
    made, _, _ = collected
    which = np.array([11, 4])
    again = seen_at(
        tendon_arm().robot, SETTINGS, which, made.configurations[which], made.starts[which]
    )
    np.testing.assert_array_equal(again["forces"], made.forces[which])
    for clouds, moved in zip(again["clouds_mm"], made.clouds_mm[which], strict=True):
        by = (moved - clouds).reshape(-1, 3)
        np.testing.assert_allclose(by, np.broadcast_to(by[0], by.shape), atol=1e-4)


class AtOnce(Executor):
    """Does what it is given before it answers: then all parts are there when the first is kept."""

    def submit(self, task: Any, /, *args: Any, **kwargs: Any) -> "Future[Any]":
        future: Future[Any] = Future()
        future.set_result(task(*args, **kwargs))
        return future


def test_an_interrupted_collection_goes_on_and_ends_the_same(
    collected: Collected, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, worker: Executor
) -> None:
    monkeypatch.setattr("daemon.workbench.body_model.clouds.parallel_collection._PART", 10)
    path = tmp_path / "again.npz"
    parts = tmp_path / "again.npz.parts"

    at_once = AtOnce()
    real = np.savez_compressed
    saved: list[str] = []

    def stop_after_one(file: Any, *args: Any, **kwargs: Any) -> None:
        real(file, *args, **kwargs)
        saved.append(str(file.name))
        if sum("plan" not in name for name in saved) == 2:
            raise KeyboardInterrupt

    monkeypatch.setattr("daemon.array_files.np.savez_compressed", stop_after_one)
    with pytest.raises(KeyboardInterrupt):
        collect(tendon_arm(), SETTINGS, path, at_once, Silent())
    assert not path.exists()
    assert len(list(parts.iterdir())) == 2  # the plan, and one part: the other was not whole
    monkeypatch.setattr("daemon.array_files.np.savez_compressed", real)
    heard = Silent()
    made = collect(tendon_arm(), SETTINGS, path, worker, heard)
    what, total, done = heard.begun[0]
    assert (what, total) == ("clouds", 16)
    assert 0 < done < 16
    assert made.sha256 == collected[0].sha256
    assert not parts.exists()


def test_parts_of_other_settings_are_not_taken_over(tmp_path: Path, worker: Executor) -> None:
    path = tmp_path / "clouds.npz"
    parts = tmp_path / "clouds.npz.parts"
    parts.mkdir()
    (parts / "0123456789abcdef.0000.npz").write_bytes(b"of something else")
    few = CollectionSettings(training=2, test=1, starts=1, points=60)
    assert len(collect(tendon_arm(), few, path, worker, Silent())) == 3


def test_a_block_is_one_place_of_the_configurations() -> None:
    robot = tendon_arm().robot
    parameters = np.random.default_rng(1).random((2000, 4))
    plan = planned(robot, CollectionSettings(1800, 200, 1), parameters)
    inside = parameters[plan["block"]]
    assert 0.05 < plan["block"].mean() < 0.15
    for column, (values, every) in enumerate(zip(inside.T, parameters.T, strict=True)):
        between = (every >= values.min()) & (every <= values.max())
        assert between.mean() < 0.35 if column < 2 else between.mean() > 0.9


def test_candidates_of_other_places_are_other_ones() -> None:
    robot = tendon_arm().robot
    first, second = (possible_ones(robot, 1, begin, 40) for begin in (0, 40))
    both = possible_ones(robot, 1, 0, 80)
    np.testing.assert_array_equal(np.concatenate([first, second]), both)


def without_emulation() -> RobotFile:
    file = tendon_arm()
    return replace(file, robot=file.robot.model_copy(update={"emulation": None}))


def test_a_rig_without_an_emulation_cannot_be_collected(tmp_path: Path, worker: Executor) -> None:
    with pytest.raises(CollectionError, match="no 'emulation' in this robot file"):
        collect(without_emulation(), SETTINGS, tmp_path / "x.npz", worker, Silent())
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--starts", "0"], EXIT_USAGE),
        (["--configurations", "3"], EXIT_USAGE),
        (["--configurations", "30", "--starts", "30"], EXIT_USAGE),
        (["--points", "29"], EXIT_USAGE),
        (["--processes", "0"], EXIT_USAGE),
    ],
)
def test_requests_that_cannot_be_met_leave_no_file(
    words: list[str], code: int, tmp_path: Path
) -> None:
    path = tmp_path / "clouds.npz"
    assert main(["mdn", "collect", str(TENDON_ARM), "--out", str(path), *words]) == code
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_command_collects_with_processes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "clouds.npz"
    words = ["--configurations", "20", "--starts", "2", "--points", "60", "--processes", "2"]
    assert main(["mdn", "collect", str(TENDON_ARM), "--out", str(path), *words]) == EXIT_OK
    assert "20 configurations (2 to test with" in capsys.readouterr().out
    made = CloudDataset.load(path, tendon_arm().robot)
    with ThreadPoolExecutor(1) as pool:
        again = collect(
            tendon_arm(), CollectionSettings(18, 2, 2, 60), tmp_path / "again.npz", pool, Silent()
        )
    assert made.sha256 == again.sha256


def test_a_robot_file_that_is_not_there_is_told(tmp_path: Path) -> None:
    words = ["mdn", "collect", str(tmp_path / "no.yaml"), "--out", str(tmp_path / "c.npz")]
    assert main(words) == EXIT_CONFIGURATION
