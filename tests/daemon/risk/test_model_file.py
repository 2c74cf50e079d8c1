"""Learned models on disk: what is written is read, and nothing else is believed."""

import json
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from daemon.risk.model_file import read_model, write_model
from safety.risk.model.risk_model import RiskModelError, risk_model
from tests.safety.risk.networks import model_arrays

ABOUT = {"robot": "arm", "points_activation": "silu", "shapes_activation": "relu", "seed": 3}
U = [0.3, -1.0, 2.0, 0.5]


def test_what_was_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "arm.npz"
    write_model(path, model_arrays(), ABOUT)
    read = read_model(path)
    assert read.robot == "arm"
    assert read.about["seed"] == 3
    own = risk_model(model_arrays(), "silu", "relu")
    for one, other in ((read.model.points, own.points), (read.model.shapes, own.shapes)):
        first, second = one.mixture(U), other.mixture(U)
        assert first is not None
        assert second is not None
        np.testing.assert_array_equal(first.means_mm, second.means_mm)
    assert read.model.reach == own.reach
    assert list(tmp_path.iterdir()) == [path]


def test_what_could_not_be_read_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "arm.npz"
    arrays = model_arrays()
    del arrays["shapes/trunk.0.bias"]
    with pytest.raises(RiskModelError, match=r"shapes/trunk\.0\.bias"):
        write_model(path, arrays, ABOUT)
    with pytest.raises(RiskModelError, match="about: robot is missing"):
        write_model(path, model_arrays(), {**ABOUT, "robot": None})
    assert not list(tmp_path.iterdir())


def save(path: Path, **content: Any) -> None:
    with path.open("wb") as file:
        np.savez(file, **content)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ({}, "does not say what it is"),
        ({"about": np.array("no JSON")}, "does not say what it is"),
        ({"about": np.array("[" * 100_000)}, "does not say what it is"),
        ({"about": np.array('{"format": ' + "1" * 5000 + "}")}, "does not say what it is"),
        ({"about": np.array("[1]")}, "is not of format 1"),
        ({"about": np.array('{"format": 99}')}, "is not of format 1: train it again"),
        ({"about": np.array('{"format": 1, "robot": "arm"}')}, "points_activation is missing"),
        ({"about": np.array([{"robot": 1}], dtype=object)}, "is no model"),
    ],
)
def test_a_file_of_something_else_is_refused(
    content: dict[str, Any], told: str, tmp_path: Path
) -> None:
    path = tmp_path / "arm.npz"
    save(path, **content)
    with pytest.raises(RiskModelError, match=told) as error:
        read_model(path)
    assert str(path) in str(error.value)


@pytest.mark.parametrize(
    ("about", "told"),
    [
        ({"tip_load_g": "heavy"}, "tip_load_g must be a number of grams"),
        ({"tip_load_g": float("nan")}, "tip_load_g must be a number of grams"),
        ({"tip_load_g": [1.0]}, "tip_load_g must be a number of grams"),
        ({"configurations_sha256": 7}, "configurations_sha256 must be a list of words"),
        ({"configurations_sha256": [[]]}, "configurations_sha256 must be a list of words"),
    ],
)
def test_what_it_says_of_itself_must_make_sense(
    about: dict[str, Any], told: str, tmp_path: Path
) -> None:
    path = tmp_path / "arm.npz"
    save(path, **model_arrays(), about=np.array(json.dumps({"format": 1, **ABOUT, **about})))
    with pytest.raises(RiskModelError, match=told):
        read_model(path)


@pytest.mark.parametrize("name", ["points/trunk.0.weight", "training/reach", "shapes/input_scale"])
@pytest.mark.parametrize("kind", ["<U3", np.complex128, np.bool_])
def test_arrays_of_anything_but_numbers_are_refused(name: str, kind: Any, tmp_path: Path) -> None:
    path, arrays = tmp_path / "arm.npz", model_arrays()
    save(
        path,
        **{**arrays, name: arrays[name].astype(kind)},
        about=np.array(json.dumps({"format": 1, **ABOUT})),
    )
    with pytest.raises(RiskModelError, match=f"{name}: must be numbers"):
        read_model(path)


def test_it_says_where_and_with_what_it_was_trained(tmp_path: Path) -> None:
    path, arrays = tmp_path / "arm.npz", model_arrays()
    write_model(path, arrays, {**ABOUT, "configurations_sha256": ["ab", "cd"]})
    read = read_model(path)
    known = arrays["training/inputs"].astype(np.float64)
    a_little = 1e-5 / read.model.scale
    another = known[:1] + 0.1 / read.model.scale
    asked = np.concatenate([known[::-1], known[:1] + a_little, another])
    assert read.learnt_at(asked).tolist() == [True] * (len(known) + 1) + [False]
    assert read.learnt_from(["cd", "ef", "ab"]).tolist() == [True, False, True]


@pytest.mark.parametrize("keep", [0.0, 0.3, 0.9])
def test_a_torn_file_is_refused(keep: float, tmp_path: Path) -> None:
    path = tmp_path / "arm.npz"
    write_model(path, model_arrays(), ABOUT)
    content = path.read_bytes()
    path.write_bytes(content[: int(keep * len(content))])
    with pytest.raises(RiskModelError, match="is no model"):
        read_model(path)


def test_a_changed_byte_is_noticed(tmp_path: Path) -> None:
    path = tmp_path / "arm.npz"
    write_model(path, model_arrays(), ABOUT)
    content = bytearray(path.read_bytes())
    with ZipFile(path) as archive:
        largest = max(archive.infolist(), key=lambda part: part.compress_size)
    content[largest.header_offset + largest.compress_size // 2] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(RiskModelError):
        read_model(path)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(RiskModelError, match=r"none\.npz: No such file"):
        read_model(tmp_path / "none.npz")
