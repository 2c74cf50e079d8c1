"""`--json`, of every command there is: one object with schema and version, and nothing else."""

import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.documents.problems import ConfigError, Problem
from daemon.commands.outcome import exit_codes, failures
from daemon.commands.outcome.exit_codes import (
    EXIT_CONFIGURATION,
    EXIT_INTERNAL,
    EXIT_INTERRUPTED,
    EXIT_IO,
    EXIT_OK,
    EXIT_USAGE,
    MEANINGS,
)
from daemon.commands.outcome.failures import KINDS, CommandError, UsageError, failure_of
from daemon.commands.outcome.result import Result, only_json_on_stdout, plain, program_version, tell
from daemon.commands.terminal import command_line
from daemon.commands.terminal.command_line import command_parser, leaves, main
from daemon.messages import Arm
from tests.daemon.commands import test_bad_files

LEAVES = dict(leaves(command_parser()))

WORKS = {
    "check": "check builtin:soft_arm",
    "doctor": "doctor",
    "plugins": "plugins",
    "schema": "schema",
    "init": "init robot mine",
    "service": "service --print",
    "certificates": "certificates keys --operator alice",
    "environment": "environment box --out box.stl --triangles 12",
    "recover": "recover .",
    "completion": "completion bash",
    "man": "man",
}
"""What comes to a good end in an empty folder."""

NEEDS_A_DAEMON = (
    *("status", "lease", "arm", "home", "start", "teleoperate", "hold", "resume", "stop"),
    *("disarm", "clear", "inject", "surroundings", "replan"),
)
"""What fails in an empty folder, and is tried with a daemon in tests/daemon/remote, tests/hil."""
MUST_BE_SAID = {"replan": "--to 1,2,3"}


