"""`builtin:NAME` wherever a command asks for a file, from any folder."""

from pathlib import Path

import pytest

from daemon.commands.terminal.command_line import main, parsed
from daemon.robot.shipped_files import FOLDERS, shipped_files

ROBOT_COMMANDS = ("emulate", "probe", "run", "check")


@pytest.mark.parametrize(
    "name", [name for folder in FOLDERS for name in shipped_files(folder)], ids=str
)
def test_every_shipped_file_is_sound_by_its_name_from_an_empty_folder(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, told = main(["check", name]), capsys.readouterr()
    assert (code, told.err) == (0, "")
    assert "is sound" in told.out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "words",
    [
        *([command, "builtin:soft_arm"] for command in ROBOT_COMMANDS),
        ["explore", "builtin:soft_arm", "--out", "data.npz"],
        ["mdn", "collect", "builtin:soft_arm", "--out", "clouds.npz"],
        ["pretrain", "builtin:soft_arm", "data.npz", "--out", "model.npz"],
        ["experiment", "builtin:rectangle", "--out", "run"],
        ["load", "builtin:rectangle"],
        ["emulate", "builtin:soft_arm", "--scenario", "builtin:lost_and_found"],
        ["service", "--print", "--robot", "builtin:soft_arm"],
    ],
    ids=" ".join,
)
def test_it_is_understood_by_every_command(words: list[str]) -> None:
    values = vars(parsed(words)).values()
    each = [one for value in values for one in (value if isinstance(value, list) else [value])]
    paths = [one for one in each if isinstance(one, Path)]
    assert any(path.is_absolute() and path.is_file() for path in paths)


@pytest.mark.parametrize(
    "words",
    [
        ["mdn", "calibrate", "builtin:soft_arm", "--out", "found"],
        ["mdn", "evaluate", "builtin:soft_arm", "clouds.npz", "--out", "found"],
        ["plan", "builtin:soft_arm", "--to", "0,0,100"],
        ["kinematics", "builtin:concentric_tubes"],
    ],
    ids=" ".join,
)
def test_so_is_a_shipped_model(words: list[str]) -> None:
    assert parsed([*words, "--model", "builtin:soft_arm.npz"]).model.is_file()
    assert parsed([*words, "--model", "builtin:soft_arm"]).model.is_file()
    assert parsed([*words, "--model", "own.npz"]).model == Path("own.npz")


def test_what_is_meant_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="64"):
        main(["experiment", "builtin:rectangel", "--out", "run"])
    assert "no builtin:rectangel (did you mean 'builtin:rectangle'?)" in capsys.readouterr().err


def test_they_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["run", "--list"])
    assert capsys.readouterr().out.split() == list(shipped_files("robots"))
    with pytest.raises(SystemExit, match="0"):
        main(["check", "--list"])
    listed = capsys.readouterr().out.split()
    assert len(listed) == len(set(listed)) == sum(len(shipped_files(one)) for one in FOLDERS)
