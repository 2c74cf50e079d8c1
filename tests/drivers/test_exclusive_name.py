"""A name has one holder on the machine, who is named, and the kernel frees it whatever happens."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.exclusive_name import (
    ExclusiveName,
    NameTakenError,
    OtherName,
    holder_of,
    is_taken,
)

_HOLDS = """
import sys
from drivers.exclusive_name import ExclusiveName
held = ExclusiveName(sys.argv[1])
print("held", flush=True)
sys.stdin.read()
"""

MAIN = "daemon.commands.terminal.command_line"


@contextmanager
def another_process(name: str) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLDS, name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        cwd=Path(__file__).parents[2],
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.wait()
        process.stdin.close()
        process.stdout.close()


@pytest.fixture
def name(tmp_path: Path) -> str:
    return f"test {tmp_path} {'long' * 100}"


def test_a_name_has_one_holder_until_it_is_released(name: str) -> None:
    assert not is_taken(name)
    assert holder_of(name) is None
    one = ExclusiveName(name)
    other = ExclusiveName(f"{name}!")
    assert is_taken(name)
    with pytest.raises(NameTakenError, match="is taken by this very process"):
        ExclusiveName(name)
    one.release()
    one.release()
    assert not is_taken(name)
    assert holder_of(name) is None
    other.release()


def test_the_holder_is_named_with_its_command(name: str) -> None:
    with another_process(name) as process:
        with pytest.raises(NameTakenError) as taken:
            ExclusiveName(name)
        assert taken.value.holder is not None
        assert taken.value.holder.pid == process.pid
        assert taken.value.holder.command.startswith(sys.executable)
        assert f"process {process.pid} ({sys.executable} -c " in str(taken.value)


def test_a_killed_holder_has_nothing_any_more(name: str) -> None:
    with another_process(name) as process:
        assert is_taken(name)
        process.send_signal(signal.SIGKILL)
        process.wait()
        ExclusiveName(name).release()


def test_a_child_that_outlives_its_parent_does_not_keep_the_name(name: str) -> None:
    held = ExclusiveName(name)
    with subprocess.Popen(["sleep", "60"]) as child:
        held.release()
        assert not is_taken(name)
        child.kill()


def test_our_own_commands_are_told_as_an_operator_types_them(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    processes = tmp_path / "proc"
    (processes / str(os.getpid())).mkdir(parents=True)
    monkeypatch.setattr("drivers.exclusive_name._PROCESSES", processes)
    line = processes / str(os.getpid()) / "cmdline"
    held = ExclusiveName(name)
    for words, told in (
        (
            "/v/bin/python\0-m\0daemon.commands.terminal.command_line\0run\0robot.yaml\0",
            "tentacled run robot.yaml",
        ),
        ("/v/bin/python3\0/v/bin/tentacled\0probe\0r.yaml\0", "tentacled probe r.yaml"),
        ("python\0-c\0pass\0", "python -c pass"),
        ("x" * 500, "x" * 120 + " ..."),
    ):
        line.write_text(words)
        found = holder_of(name)
        assert found is not None
        assert found.command == told
    line.unlink()
    found = holder_of(name)
    assert found is not None
    assert found.command == ""
    held.release()


def test_a_thing_with_several_names_has_one_holder(name: str) -> None:
    thing, first, second = name, f"{name} first", f"{name} second"
    said = [OtherName(one, thing) for one in (first, second)]
    with pytest.raises(NameTakenError):
        OtherName(first, thing)
    held = ExclusiveName(first)
    for one in (thing, first, second):
        assert is_taken(one)
        with pytest.raises(NameTakenError, match="is taken by this very process"):
            ExclusiveName(one)
    assert not is_taken(f"{name} third")
    held.release()
    assert not is_taken(second)
    for saying in said:
        saying.release()
    ExclusiveName(first).release()


def test_who_has_a_name_is_said_also_of_what_it_stood_for_before(name: str) -> None:
    said = OtherName(f"{name} door", name)
    with another_process(f"{name} door") as process:
        said.release()
        found = holder_of(name)
        assert found is not None
        assert found.pid == process.pid
