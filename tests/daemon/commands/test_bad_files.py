"""Files and folders that commands are given and that are no good: named with the reason, at once.

Every command with a file among its words has a row here for each of them.
"""

import json
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import (
    EXIT_CANNOT_CREATE,
    EXIT_INTERNAL,
    EXIT_INTERRUPTED,
    EXIT_NO_INPUT,
    EXIT_OK,
    MEANINGS,
)
from daemon.commands.outcome.failures import KINDS
from daemon.commands.terminal import command_line
from daemon.commands.terminal.command_line import main

SHIPPED = Path(str(files("config")))
ROBOT = SHIPPED / "robots" / "soft_arm.yaml"
TUBES = SHIPPED / "robots" / "concentric_tubes.yaml"
EXPERIMENT = SHIPPED / "experiments" / "rectangle.yaml"
SCENARIO = SHIPPED / "scenarios" / "lost_and_found.yaml"
MODEL = SHIPPED / "models" / "soft_arm.npz"
MESH = SHIPPED / "surfaces" / "chest.stl"
MIXTURE = (
    '{"weights": [1.0], "means_mm": [[0, 0, 100]],'
    ' "factors_per_mm": [[[1, 0, 0], [0, 1, 0], [0, 0, 1]]]}'
)

READ = [
    "check BAD",
    f"check {SCENARIO} --robot BAD",
    "emulate BAD",
    f"emulate {ROBOT} --scenario BAD --runtime-dir lab --duration 0.1",
    "probe BAD",
    "service --print --robot BAD",
    "plan BAD --to 0,0,190",
    "run BAD",
    "load BAD",
    "explore BAD --out data.npz",
    f"explore {ROBOT} --from BAD --out data.npz",
    "pretrain BAD data.npz --out model.npz",
    f"pretrain {ROBOT} BAD --out model.npz",
    "dashboard --port 0 --tls BAD BAD",
    "kinematics BAD --out model.npz",
    f"kinematics {TUBES} --model BAD",
    "experiment BAD --out run",
    "reproduce BAD --out study",
    "compare --study BAD --out study",
    "tune BAD --out tuned",
    "report BAD",
    "export BAD",
    "mdn collect BAD --out clouds.npz",
    f"mdn collect {ROBOT} --from BAD --out clouds.npz",
    "mdn train BAD clouds.npz --out model.npz",
    f"mdn train {ROBOT} BAD --out model.npz",
    "mdn sweep BAD clouds.npz --out nll.png",
    f"mdn sweep {ROBOT} BAD --out nll.png",
    f"mdn evaluate BAD clouds.npz --model {MODEL} --out figures",
    f"mdn evaluate {ROBOT} BAD --model {MODEL} --out figures",
    f"mdn calibrate BAD --model {MODEL} --out figures",
    f"mdn calibrate {ROBOT} --model BAD --out figures",
    f"risk query --mixture BAD --mesh {MESH}",
    "risk query --mixture mixture.json --mesh BAD",
]
"""What is read. BAD stands for the file."""

FOLDERS = [
    "recover BAD",
    "inject tracker.missing=1s --runtime-dir BAD",
    "status --runtime-dir BAD",
    "lease --runtime-dir BAD",
    "stop --runtime-dir BAD",
    "status arm --connect localhost:1 --user alice --certificates BAD",
    "stop arm --connect localhost:1 --user alice --certificates BAD",
]
"""What is to be a folder with something in it."""

WRITTEN = [
    f"explore {ROBOT} --waypoints 1 --out BAD",
    f"pretrain {ROBOT} data.npz --out BAD",
    f"kinematics {TUBES} --out BAD",
    f"experiment {EXPERIMENT} --out BAD",
    "reproduce ho2018 --out BAD",
    "compare --out BAD",
    "tune bench_tuning --out BAD",
    "environment balls --out BAD",
    f"mdn collect {ROBOT} --configurations 20 --starts 2 --out BAD",
    f"mdn train {ROBOT} data.npz --out BAD",
    f"mdn sweep {ROBOT} data.npz --out BAD",
    f"mdn calibrate {ROBOT} --model {MODEL} --out BAD",
    "certificates BAD --host arm",
    "service --write BAD",
    "man --write BAD",
    f"plan {ROBOT} --to 0,0,190 --out BAD",
    "init robot BAD",
    f"run {ROBOT} --runs BAD",
    "demo --runs BAD",
]
"""What is made. The place is below a file, where nothing can be."""


