"""Arrays on disk: what was written is read, and what is damaged is refused in words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.loader import load_robot
from config.robot import Robot
from daemon.array_files import ArrayFile, ModelError, misfit_of, read_as, whose
from daemon.controllers.model_files import (
    LearntFile,
    load_learnt,
    load_model,
    model_metadata,
    save_learnt,
    save_model,
)
from daemon.learning.samples.dataset import Dataset, DatasetError
from tests import SHIPPED_ROBOTS
from tests.daemon.learning.frames_of_arm import ROBOT, arm_dataset

ABOUT = {"kind": "something/1", "of": ["a", 1.5, None]}
ARRAYS = {"a": np.arange(6.0).reshape(2, 3), "b": np.array([True]), "deep/c": np.zeros(0, np.int64)}
WHOSE = model_metadata("broyden", ROBOT)
SHAPES = {"jacobian": (3, 6)}


@pytest.mark.parametrize("text", ["metadata", "provenance"])
def test_what_was_written_is_read(text: str, tmp_path: Path) -> None:
    path = tmp_path / "file.npz"
    ArrayFile(ABOUT, ARRAYS).save(path, text)
    read = ArrayFile.load(path, None, text)
    assert read.about == ABOUT
    assert read.arrays.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert read.arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(read.arrays[name], array)
    assert "kind" not in ArrayFile.load(path, "something/1", text).about


def test_another_kind_is_refused_with_both_names(tmp_path: Path) -> None:
    path = tmp_path / "file.npz"
    ArrayFile(ABOUT, ARRAYS).save(path)
    told = r"file\.npz is not a thing: ValueError: its kind is 'something/1', not 'another/1'"
    with pytest.raises(ModelError, match=told), read_as(path, "a thing"):
        ArrayFile.load(path, "another/1")


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "file.npz"
    ArrayFile(ABOUT, ARRAYS).save(path)
    with pytest.raises(OSError, match="more than 100 bytes"), read_as(path, "a thing"):
        ArrayFile.load(path, most_bytes=100)


def _fixed(path: Path) -> None:
    save_model(path, WHOSE, {"jacobian": np.ones((3, 6))})


def _learnt(path: Path) -> None:
    save_learnt(path, LearntFile("reward_weighted", None, {"x": np.ones((20, 3))}), ROBOT)


_CASES: list[tuple[Callable[[Path], None], Callable[[Path], Any], type[Exception]]] = [
    (_fixed, lambda path: load_model(path, WHOSE, SHAPES), ModelError),
    (_learnt, lambda path: load_learnt(path, "reward_weighted", ROBOT), ModelError),
    (lambda path: arm_dataset(3).save(path), lambda path: Dataset.load(path, ROBOT), DatasetError),
]


@pytest.mark.parametrize(("save", "load", "refused"), _CASES, ids=["fixed", "learnt", "dataset"])
def test_whatever_is_damaged_is_refused_in_words(
    save: Callable[[Path], None],
    load: Callable[[Path], Any],
    refused: type[Exception],
    tmp_path: Path,
) -> None:
    """One bit anywhere: what zip, zlib, numpy and JSON say of it is never passed on as it is."""
    path = tmp_path / "file.npz"
    save(path)
    whole = path.read_bytes()
    refusals = 0
    for place in np.random.default_rng(1).permutation(len(whole))[:300].tolist():
        damaged = bytearray(whole)
        damaged[place] ^= 1 << place % 8
        path.write_bytes(damaged)
        try:
            load(path)
        except (refused, OSError) as error:
            refusals += 1
            assert str(path) in str(error) or isinstance(error, OSError)
    assert refusals > 100


@pytest.mark.parametrize("content", [b"", b"{}", b"\x93NUMPY\x01\x00"])
def test_what_is_no_archive_is_not_taken_for_pickled_data_to_be_trusted(
    tmp_path: Path, content: bytes
) -> None:
    path = tmp_path / "model.npz"
    path.write_bytes(content)
    told = r"model\.npz is not a model: .* no NumPy archive"
    with pytest.raises(ModelError, match=told), read_as(path, "a model"):
        ArrayFile.load(path, None, "about")


def test_whose_it_is_are_name_axes_and_travel() -> None:
    told = whose(ROBOT)
    assert misfit_of(told, ROBOT) == ""
    assert misfit_of({**told, "axes": told["axes"][:-1]}, ROBOT).startswith("its axes is [")
    assert misfit_of({}, ROBOT) == f"its robot is None, not '{ROBOT.robot}'"


def with_bore(bore_mm: float) -> Robot:
    axes = [axis.model_copy(update={"bore_mm": bore_mm}) for axis in ROBOT.axes]
    return ROBOT.model_copy(update={"axes": axes})


def test_what_was_learnt_with_other_pistons_is_another_body_s(tmp_path: Path) -> None:
    """As far as the same travel goes, they push more gas. Older files do not say with which."""
    path, wider = tmp_path / "broyden.npz", with_bore(30.0)
    save_model(path, WHOSE, {"jacobian": np.zeros((3, 6))})
    load_model(path, WHOSE, SHAPES)
    with pytest.raises(ModelError, match="its piston_area_mm2 is"):
        load_model(path, model_metadata("broyden", wider), SHAPES)
    assert misfit_of(whose(ROBOT), wider).startswith("its piston_area_mm2 is")
    older = {name: one for name, one in whose(ROBOT).items() if name != "piston_area_mm2"}
    assert misfit_of(older, ROBOT) == ""


def test_what_was_learnt_with_another_transmission_is_not_taken_for_the_same_way(
    tmp_path: Path,
) -> None:
    """As where a lead, a gear or a direction in the robot file was wrong, and is put right."""
    path, first = tmp_path / "broyden.npz", ROBOT.axes[0]
    save_model(path, WHOSE, {"jacobian": np.zeros((3, 6))})
    turned = {"drive": first.drive.model_copy(update={"inverted": not first.drive.inverted})}
    for change in ({"lead_mm": 4.0}, {"gear_ratio": 2.0}, turned):
        axes = [first.model_copy(update=change), *ROBOT.axes[1:]]
        other = ROBOT.model_copy(update={"axes": axes})
        with pytest.raises(ModelError, match="its counts_per_unit is"):
            load_model(path, model_metadata("broyden", other), SHAPES)
    older = {name: one for name, one in whose(ROBOT).items() if name != "counts_per_unit"}
    assert misfit_of(older, ROBOT) == ""


def test_shipped_models_say_whose_they_are() -> None:
    for file in SHIPPED_ROBOTS.glob("*_arm.yaml"):
        path = SHIPPED_ROBOTS.parent / "models" / f"{file.stem}.npz"
        about = ArrayFile.load(path, None, "about").about
        robot = load_robot(file).robot
        assert misfit_of(about, robot) == ""
        assert whose(robot).keys() - {"counts_per_unit"} <= about.keys()
