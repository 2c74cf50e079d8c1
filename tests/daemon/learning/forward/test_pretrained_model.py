"""Forward models on disk: the same to the last bit, and only for their own robot."""

import json
from pathlib import Path

import numpy as np
import pytest

from daemon.array_files import ModelError
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
from tests.daemon.learning.frames_of_arm import ROBOT, another_robot, arm_dataset


@pytest.fixture(scope="module")
def model() -> PretrainedModel:
    dataset = arm_dataset(10)
    return PretrainedModel.of(pretrain(dataset, PretrainingSettings(epochs=2)), dataset)


@pytest.fixture
def path(model: PretrainedModel, tmp_path: Path) -> Path:
    model.save(tmp_path / "model.npz")
    return tmp_path / "model.npz"


def test_a_file_gives_the_same_model_to_the_last_bit(model: PretrainedModel, path: Path) -> None:
    loaded = PretrainedModel.load(path, ROBOT)
    for x in model.motions.inputs[::30]:
        np.testing.assert_array_equal(loaded.lwpr.predict(x), model.lwpr.predict(x))
    for name, array in model.motions.to_arrays().items():
        np.testing.assert_array_equal(loaded.motions.to_arrays()[name], array)
    assert loaded.sampling == model.sampling
    assert loaded.fields.count == model.lwpr.count


def test_it_learns_on_as_if_it_had_never_been_in_a_file(path: Path) -> None:
    one, other = (PretrainedModel.load(path, ROBOT) for _ in range(2))
    other.save(path)
    again = PretrainedModel.load(path, ROBOT)
    motions = one.motions
    for x, y in zip(motions.inputs[:50], motions.delta_tip_mm[:50], strict=True):
        np.testing.assert_array_equal(one.lwpr.update(x, y), again.lwpr.update(x, y))


def test_it_tells_where_it_came_from(model: PretrainedModel, path: Path) -> None:
    told = PretrainedModel.load(path, ROBOT).metadata
    assert told == model.metadata
    assert told["robot"] == "soft_arm"
    assert told["data_sha256"] == arm_dataset(10).sha256
    assert told["fields"] == model.lwpr.count
    assert len(told["errors"]) == 2
    json.dumps(told, allow_nan=False)


def test_a_model_learnt_without_a_test_has_no_test_error(tmp_path: Path) -> None:
    dataset = arm_dataset(6)
    learnt = pretrain(dataset, PretrainingSettings(epochs=1, test_share=0.0))
    PretrainedModel.of(learnt, dataset).save(tmp_path / "model.npz")
    told = PretrainedModel.load(tmp_path / "model.npz", ROBOT).metadata
    assert told["errors"][0]["test_mm"] is None


def test_another_robot_refuses_it(path: Path) -> None:
    with pytest.raises(ModelError, match="does not fit this robot: its travel"):
        PretrainedModel.load(path, another_robot())
    renamed = ROBOT.model_copy(update={"robot": "other_arm"})
    with pytest.raises(ModelError, match="its robot is 'soft_arm', not 'other_arm'"):
        PretrainedModel.load(path, renamed)


@pytest.mark.parametrize("content", [b"", b"no archive", b"PK\x03\x04 half of one"])
def test_what_is_no_model_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "model.npz").write_bytes(content)
    with pytest.raises(ModelError, match="is not a forward model"):
        PretrainedModel.load(tmp_path / "model.npz", ROBOT)


def test_a_damaged_file_is_refused(path: Path) -> None:
    content = path.read_bytes()
    for end in (len(content) // 3, len(content) - 200):
        path.write_bytes(content[:end])
        with pytest.raises(ModelError):
            PretrainedModel.load(path, ROBOT)


def test_a_file_without_a_part_is_refused(path: Path) -> None:
    with np.load(path) as stored:
        arrays = dict(stored.items())
    for missing in ("metadata", "motions/u", "lwpr/set0/centres"):
        if missing not in arrays:
            missing = next(name for name in arrays if name.startswith("lwpr/"))
        np.savez(path, **{name: array for name, array in arrays.items() if name != missing})
        with pytest.raises(ModelError, match="is not a forward model"):
            PretrainedModel.load(path, ROBOT)


def test_numbers_that_are_not_finite_are_refused(path: Path) -> None:
    with np.load(path) as stored:
        arrays = dict(stored.items())
    arrays["motions/u"] = np.full_like(arrays["motions/u"], np.nan)
    np.savez(path, **arrays)
    with pytest.raises(ModelError, match="not finite"):
        PretrainedModel.load(path, ROBOT)
