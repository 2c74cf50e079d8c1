"""Explorations on disk, and what samples can be made of them."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from daemon.learning.samples.dataset import Dataset, DatasetError, joined
from daemon.learning.samples.motion_samples import SamplingSettings
from tests.daemon.learning.frames_of_arm import (
    ARM,
    RANGES,
    ROBOT,
    another_robot,
    arm_dataset,
    arm_frames,
    without,
)

NAMES = ("t_ns", "tip_mm", "u", "line")


def test_a_file_gives_the_same_frames_and_tells_where_they_are_from(tmp_path: Path) -> None:
    dataset = arm_dataset(3)
    dataset.save(tmp_path / "data.npz")
    loaded = Dataset.load(tmp_path / "data.npz", ROBOT)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(loaded.frames, name), getattr(dataset.frames, name))
    assert loaded.provenance == dataset.provenance
    assert loaded.provenance["robot"] == "soft_arm"
    assert loaded.sha256 == dataset.sha256
    assert [path.name for path in tmp_path.iterdir()] == ["data.npz"]


def test_other_frames_have_another_hash() -> None:
    assert arm_dataset(3).sha256 != arm_dataset(3, seed=2).sha256


def test_data_of_another_robot_are_refused(tmp_path: Path) -> None:
    arm_dataset(3, robot=another_robot()).save(tmp_path / "data.npz")
    with pytest.raises(DatasetError, match=r"does not fit this robot: its travel is .*60"):
        Dataset.load(tmp_path / "data.npz", ROBOT)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 half of one"])
def test_what_is_no_exploration_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "data.npz"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="is not an exploration"):
        Dataset.load(path, ROBOT)


@pytest.mark.parametrize("missing", [*NAMES, "provenance"])
def test_an_archive_without_a_part_is_refused(tmp_path: Path, missing: str) -> None:
    arm_dataset(3).save(tmp_path / "data.npz")
    with np.load(tmp_path / "data.npz") as stored:
        arrays = {name: stored[name] for name in stored.files if name != missing}
    np.savez(tmp_path / "less.npz", **arrays)
    with pytest.raises(DatasetError, match="is not an exploration"):
        Dataset.load(tmp_path / "less.npz", ROBOT)


def test_another_kind_of_file_is_refused(tmp_path: Path) -> None:
    arm_dataset(3).save(tmp_path / "data.npz")
    with np.load(tmp_path / "data.npz") as stored:
        arrays = dict(stored.items())
    told = json.loads(str(arrays["provenance"])) | {"kind": "something else"}
    np.savez(tmp_path / "other.npz", **{**arrays, "provenance": np.array(json.dumps(told))})
    with pytest.raises(DatasetError, match="is not an exploration"):
        Dataset.load(tmp_path / "other.npz", ROBOT)


def test_each_motion_knows_the_line_it_is_from() -> None:
    dataset = arm_dataset(4)
    motions = dataset.motions(SamplingSettings(averaged_share=0.0))
    assert set(motions.line.tolist()) == {0, 1, 2, 3}
    for row in (0, len(motions) // 2, len(motions) - 1):
        frame = int(np.argmin(np.abs(dataset.frames.u - motions.u[row]).sum(axis=1)))
        assert dataset.frames.line[frame] == motions.line[row]


def test_motions_are_what_the_arm_did() -> None:
    motions = arm_dataset(4, noise_mm=0.0).motions(SamplingSettings(averaged_share=0.0))
    assert len(motions) > 100
    for sample in motions.samples()[::20]:
        moved = ARM.tip(sample.u + sample.delta_u)[0] - ARM.tip(sample.u)[0]
        np.testing.assert_allclose(sample.delta_tip_mm, moved, atol=1e-6)
    np.testing.assert_array_equal(motions.inputs[:, :3], motions.tip_mm)
    np.testing.assert_array_equal(motions.inputs[:, 9:], motions.delta_u)


def test_a_missing_piece_is_not_bridged() -> None:
    frames = without(arm_frames(2), 100, 140)
    motions = frames.motions(SamplingSettings(), RANGES.travel)
    assert np.linalg.norm(motions.delta_u, axis=1).max() < 5.0


def test_joined_explorations_keep_their_lines_and_motions_apart() -> None:
    first, second = arm_dataset(3), arm_dataset(2, seed=2)
    both = joined([first, second])
    settings = SamplingSettings()
    apart = len(first.motions(settings)) + len(second.motions(settings))
    assert len(both.motions(settings)) == apart
    assert np.unique(both.frames.line).tolist() == [0, 1, 2, 3, 4]
    assert (np.diff(both.frames.t_ns) > 0).all()
    assert [part["seed"] for part in both.provenance["parts"]] == [1, 2]


def test_frames_that_do_not_belong_together_are_refused() -> None:
    frames = arm_frames(2)
    with pytest.raises(ValueError, match="not frames of one robot"):
        replace(frames, u=frames.u[1:])
