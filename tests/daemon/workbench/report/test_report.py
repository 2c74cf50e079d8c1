"""The report shows what was recorded, stands alone, and makes do with what there is."""

import argparse
import asyncio
import base64
import re
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from config.loader import load_robot
from daemon.commands import recover, report
from daemon.commands.terminal.command_line import EXIT_FAILED, EXIT_OK
from daemon.messages import Event, Message, Risk, Status, Tip
from daemon.recording.result import Result, write_result
from daemon.recording.run_folder import describe_run
from daemon.recording.run_writer import RunWriter
from daemon.workbench.report.report import write_report
from tests import SOFT_ARM
from tests.daemon.recording.synthetic_run import WALL_NS, direct_run, make_run, messages

CYCLE_S = 4.0


def page_of(folder: Path, keep: Callable[[Message], bool] = lambda message: True) -> str:
    """The report of a run of which only some messages were recorded."""
    kept = [message for message in messages(2, CYCLE_S) if keep(message)]
    asyncio.run(direct_run(folder, kept))
    return write_report(folder).read_text()


def titles(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


def command(module: object, *words: str) -> int:
    parser = argparse.ArgumentParser()
    module.add_arguments(parser)  # type: ignore[attr-defined]
    return int(module.run(parser.parse_args(words)))  # type: ignore[attr-defined]


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with everything that a run can have."""
    folder = tmp_path_factory.mktemp("run")
    make_run(folder, cycles=2, cycle_s=CYCLE_S)
    describe_run(folder, load_robot(SOFT_ARM).robot, SOFT_ARM, WALL_NS, seed=3)
    result = Result(
        robot="soft_arm",
        simulated=True,
        trajectory="circle <of 30 mm>",
        controller="online",
        seed=3,
        duration_s=2 * CYCLE_S,
        cycles=[],
        steps=321,
        holds=1,
        refusals=12,
    )
    write_result(folder, result)
    return folder


@pytest.fixture(scope="module")
def page(whole: Path) -> str:
    """Its report."""
    return write_report(whole).read_text()


def test_a_whole_run_has_every_table_and_figure(page: str) -> None:
    assert titles(page) == [
        "Tip error by cycle",
        "Path of the tip",
        "Close-up",
        "Error over time",
        "Actuators",
        "Forces",
        "Risk and permission",
        "The body and what is near",
        "Timing",
        "Events",
        "Provenance",
    ]
    assert "soft_arm: circle &lt;of 30 mm&gt;" in page
    assert "SIMULATED" in page
    assert "ended in ARMED" in page
    assert "2020-01-01 00:00:00 UTC" in page
    assert "the tracker has lost the tip" in page
    assert 'class="notice"' not in page
    assert "<b>321</b>" in page


def test_a_report_needs_nothing_from_outside(page: str) -> None:
    figures = re.findall(r'src="data:image/svg\+xml;base64,([^"]+)"', page)
    assert len(figures) == 8
    rest = re.sub(r'src="data:[^"]+"', "", page)
    assert not re.findall(r"(?:src|href)\s*=|url\(|@import|<script|https?://", rest)
    for figure in figures:
        svg = base64.b64decode(figure).decode()
        loaded = re.findall(r'(?:xlink:)?href="(?!#|data:)[^"]*"', svg)
        assert loaded == []


def test_the_same_run_gives_the_same_report(whole: Path, page: str, tmp_path: Path) -> None:
    assert write_report(whole, tmp_path / "again.html").read_text() == page


def test_the_error_table_has_a_row_for_each_cycle(page: str) -> None:
    rows = re.findall(r'<tr><td class="number">(\d+)</td><td class="number">(\d+)</td>', page)
    assert [int(cycle) for cycle, _ in rows] == [1, 2]
    assert all(int(samples) > 50 for _, samples in rows)


def test_a_run_without_a_tip_still_has_a_report(tmp_path: Path) -> None:
    page = page_of(tmp_path, lambda message: not isinstance(message, Tip))
    assert "Not in this recording: tip." in page
    assert "No cycle was followed." in page
    assert {"Actuators", "Forces", "Risk and permission"} <= set(titles(page))
    assert "Path of the tip" not in titles(page)


def test_without_a_model_of_the_body_none_is_drawn(tmp_path: Path) -> None:
    kept = [
        message
        if not isinstance(message, Risk)
        else msgspec.structs.replace(message, clearance_mm=None, means_mm=None)
        for message in messages(2, CYCLE_S)
    ]
    asyncio.run(direct_run(tmp_path, kept))
    shown = titles(write_report(tmp_path).read_text())
    assert "Risk and permission" in shown
    assert "The body and what is near" not in shown


def test_a_run_that_was_never_armed_still_has_a_report(tmp_path: Path) -> None:
    page = page_of(tmp_path, lambda message: isinstance(message, Status))
    assert "Not in this recording: tip, axes, risk, loop." in page
    assert "Nothing was told." in page


def test_a_recording_of_one_event_still_has_a_report(tmp_path: Path) -> None:
    first = True

    def only_one(message: Message) -> bool:
        nonlocal first
        wanted, first = first and isinstance(message, Event), first and type(message) is not Event
        return wanted

    page = page_of(tmp_path, only_one)
    assert "follows the reference" in page


def test_text_from_the_robot_is_only_text(tmp_path: Path) -> None:
    event = next(message for message in messages(1, 2.0) if isinstance(message, Event))
    bad = "<script>alert(1)</script>"
    changed = Event(
        sequence=1,
        t_ns=event.t_ns,
        kind="note",
        name=bad,
        subject=bad,
        present=True,
        text=bad,
        detail=bad,
    )
    asyncio.run(direct_run(tmp_path, [changed]))
    assert "<script" not in write_report(tmp_path).read_text()


def test_an_unfinished_recording_is_shown_as_such(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=CYCLE_S)
    content = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").unlink()
    (tmp_path / "run.mcap.part").write_bytes(content[: len(content) - 5])
    page = write_report(tmp_path).read_text()
    assert "was not ended properly" in page
    assert "run.mcap.part" in page


def test_damaged_messages_are_counted_and_left_out(tmp_path: Path) -> None:
    writer = RunWriter(tmp_path / "run.mcap", {"robot": "soft_arm"}, 0)
    writer.write("/tip", 1, b"{")
    writer.write("/event", 2, b'{"type":"event/1"}')
    writer.finish()
    assert "2 parts of the recording could not be read" in write_report(tmp_path).read_text()


def test_the_command_says_where_the_report_is(
    whole: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "elsewhere.html"
    assert command(report, str(whole / "run.mcap"), "--out", str(out)) == EXIT_OK
    assert capsys.readouterr().out == f"{out}\n"
    assert out.read_text().startswith("<!DOCTYPE html>")


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("run.mcap", b"this is no recording at all", "is not a recording"),
        ("run.mcap", b"", "there is no message in it"),
        ("other.txt", b"", "there is no run.mcap in this folder"),
    ],
)
def test_what_is_no_recording_is_refused_with_a_reason(
    name: str, content: bytes, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / name).write_bytes(content)
    assert command(report, str(tmp_path)) == EXIT_FAILED
    assert told in capsys.readouterr().err


def test_a_missing_run_and_an_unwritable_place_are_refused_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(report, str(tmp_path / "nothing")) == EXIT_FAILED
    assert "there is no such file or folder" in capsys.readouterr().err
    asyncio.run(direct_run(tmp_path, list(messages(1, 1.0))[-3:]))
    out = tmp_path / "no" / "report.html"
    assert command(report, str(tmp_path), "--out", str(out)) == EXIT_FAILED
    assert "No such file or directory" in capsys.readouterr().err


def test_the_recover_command_makes_a_run_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = make_run(tmp_path, cycles=1, cycle_s=CYCLE_S)
    (tmp_path / "run.mcap.part").write_bytes(path.read_bytes()[:-5])
    path.unlink()
    assert command(recover, str(tmp_path)) == EXIT_OK
    assert "messages saved" in capsys.readouterr().out
    assert path.exists()
    assert command(recover, str(tmp_path)) == EXIT_OK
    assert "no unfinished recording" in capsys.readouterr().out
    damaged = bytearray(path.read_bytes())
    damaged[40:48] = bytes(8)
    (tmp_path / "run.mcap.part").write_bytes(damaged)
    assert command(recover, str(tmp_path)) == EXIT_FAILED
    assert "2066 messages saved; " in (told := capsys.readouterr().out)
    assert "kept as run.mcap.damaged" in told
    assert (tmp_path / "run.mcap.damaged").read_bytes() == damaged
    (tmp_path / "run.mcap.part").write_bytes(b"not a recording")
    assert command(recover, str(tmp_path)) == EXIT_FAILED
    assert "left as it is" in capsys.readouterr().out
