"""`tentacled environment` and `tentacled risk query`, as they are called."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daemon.commands.outcome.exit_codes import EXIT_DATA, EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.risk.mesh_file import read_environment
from safety.risk.body_point import BodyPointRisk
from tests.safety.risk.scenes import mixture_of


def made(*words: str, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    assert main(["environment", *words]) == EXIT_OK
    told: dict[str, Any] = json.loads(capsys.readouterr().out)
    return told


@pytest.mark.parametrize(
    ("words", "triangles", "free"),
    [
        (["chest", "--triangles", "601", "--seed", "3"], 602, "inside"),
        (["room", "--triangles", "12"], 12, "inside"),
        (["box", "--triangles", "110"], 108, "outside"),
        (["balls", "--triangles", "300", "--balls", "3"], 300, "outside"),
        (["slot", "--triangles", "100", "--gap-mm", "12"], 96, "outside"),
    ],
)
def test_every_kind_of_surroundings_is_made_and_can_be_read(
    words: list[str],
    triangles: int,
    free: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = tmp_path / "mesh.stl"
    told = made(*words, "--out", str(path), capsys=capsys)
    assert (told["triangles"], told["free"]) == (triangles, free)
    assert (told["insertion_port"] is not None) == (words[0] == "chest")
    read = read_environment(path)
    assert len(read.triangles) == triangles
    assert read.solid_around == (free == "inside")


def test_a_seed_is_a_mesh(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    files = []
    for number, seed in enumerate(("4", "4", "5")):
        path = tmp_path / f"{number}.stl"
        made("chest", "--triangles", "200", "--seed", seed, "--out", str(path), capsys=capsys)
        files.append(path.read_bytes())
    assert files[0] == files[1] != files[2]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["box", "--size-mm", "1", "1", "1"], "1 mm large"),
        (["box", "--size-mm", "1e9", "1e9", "1e9"], "1e+09 mm large"),
    ],
)
def test_requests_that_cannot_be_met_leave_no_file(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "mesh.stl"
    assert main(["environment", *words, "--out", str(path)]) == EXIT_FAILED
    assert told in capsys.readouterr().err
    assert not path.exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["chest", "--triangles", "4"], "'4' is no whole number from 12 to 300000"),
        (["chest", "--triangles", "99999999"], "no whole number from 12 to 300000"),
        (["balls", "--balls", "40"], "'40' is no whole number from 1 to 12"),
        (["slot", "--gap-mm", "-1"], "must be positive"),
        (["box", "--size-mm", "nan", "1", "1"], "must be positive"),
        (["room", "--centre-mm", "inf", "0", "0"], "--centre-mm takes three numbers"),
    ],
)
def test_numbers_that_no_surroundings_have_are_wrong_usage(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: object = main(["environment", *words, "--out", str(tmp_path / "mesh.stl")])
    except SystemExit as left:  # argparse's own way
        code = left.code
    assert code == EXIT_USAGE
    assert told in capsys.readouterr().err


@pytest.fixture
def room(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """Of twelve triangles, 200 × 160 × 120 mm about the origin."""
    path = tmp_path / "room.stl"
    size = ("--size-mm", "200", "160", "120", "--centre-mm", "0", "0", "0")
    made("room", "--triangles", "12", *size, "--out", str(path), capsys=capsys)
    return path


def written(path: Path, means_mm: list[list[float]], sigmas_mm: list[list[float]]) -> Path:
    mixture = mixture_of([1.0 / len(means_mm)] * len(means_mm), means_mm, sigmas_mm)
    content = {
        "weights": mixture.weights.tolist(),
        "means_mm": mixture.means_mm.tolist(),
        "factors_per_mm": mixture.factors_per_mm.tolist(),
    }
    path.write_text(json.dumps(content))
    return path


def asked(
    mixture: Path, mesh: Path, *words: str, capsys: pytest.CaptureFixture[str]
) -> tuple[dict[str, Any], str]:
    query = ["risk", "query", "--mixture", str(mixture), "--mesh", str(mesh), *words]
    assert main(query) == EXIT_OK
    captured = capsys.readouterr()

    def no_constant(text: str) -> float:
        raise AssertionError(f"{text} is no JSON")

    told: dict[str, Any] = json.loads(captured.out, parse_constant=no_constant)
    return told, captured.err


def test_a_query_prints_both_bounds_and_the_value(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixture = written(tmp_path / "m.json", [[80.0, 0, 0], [0, 0, 0]], [[12.0] * 3, [4.0] * 3])
    told, said = asked(mixture, room, capsys=capsys)
    risk = BodyPointRisk(read_environment(room))
    own = mixture_of([0.5, 0.5], [[80.0, 0, 0], [0, 0, 0]], [[12.0] * 3, [4.0] * 3])
    bounds = risk.bounds(own)
    assert told["printed_bound"] == pytest.approx(bounds.printed, rel=1e-9)
    assert told["certified_bound"] == pytest.approx(bounds.certified, rel=1e-9)
    assert told["near_exact"] == pytest.approx(0.5 * 0.04779, rel=1e-3)
    assert told["near_exact"] <= told["certified_bound"] <= told["printed_bound"]
    assert (told["free"], told["triangles"]) == ("inside", 12)
    near, far = told["components"]
    np.testing.assert_allclose(near["nearest_mm"], [100.0, 0.0, 0.0], atol=1e-5)
    assert far["nearest_mm"] == [None, None, None]
    assert said == ""


def test_a_mesh_that_seems_to_be_the_wrong_way_round_is_hinted_at(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixture = written(tmp_path / "m.json", [[80.0, 0, 0]], [[12.0] * 3])
    told, said = asked(mixture, room, "--free", "outside", capsys=capsys)
    assert told["printed_bound"] == 1.0
    assert told["components"][0]["mean_in_solid"]
    assert told["near_exact"] == pytest.approx(1.0 - 0.04779, rel=1e-3)
    assert "say --free inside" in said


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("{}", "m.json: weights is missing"),
        (
            '{"weights": [1], "means_mm": [[1, 2]], "factors_per_mm": [[[1, 0], [0, 1]]]}',
            "m.json: means have 3 coordinates",
        ),
    ],
)
def test_a_mixture_that_cannot_be_used_is_named(
    content: str, told: str, room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.json"
    path.write_text(content)
    query = ["risk", "query", "--mixture", str(path), "--mesh", str(room)]
    assert main(query) == EXIT_DATA
    assert told in capsys.readouterr().err


def test_a_mesh_that_cannot_be_used_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mixture = written(tmp_path / "m.json", [[0.0, 0, 0]], [[1.0] * 3])
    query = ["risk", "query", "--mixture", str(mixture), "--mesh", str(tmp_path / "no.stl")]
    assert main(query) == EXIT_DATA
    assert "no.stl: No such file" in capsys.readouterr().err
