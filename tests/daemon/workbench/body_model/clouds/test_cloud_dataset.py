"""Clouds on disk: what is kept is read, and nothing that is not whole is believed."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.loader import load_robot
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset, CloudDatasetError
from tests.daemon.workbench.body_model.small_clouds import SOFT_ARM, arrays, dataset, tendon_arm

ARRAYS = (
    "configurations",
    "starts",
    "clouds_mm",
    "centrelines_mm",
    "fit_error_mm",
    "forces",
    "test",
    "block",
)
TRUE = "true_centrelines_mm"


def test_what_was_saved_is_read(tmp_path: Path) -> None:
    path, made = tmp_path / "clouds.npz", dataset()
    made.save(path)
    read = CloudDataset.load(path, tendon_arm().robot)
    for name in (*ARRAYS, TRUE):
        np.testing.assert_array_equal(getattr(read, name), getattr(made, name))
    assert read.radius_mm == made.radius_mm
    assert read.provenance["robot"] == "tendon_arm"
    assert read.sha256 == made.sha256
    assert [one.name for one in tmp_path.iterdir()] == ["clouds.npz"]


def test_what_is_learnt_from_and_tested_with_is_apart() -> None:
    both = arrays()
    both["configurations"][1] = both["configurations"][0]  # the first is to test with
    with pytest.raises(CloudDatasetError, match="configuration 1 is to learn from, and there aga"):
        CloudDataset.checked(both, {})
    both["test"][1] = True
    CloudDataset.checked(both, {})


def test_clouds_have_a_digest_whatever_start_they_were_come_to_from_first() -> None:
    made = dataset()
    every = np.ones(len(made), np.bool_)
    digests = made.digests(every)
    assert len(set(digests)) == len(made)
    assert replace(made, clouds_mm=made.clouds_mm[:, ::-1]).digests(every) == digests
    assert made.digests(made.test) == [one for one, t in zip(digests, made.test, strict=True) if t]
    moved = made.clouds_mm.copy()
    moved[3, 1, 2, 0] += 0.01
    changed = replace(made, clouds_mm=moved).digests(every)
    assert [i for i, one in enumerate(changed) if one != digests[i]] == [3]


def test_true_centrelines_need_not_be_known(tmp_path: Path) -> None:
    parts = arrays()
    true = parts.pop("true_centrelines_mm")
    path = tmp_path / "clouds.npz"
    replace(dataset(), true_centrelines_mm=None).save(path)
    assert CloudDataset.load(path, tendon_arm().robot).true_centrelines_mm is None
    assert CloudDataset.checked(parts, {}).true_centrelines_mm is None
    with pytest.raises(CloudDatasetError, match="true_centrelines_mm is"):
        CloudDataset.checked({**parts, "true_centrelines_mm": true[:-1]}, {})
    true[2, 1, 3, 0] = np.nan
    with pytest.raises(CloudDatasetError, match=r"true_centrelines_mm: 1 numbers are not finite"):
        CloudDataset.checked({**parts, "true_centrelines_mm": true}, {})


def test_other_numbers_have_another_hash() -> None:
    made = dataset()
    moved = made.clouds_mm.copy()
    moved[3, 1, 2, 0] += 0.01
    assert replace(made, clouds_mm=moved).sha256 != made.sha256


@pytest.mark.parametrize(
    "name", ["configurations", "starts", "clouds_mm", "centrelines_mm", "fit_error_mm", "forces"]
)
@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_one_number_that_is_not_finite_is_found_and_named(name: str, bad: float) -> None:
    broken = arrays()
    broken[name][(7, *(1,) * (broken[name].ndim - 1))] = bad
    with pytest.raises(CloudDatasetError, match=rf"{name}: 1 numbers are not finite, .* \(7,"):
        CloudDataset.checked(broken, {})


@pytest.mark.parametrize("name", [*ARRAYS, "radius_mm"])
def test_a_part_that_is_missing_is_named(name: str) -> None:
    less = arrays()
    del less[name]
    with pytest.raises(CloudDatasetError, match=f"{name} is missing"):
        CloudDataset.checked(less, {})


@pytest.mark.parametrize(
    "name", ["starts", "centrelines_mm", "fit_error_mm", "forces", "test", "block"]
)
def test_parts_that_do_not_belong_together_are_refused(name: str) -> None:
    torn = arrays()
    torn[name] = torn[name][:-1]
    with pytest.raises(CloudDatasetError, match=f"{name} is"):
        CloudDataset.checked(torn, {})


def test_what_is_nowhere_near_a_body_is_refused() -> None:
    far, long = arrays(), arrays()
    far["clouds_mm"][5, 1, 3] = [0.0, 0.0, 5000.0]
    with pytest.raises(CloudDatasetError, match=r"point at \(5, 1, 3\) is nowhere near"):
        CloudDataset.checked(far, {})
    long["centrelines_mm"][9, 0] *= 3.0
    with pytest.raises(CloudDatasetError, match="twice or half as long"):
        CloudDataset.checked(long, {})


def test_clouds_of_another_robot_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "clouds.npz"
    dataset().save(path)
    with pytest.raises(CloudDatasetError, match=r"clouds\.npz: does not fit this robot: its robot"):
        CloudDataset.load(path, load_robot(SOFT_ARM).robot)


@pytest.mark.parametrize("keep", [0.0, 0.4, 0.95])
def test_a_torn_file_is_refused(keep: float, tmp_path: Path) -> None:
    path = tmp_path / "clouds.npz"
    dataset().save(path)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(CloudDatasetError, match="no clouds"):
        CloudDataset.load(path, tendon_arm().robot)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(CloudDatasetError, match=r"none\.npz: No such file"):
        CloudDataset.load(tmp_path / "none.npz", tendon_arm().robot)


def test_points_of_a_configuration_are_those_of_all_its_starts() -> None:
    made = dataset()
    points: Any = made.points_mm(made.test)
    assert points.shape == (10, 3 * 24, 3)
    np.testing.assert_array_equal(points[1, 24:48], made.clouds_mm[6, 1])
