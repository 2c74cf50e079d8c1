"""`tentacled plan` as it is called, and the file that it writes."""

import json
from pathlib import Path
from typing import Any

import pytest

from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION, EXIT_FAILED, EXIT_OK, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.reference.planned_path import PlannedPathError, read_path
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation import shapes
from tests import SHIPPED_ROBOTS

TENDONS = str(SHIPPED_ROBOTS / "tendon_arm.yaml")


@pytest.fixture
def wall(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[str, ...]:
    """At +x, far enough away to bend towards it a little."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    path = tmp_path / "wall.stl"
    write_mesh(path, shapes.box((20.0, 160.0, 160.0), (94.0, 0.0, 170.0), 3))
    return ("--surroundings", str(path), "--free", "outside", "--no-port")


def planned(*words: str) -> int:
    return main(["plan", TENDONS, *words, "--waypoints", "8"])


def test_a_path_is_told_and_written(
    wall: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "path.json"
    goal = ("--to", "-29.5,15,194.6")
    assert planned(*goal, *wall, "--out", str(out), "--json") == EXIT_OK
    figures: dict[str, Any] = json.loads(capsys.readouterr().out)["result"]
    assert figures["contact_risk_upper_limit"] <= 0.05
    assert figures["method"] == "optimised"
    path = read_path(out)
    assert path.robot == "tendon_arm"
    assert path.u[0] == (0.0, 0.0, 0.0, 0.0)
    assert path.t_s[-1] == pytest.approx(figures["duration_s"], abs=1e-5)
    assert path.tip_mm[-1] == pytest.approx((-29.5, 15.0, 194.6), abs=1.01)
    assert path.direction is None
    assert path.figures["seed"] == 1


def test_in_words_every_number_says_what_it_is(
    wall: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert planned("--to", "30,0,194.6", *wall, "--pareto") == EXIT_OK
    told = capsys.readouterr().out
    for words in ("contact risk of the whole path", "upper limit", "not a chance of touching"):
        assert words in told


def test_the_papers_method_is_told_as_what_it_is(
    wall: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    assert planned("--to", "30,0,194.6", *wall, "--preset", "thompson", "--json") == EXIT_OK
    figures = json.loads(capsys.readouterr().out)["result"]
    course = figures["body_point_risk_eq_10_course"]
    assert figures["method"] == "thompson"
    assert len(course) == 51
    assert course[-1] <= course[0]


def test_where_there_is_none_the_reason_is_told_and_nothing_is_written(
    wall: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "path.json"
    assert planned("--to", "88,0,166", *wall, "--out", str(out), "--json") == EXIT_FAILED
    assert json.loads(capsys.readouterr().out)["result"]["none"] == "goal_in_solid"
    assert not out.exists()


def test_a_mesh_that_is_named_stands_where_its_file_has_it(
    wall: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Where the robot file puts its own mesh, and how it turns it, says nothing of another one."""
    own = "    mesh: builtin:chest.stl"
    text = Path(TENDONS).read_text().replace(own, f"{own}\n    at_mm: [0.0, 0.0, 500.0]\n   ")
    robot = tmp_path / "robot.yaml"
    robot.write_text(text)
    assert main(["plan", str(robot), "--to", "88,0,166", *wall, "--json"]) == EXIT_FAILED
    assert json.loads(capsys.readouterr().out)["result"]["none"] == "goal_in_solid"


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("--to", "1,2"), EXIT_USAGE, "'1,2' is not 3 numbers"),
        (("--to", "1,2,nan"), EXIT_USAGE, "is not finite"),
        (("--to", "0,0,190", "--pointing", "0,0,0"), EXIT_USAGE, "is no direction"),
        (("--to", "0,0,190", "--port", "1,2,3"), EXIT_USAGE, "needs eight numbers"),
        (("--to", "0,0,190", "--most-risk", "0"), EXIT_USAGE, "is a probability"),
        (("--to", "0,0,190", "--samples", "3"), EXIT_USAGE, "100 to 100000"),
        (("--to", "0,0,190", "--from", "1,2"), EXIT_USAGE, "there are 4 axes"),
        (("--to", "0,0,190", "--model", "no.npz"), EXIT_CONFIGURATION, "no.npz"),
        (("--to", "0,0,190", "--surroundings", "no.stl"), EXIT_CONFIGURATION, "no.stl"),
    ],
)
def test_what_cannot_be_asked_is_explained(
    words: tuple[str, ...], code: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        found = planned(*words)
    except SystemExit as ended:
        found = int(str(ended.code))
    assert found == code
    assert told in capsys.readouterr().err


def test_a_robot_without_model_says_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(["plan", str(SHIPPED_ROBOTS / "soft_arm.yaml"), "--to", "0,0,190"])
        == EXIT_CONFIGURATION
    )
    assert "risk.model: builtin:soft_arm.npz is shipped" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"t_s": [0.0, 0.0]}, "must rise from 0"),
        ({"u": [[0.0, 0.0]]}, "u has 1 rows"),
        ({"u": [[0.0], [1.0]]}, "there are 2 axes"),
        ({"tip_mm": [[0.0, 0.0, 1.0], [0.0, 1e9, 1.0]]}, "tip_mm"),
        ({"model_sha256": "abc"}, "model_sha256"),
        ({"tentacled_path": 2}, "tentacled_path"),
        ({"strange": 1}, "unknown key"),
        ({"direction": [[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]}, "a vector that is not zero"),
    ],
)
def test_a_damaged_path_file_is_refused_with_the_key(
    change: dict[str, Any], told: str, tmp_path: Path
) -> None:
    content: dict[str, Any] = {
        "tentacled_path": 1,
        "robot": "tendon_arm",
        "axes": ["a", "b"],
        "model_sha256": "0" * 64,
        "surroundings_sha256": "0" * 64,
        "t_s": [0.0, 1.0],
        "u": [[0.0, 0.0], [1.0, 1.0]],
        "tip_mm": [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]],
    }
    path = tmp_path / "path.json"
    path.write_text(json.dumps(content))
    assert read_path(path).u[1] == (1.0, 1.0)
    path.write_text(json.dumps({**content, **change}))
    with pytest.raises(PlannedPathError, match=told):
        read_path(path)


def test_what_is_no_path_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "path.json"
    for content in (b"", b"[1]", b"\xff\x00", b'{"t_s": [NaN]}'):
        path.write_bytes(content)
        with pytest.raises(PlannedPathError, match=r"path\.json"):
            read_path(path)
    with pytest.raises(PlannedPathError, match="No such file"):
        read_path(tmp_path / "none.json")


def test_what_a_robot_file_does_not_name_is_told_and_the_model_that_is_shipped_for_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    soft = ["plan", str(SHIPPED_ROBOTS / "soft_arm.yaml"), "--to", "0,0,180"]
    assert main(soft) == EXIT_CONFIGURATION
    told = capsys.readouterr().err
    assert "risk.model: builtin:soft_arm.npz is shipped" in told
    assert "risk.surface" in told
    assert main([*soft, "--model", "builtin:soft_arm.npz"]) == EXIT_CONFIGURATION
    told = capsys.readouterr().err
    assert "risk.model" not in told
    assert "risk.surface" in told
