"""A mistyped word: what is said of a command, an option, a choice and a file that do not exist."""

import json
import shutil
from importlib.resources import files
from pathlib import Path
from typing import NoReturn

import pytest

from daemon.commands.outcome.exit_codes import (
    EXIT_CONFIGURATION,
    EXIT_INTERRUPTED,
    EXIT_UNAVAILABLE,
    EXIT_USAGE,
)
from daemon.commands.terminal import command_line
from daemon.commands.terminal.command_line import main

SHIPPED = Path(str(files("config")))
USAGE = EXIT_USAGE


def refused(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The last line that wrong usage gets."""
    with pytest.raises(SystemExit) as ended:
        main(words.split())
    assert ended.value.code == USAGE
    return capsys.readouterr().err.splitlines()[-1]


def said(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    """What a command says that fails."""
    assert main(words.split()) == EXIT_CONFIGURATION
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("experment x.yaml", "there is no command 'experment' (did you mean 'experiment'?)"),
        ("statsu", "there is no command 'statsu' (did you mean 'status'?)"),
        ("mdn colect arm.yaml", "there is no 'colect' (did you mean 'collect'?)"),
        ("emulate arm.yaml --play swya", "there is no 'swya' (did you mean 'sway'?)"),
        ("run arm.yaml --runtme-dir x", "--runtme-dir (did you mean '--runtime-dir'?)"),
        ("run arm.yaml --runtme-dir=x", "--runtme-dir=x (did you mean '--runtime-dir'?)"),
        (
            "mdn collect arm.yaml --out x --strts 3",
            "mdn collect: error: unknown: --strts (did you mean '--starts'?), 3",
        ),
        ("experiment a.yaml --uot x", "required: --out; unknown: --uot (did you mean '--out'?)"),
        ("stop --jsn", "--jsn (did you mean '--json'?)"),
    ],
)
def test_what_was_meant_is_said(words: str, meant: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert meant in refused(words, capsys)


def test_nothing_is_guessed_for_a_word_that_is_like_no_other(
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = refused("xyzzy", capsys)
    assert "there is no command 'xyzzy'; `tentacled --help` lists them" in line
    assert "did you mean" not in refused("stop --xyzzy", capsys)


def test_a_short_list_of_choices_is_told_where_nothing_is_like_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    line = refused("risk query --mixture a --mesh b --free xyzzy", capsys)
    assert "there is no 'xyzzy': there are inside, outside" in line


def test_who_says_nothing_sees_all_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == USAGE
    told = capsys.readouterr().err
    assert all(f"\n    {name}" in told for name in command_line.COMMANDS)


def test_an_option_may_be_shortened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "nothing.yaml: No such file" in said(f"probe {tmp_path}/nothing.yaml --dur 1", capsys)


@pytest.mark.parametrize(
    ("command", "kind", "name", "mistyped"),
    [
        ("check", "robots", "soft_arm", "soft_arn"),
        ("emulate", "robots", "tendon_arm", "tendonarm"),
        ("run", "robots", "soft_arm", "soft-arm"),
        ("probe", "robots", "soft_arm", "sift_arm"),
        ("load", "experiments", "rectangle", "rectangel"),
        ("check", "experiments", "chest_circle", "chest_cricle"),
    ],
)
def test_the_file_beside_the_mistyped_one_is_named(
    command: str,
    kind: str,
    name: str,
    mistyped: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shutil.copy(SHIPPED / kind / f"{name}.yaml", tmp_path / f"{name}.yaml")
    told = said(f"{command} {tmp_path}/{mistyped}.yaml", capsys)
    assert f"(did you mean '{tmp_path}/{name}.yaml'?)" in told


def test_a_shipped_file_is_named_where_nothing_beside_is_like_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shipped = SHIPPED / "robots" / "soft_arm.yaml"
    assert f"soft_arm: No such file or directory (did you mean '{shipped}'?)" in said(
        "emulate soft_arm", capsys
    )
    assert f"{SHIPPED}/studies/ho2018.yaml'?)" in said("reproduce ho2081 --out x", capsys)
    monkeypatch.chdir(SHIPPED.parent)
    assert "(did you mean 'config/robots/soft_arm.yaml'?)" in said("emulate soft_arm", capsys)


def test_a_mistyped_robot_within_an_experiment_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (SHIPPED / "experiments" / "rectangle.yaml").read_text()
    told = {}
    for robot in ("builtin:soft_arn", "soft_arn.yaml"):
        (tmp_path / "soft_arm.yaml").write_text("")
        lines = [f"robot: {robot}" if "robot:" in line[:6] else line for line in text.splitlines()]
        (tmp_path / "round.yaml").write_text("\n".join(lines))
        told[robot] = said(f"check {tmp_path}/round.yaml", capsys)
    assert "(did you mean 'builtin:soft_arm'?)" in told["builtin:soft_arn"]
    assert f"(did you mean '{tmp_path}/soft_arm.yaml'?)" in told["soft_arn.yaml"]


PARTS = {
    "mdn": ("collect", "train", "sweep", "evaluate", "calibrate"),
    "risk": ("query",),
}


@pytest.mark.parametrize(
    "words",
    [
        words
        for name in command_line.COMMANDS
        for words in ([name], *([name, part] for part in PARTS.get(name, ())))
    ],
    ids=" ".join,
)
def test_the_help_of_a_command_fits_into_80_columns(
    words: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit) as ended:
        main([*words, "--help"])
    assert ended.value.code == 0
    shown = capsys.readouterr().out.splitlines()
    assert shown[0].startswith(f"usage: tentacled {' '.join(words)}")
    assert max(map(len, shown)) <= 80


@pytest.mark.parametrize("number", ["-1", "many"])
@pytest.mark.parametrize(
    "words",
    [
        "experiment builtin:rectangle --out made",
        "emulate builtin:soft_arm",
        "run builtin:soft_arm",
        "tune bench_tuning --out made",
    ],
)
def test_what_is_no_seed_is_refused_before_anything_begins(
    words: str, number: str, capsys: pytest.CaptureFixture[str]
) -> None:
    line = refused(f"{words} --seed {number}", capsys)
    assert line.endswith(f"argument --seed: '{number}' is no seed: 0, 1, 2, ...")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("dashboard --port 99999", "'99999' is no whole number from 0 to 65535"),
        ("bridge openigtlink --port -1", "'-1' is no whole number from 0 to 65535"),
        ("bridge ros2 --router localhost", "'localhost' is no endpoint such as tcp/localhost:7447"),
        ("probe builtin:soft_arm --duration -1", "'-1' is no time from 0 to 604800 s"),
        ("probe builtin:soft_arm --every nan", "'nan' is no time from 0 to 604800 s"),
        ("emulate builtin:soft_arm --duration nan", "'nan' is no time from 0 to 604800 s"),
    ],
)
def test_a_number_that_an_option_cannot_have_is_refused_before_anything_begins(
    words: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(words, capsys).endswith(said)


def test_no_certificate_is_made_for_whoever_uses_the_unix_socket(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "keys"
    assert main(["certificates", str(folder), "--operator", "local"]) == EXIT_USAGE
    assert "'local' is whoever uses the unix socket" in capsys.readouterr().err
    assert not folder.exists()


@pytest.mark.parametrize("as_json", [False, True])
def test_who_interrupts_a_command_as_it_is_imported_sees_no_traceback(
    as_json: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(words: object) -> NoReturn:
        raise KeyboardInterrupt

    monkeypatch.setattr(command_line, "parsed", interrupted)
    assert main(["run", "arm.yaml", *(["--json"] if as_json else [])]) == EXIT_INTERRUPTED
    told = capsys.readouterr()
    if as_json:
        assert json.loads(told.out)["error"]["command"] == "run"
    else:
        assert told.err.strip() == "interrupted"


def test_all_faults_are_listed_without_a_lab(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert main(["inject", "--list"]) == 0
    listed = capsys.readouterr().out
    assert {"tracker", "drive.BUS/NODE", "bus.BUS"} < set(listed.splitlines())
    assert ".power_cycle" in listed
    assert main(["inject", "tracker.missing", "--list"]) == EXIT_UNAVAILABLE


def test_a_folder_is_not_checked_as_if_it_were_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["check", str(tmp_path)]) == EXIT_USAGE
    assert f"{tmp_path}: is a folder: name a file in it" in capsys.readouterr().err


@pytest.mark.parametrize("cycle", ["0", "-1", "nan", "inf", "soon"])
def test_a_tour_goes_round_in_a_time_that_there_is(
    cycle: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert f"'{cycle}' is no time from 1 to" in refused(f"demo --cycle={cycle}", capsys)


def test_experiments_and_controllers_that_a_study_does_not_have_are_told_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for word, other in (("experiments", "broyden"), ("controllers", "ho2018_table1_online")):
        assert main(["compare", "--out", str(tmp_path / "out"), f"--{word}", "nope"]) == USAGE
        said = capsys.readouterr().err
        assert f"there is no nope among the study's {word}: there are " in said
        assert other not in said