def told(words: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    """Exit code and the one object."""
    try:
        code = main([*words.split(), "--json"])
    except SystemExit as ended:  # as argparse does
        code = int(ended.code or 0)
    out = capfd.readouterr().out
    assert out.count("\n") == 1, out
    content: dict[str, Any] = json.loads(out)
    assert content["version"] == program_version()
    assert content["exit_code"] == code
    return code, content


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """With nothing in it; and no daemon of this machine is found."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "runtime"))
    yield


@pytest.mark.parametrize("name", LEAVES)
def test_every_command_takes_it_and_returns_what_it_found_out(name: str) -> None:
    assert "--json" in LEAVES[name]._option_string_actions
    first = name.split()[0]
    module = command_line._command(first)
    assert inspect.signature(module.run).return_annotation in (Result, "Result")


@pytest.mark.parametrize("name", LEAVES)
def test_wrong_usage_of_every_command_is_told(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    code, content = told(f"{name} --no-such-option", capfd)
    assert code == EXIT_USAGE
    assert content["schema"] == "tentacled.error/1"
    error = content["error"]
    assert (error["command"], error["kind"], error["exit_code"]) == (name, "usage", EXIT_USAGE)
    assert error["message"] and error["remedy"]


@pytest.mark.parametrize("name", WORKS)
def test_what_a_command_found_out_is_told(name: str, capfd: pytest.CaptureFixture[str]) -> None:
    code, content = told(WORKS[name], capfd)
    assert code == EXIT_OK
    assert content["schema"] == f"tentacled.{name}/1"
    assert content["result"]


@pytest.mark.parametrize("name", NEEDS_A_DAEMON)
def test_without_a_daemon_every_client_says_so(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    code, content = told(f"{name} {MUST_BE_SAID.get(name, '')}".strip(), capfd)
    assert code == exit_codes.EXIT_UNAVAILABLE
    assert content["error"]["kind"] == "unavailable"
    assert content["error"]["command"] == name


def test_each_command_is_tried() -> None:
    """Here, with a daemon, or with a bad file among its words. Bridges wait for a daemon, and are
    tried in tests/daemon/bridges."""
    lines = [*test_bad_files.READ, *test_bad_files.FOLDERS, *test_bad_files.WRITTEN]
    for name in LEAVES:
        tried = name in (*WORKS, *NEEDS_A_DAEMON) or name.startswith("bridge ")
        assert tried or any(line.startswith(name) for line in lines), name


def test_wrong_words_before_any_command_are_told(capfd: pytest.CaptureFixture[str]) -> None:
    code, content = told("statsu", capfd)
    assert code == EXIT_USAGE
    assert "did you mean 'status'" in content["error"]["message"]


def test_versions_are_told_for_who_reports_a_defect(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version", "--json"])
    assert ended.value.code == EXIT_OK
    result = json.loads(capfd.readouterr().out)["result"]
    assert result["tentacled"] == program_version()
    assert result["packages"]["eclipse-zenoh"]


@pytest.mark.parametrize("error", [error for kind in KINDS for error in kind.errors])
def test_the_errors_of_the_table_are_there(error: str) -> None:
    module, _, name = error.rpartition(".")
    assert issubclass(getattr(import_module(module), name), BaseException)


def test_every_exit_code_has_one_meaning_and_one_kind() -> None:
    codes = {value for name, value in vars(exit_codes).items() if name.startswith("EXIT_")}
    assert codes == set(MEANINGS)
    assert {kind.code for kind in KINDS} == codes - {EXIT_OK}
    assert len({kind.name for kind in KINDS}) == len(KINDS) == len(codes) - 1


def test_the_table_is_shown_by_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    shown = capsys.readouterr().out
    for code, meaning in MEANINGS.items():
        assert re.search(rf"(?m)^ +{code}  {re.escape(meaning)}$", shown)


def test_the_nearest_class_decides_and_the_systems_own_words_are_kept() -> None:
    failure = failure_of(FileNotFoundError(2, "No such file or directory", "x.npz"))
    assert failure is not None
    assert (failure.kind.name, failure.place) == ("no_input", "x.npz")
    assert failure.message == "x.npz: No such file or directory"
    unnamed = failure_of(PermissionError(13, "Permission denied"))
    assert unnamed is not None and unnamed.kind.name == "input_output"
    assert failure_of(TimeoutError()) is None
    assert failure_of(ZeroDivisionError()) is None
    problem = Problem("arm.yaml", 3, 5, "axes", "unknown key")
    wrong = failure_of(ConfigError([problem]))
    assert wrong is not None
    assert (wrong.place, wrong.kind.code) == ("arm.yaml:3:5", EXIT_CONFIGURATION)
    assert plain(wrong.details)["problems"][0]["key_path"] == "axes"
    own = failure_of(CommandError("failed", "no", place="p", remedy="do that"))
    assert own is not None
    assert own.as_json("x")["remedy"] == "do that"
    assert own.text == "no\ndo that"
    assert isinstance(UsageError("x"), CommandError)


def ending_with(error: BaseException, monkeypatch: pytest.MonkeyPatch) -> None:
    class Ends:
        @staticmethod
        def add_arguments(parser: object) -> None: ...

        @staticmethod
        def run(arguments: object) -> Result:
            raise error

    monkeypatch.setattr(command_line, "_command", lambda _: Ends)


def test_an_error_of_our_own_and_an_interruption_have_their_codes(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    ending_with(ZeroDivisionError("oh"), monkeypatch)
    code, content = told("doctor", capfd)
    assert (code, content["error"]["message"]) == (EXIT_INTERNAL, "ZeroDivisionError: oh")
    assert main(["doctor"]) == EXIT_INTERNAL
    assert "Traceback" in capfd.readouterr().err
    ending_with(KeyboardInterrupt(), monkeypatch)
    code, content = told("doctor", capfd)
    assert (code, content["error"]["kind"]) == (EXIT_INTERRUPTED, "interrupted")


def test_what_is_printed_meanwhile_goes_to_standard_error(
    capfd: pytest.CaptureFixture[str],
) -> None:
    program = (
        "import os, subprocess, sys\n"
        "from daemon.commands.outcome.result import only_json_on_stdout, tell\n"
        "with only_json_on_stdout():\n"
        "    print('python', flush=True)\n"
        "    os.write(1, b'library\\n')\n"
        "    subprocess.run(['echo', 'child'])\n"
        "    tell('x', {'a': 1}, 'text')\n"
        "print('after')\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    line, after, end = done.stdout.split("\n")
    assert json.loads(line)["result"] == {"a": 1}
    assert (after, end) == ("after", "")
    assert set(done.stderr.split()) == {"python", "library", "child"}


def test_what_goes_on_is_told_line_by_line(capsys: pytest.CaptureFixture[str]) -> None:
    tell("x", {"a": 1}, "text")
    assert capsys.readouterr().out == "text\n"
    with only_json_on_stdout():
        tell("x", {"a": 1}, "text")
        tell("x", {"a": 2})
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line["result"]["a"] for line in lines] == [1, 2]


def test_values_of_all_kinds_are_told_as_json_has_them() -> None:
    value = {
        "array": np.array([[1.0, np.nan], [np.inf, 2.0]]),
        "number": np.float64(3.0),
        "path": Path("a/b"),
        "message": Arm(despite_contact=True),
        "problem": Problem("f", 1, 2, "k", "m"),
        1: (True, None),
    }
    assert plain(value) == {
        "array": [[1.0, None], [None, 2.0]],
        "number": 3.0,
        "path": "a/b",
        "message": {"type": "arm/1", "request": "", "token": "", "despite_contact": True},
        "problem": {"file": "f", "line": 1, "column": 2, "key_path": "k", "message": "m"},
        "1": [True, None],
    }


COMMAND_LINE = (sys.executable, "-m", "daemon.commands.terminal.command_line")


@pytest.mark.parametrize("words", ["schema --json", "plugins"])
def test_a_reader_that_leaves_is_no_failure(words: str) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    command = [*COMMAND_LINE, *words.split()]
    done = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, text=True)
    os.close(writing)
    assert (done.returncode, done.stderr) == (EXIT_OK, "")


def test_what_cannot_be_written_as_json_is_told_on_standard_error() -> None:
    with Path("/dev/full").open("w") as full:
        command = [*COMMAND_LINE, "schema", "--json"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True)
    assert (done.returncode, done.stderr) == (EXIT_IO, "No space left on device\n")


def test_who_was_given_no_standard_streams_reads_nothing_and_writes_to_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in ("stdin", "stdout", "stderr"):
        monkeypatch.setattr(sys, name, None)
    assert main(["plugins"]) == EXIT_OK
    with sys.stdin, sys.stdout, sys.stderr:
        assert not sys.stderr.isatty()
        assert not sys.stdout.isatty()
        assert sys.stdin.read() == ""


def test_kinds_can_be_asked_for_by_name_only() -> None:
    with pytest.raises(KeyError):
        CommandError("nothing", "x")
    assert failures.KINDS