def _makes_a_file(words: str) -> bool:
    return words.startswith(("explore", "pretrain", "kinematics", "mdn collect", "mdn train"))


KIND_OF = {kind.code: kind.name for kind in KINDS}
FAILURES = set(MEANINGS) - {EXIT_OK, EXIT_INTERNAL, EXIT_INTERRUPTED}

BAD = ("missing", "folder", "binary", "empty", "unreadable", "below", "long")


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """With one of each kind; and nothing else of this machine is found."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "binary").write_bytes(bytes(range(256)) * 40)
    (tmp_path / "empty").write_bytes(b"")
    (tmp_path / "mixture.json").write_text(MIXTURE)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    yield tmp_path


def bad(kind: str, place: Path) -> Path:
    """A path of this kind."""
    return {
        "missing": place / "nothing",
        "below": place / "empty" / "below",
        "long": place / ("x" * 300),
        "unreadable": Path("/proc/self/mem"),  # for root too: its first page is nobody's
    }.get(kind, place / kind)


def told(words: str, path: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says on stderr that fails for this path. Nothing may be raised."""
    code = main([str(path) if word == "BAD" else word for word in words.split()])
    said = capsys.readouterr()
    assert code in FAILURES, said
    assert said.err.strip()
    for raw in ("Traceback", "[Errno", "Error("):
        assert raw not in said.err
    return said.err


@pytest.mark.parametrize("kind", BAD)
@pytest.mark.parametrize("words", READ)
def test_a_file_that_cannot_be_read_is_named_with_the_reason(
    words: str, kind: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bad(kind, place)
    assert str(path) in told(words, path, capsys)


@pytest.mark.parametrize("kind", ["missing", "empty", "unreadable", "below", "long"])
@pytest.mark.parametrize("words", FOLDERS)
def test_a_folder_that_is_none_is_named(
    words: str, kind: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bad(kind, place)
    assert str(path) in told(words, path, capsys)


@pytest.mark.parametrize("words", WRITTEN)
def test_a_place_that_cannot_be_written_to_is_named_before_the_work(
    words: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert str(place / "empty") in told(words, place / "empty" / "below", capsys)


@pytest.mark.parametrize("words", [words for words in WRITTEN if _makes_a_file(words)])
def test_a_folder_in_the_place_of_a_file_is_named_before_the_work(
    words: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"{place / 'folder'}: Is a directory" in told(words, place / "folder", capsys)


@pytest.mark.parametrize("words", READ + FOLDERS + WRITTEN)
def test_programs_are_told_the_same_as_one_object(
    words: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bad("missing" if words in READ + FOLDERS else "below", place)
    code = main([*(str(path) if word == "BAD" else word for word in words.split()), "--json"])
    told = json.loads(capsys.readouterr().out)
    assert (told["schema"], told["exit_code"]) == ("tentacled.error/1", code)
    error = told["error"]
    assert error["exit_code"] == code in FAILURES
    assert (code == EXIT_CANNOT_CREATE) is (words in WRITTEN)
    assert str(path if words in READ + FOLDERS else place / "empty") in error["message"]
    assert words.startswith(error["command"])
    assert error["remedy"]
    assert KIND_OF[code] == error["kind"]


def test_a_missing_recording_is_not_said_to_be_whole(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["recover", str(place / "nothing")]) == EXIT_NO_INPUT
    assert f"{place / 'nothing'}: No such file or directory" in capsys.readouterr().err
    assert main(["recover", str(place / "folder")]) == 0


@pytest.mark.parametrize("command", ["report", "export", "recover"])
def test_a_recording_that_is_not_there_is_no_unusable_one(
    command: str, place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([command, str(place / "nothing")]) == EXIT_NO_INPUT
    assert f"{place / 'nothing'}: " in capsys.readouterr().err


def test_every_command_that_takes_a_file_is_tried() -> None:
    tried = {tuple(line.split()[:2]) for line in READ + FOLDERS + WRITTEN}
    for name, parser in command_line.leaves(command_line.command_parser()):
        named = [one for one in parser._actions if "path" in str(getattr(one.type, "__name__", ""))]
        paths = [action for action in parser._actions if action.type is Path] + named
        files = [one for one in paths if "--runtime-dir" not in one.option_strings]
        is_client = any("--certificates" in one.option_strings for one in files)
        if files and not is_client:
            assert tuple(name.split()) in tried or any(words[0] == name for words in tried), name
