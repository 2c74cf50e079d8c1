"""A mixture that anyone has written down."""

import json
from pathlib import Path

import numpy as np
import pytest

from daemon.workbench.body_model.evaluation.mixture_file import read_mixture
from safety.risk.model.mixture import MixtureError

SOUND = {
    "weights": [0.25, 0.75],
    "means_mm": [[1, 2, 3], [4, 5, 6]],
    "factors_per_mm": [np.eye(3).tolist(), (0.1 * np.eye(3)).tolist()],
    "made_by": "hand",
}


def test_a_mixture_is_read_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "mixture.json"
    path.write_text(json.dumps(SOUND))
    mixture = read_mixture(path)
    assert mixture.weights.tolist() == [0.25, 0.75]
    assert mixture.means_mm.tolist() == SOUND["means_mm"]
    assert mixture.factors_per_mm[1, 2, 2] == 0.1


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"[1, 2]", "must be of this form"),
        (b"{", "Expecting property name"),
        (b"\xff\xfe\x00", "codec can't decode"),
        (json.dumps({"weights": [1]}).encode(), "means_mm is missing. It must be of this form"),
        (json.dumps(SOUND | {"weights": [0.5, 0.6]}).encode(), "together one"),
        (json.dumps(SOUND | {"weights": ["a", 0.5]}).encode(), 'weights: "a" is no number'),
        (json.dumps(SOUND | {"weights": ["0.5", 0.5]}).encode(), 'weights: "0.5" is no number'),
        (json.dumps(SOUND | {"weights": [True, 0]}).encode(), "weights: true is no number"),
        (json.dumps(SOUND | {"weights": [0.5, {"a": 1}]}).encode(), 'weights: {"a": 1} is no num'),
        (json.dumps(SOUND | {"weights": [None, 1]}).encode(), "weights: null is no number"),
        (json.dumps(SOUND | {"weights": [float("nan"), 1]}).encode(), r"at \(0,\) is not finite"),
        (json.dumps(SOUND | {"means_mm": [[1, 2, 3], [4, 5]]}).encode(), "arrays of numbers"),
        (b"[" * 100_000, "too deep to be read"),
        (b'{"weights":' * 100_000, "too deep to be read"),
        (b'{"weights":' + b"[" * 500 + b"]" * 500 + b"}", "means_mm is missing"),
        (json.dumps(SOUND).encode().replace(b"0.75", b"1" * 5000), "4300 digits"),
        (json.dumps(SOUND).encode().replace(b"0.75", b"1" * 400), "too large to convert"),
        (json.dumps(SOUND | {"means_mm": None}).encode(), "means_mm: null is no number"),
        (b"", "Expecting value"),
    ],
)
def test_what_is_no_mixture_is_told_with_the_files_name(
    content: bytes, told: str, tmp_path: Path
) -> None:
    path = tmp_path / "mixture.json"
    path.write_bytes(content)
    with pytest.raises(MixtureError, match=told) as error:
        read_mixture(path)
    assert "mixture.json: " in str(error.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(MixtureError, match=r"nothing\.json: No such file"):
        read_mixture(tmp_path / "nothing.json")
    with pytest.raises(MixtureError, match="Is a directory"):
        read_mixture(tmp_path)
