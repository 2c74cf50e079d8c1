"""The report shows what was recorded, stands alone, and makes do with what there is."""

import asyncio
import base64
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec
import pytest
from matplotlib.figure import Figure

from config.control import PoseFilterSettings
from config.loader import load_robot
from daemon.commands.outcome.exit_codes import EXIT_DATA, EXIT_FAILED, EXIT_NO_INPUT, EXIT_OK
from daemon.commands.terminal.command_line import main
from daemon.messages import Event, InternalError, Message, Risk, Status, Tip
from daemon.recording.format.channels import TOPICS, telemetry_payload
from daemon.recording.result import CycleError, Result, read_result, write_result
from daemon.recording.run_folder import describe_run
from daemon.recording.run_writer import RunWriter
from daemon.workbench.report.report import report_html, smoothed_cycles, write_report
from daemon.workbench.report.report_data import _COLUMNS, read_run
from daemon.workbench.report.report_series import risk_figure, timing_figure
from tests import SOFT_ARM
from tests.daemon.recording.synthetic_run import (
    WALL_NS,
    direct_run,
    make_parts,
    make_run,
    messages,
)

pytestmark = pytest.mark.xdist_group("report")  # whose page is made once for all tests

CYCLE_S = 4.0


def page_of(folder: Path, keep: Callable[[Message], bool] = lambda message: True) -> str:
    """The report of a run of which only some messages were recorded."""
    kept = [message for message in messages(2, CYCLE_S) if keep(message)]
    asyncio.run(direct_run(folder, kept))
    return write_report(folder).read_text()


def titles(page: str) -> list[str]:
    return re.findall(r"<h2>(.*?)</h2>", page)


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


@pytest.mark.usefixtures("undrawn")
def test_in_virtual_time_there_is_no_date_and_no_timing(whole: Path, tmp_path: Path) -> None:
    run = read_run(whole)
    virtual = replace(run, header={**run.header, "time": "virtual time"})
    assert timing_figure(run) is not None
    assert timing_figure(virtual) is None
    for data, dated in ((run, True), (virtual, False)):
        page = report_html(data)
        assert ("2020-01-01" in page) is dated
        assert ("bus cycles missed" in page) is dated
        assert ("virtual time" in page) is not dated


def test_no_model_of_the_risk_is_drawn_as_that(whole: Path) -> None:
    run = read_run(whole)
    assert run.risk_sources == ("mixture",)
    assert "no model" not in words_of(risk_figure(run))
    without = replace(run, risk_sources=("no model",))
    assert "no model" in words_of(risk_figure(without))
    assert without.risk is not None
    lines = [line for axes in figure_of(risk_figure(without)).axes for line in axes.lines]
    assert all("threshold" not in str(line.get_label()) for line in lines)


def test_what_a_stand_in_says_of_the_risk_is_no_figure() -> None:
    said = Risk(
        sequence=1,
        t_ns=0,
        source="no model",
        contact_risk=0.0,
        threshold=0.05,
        scale=1.0,
        reasons=[],
    )
    contact = _COLUMNS[Risk]["contact"]
    assert contact.of(said) is None
    assert contact.of(msgspec.structs.replace(said, source="soft_arm.npz")) == (0.0,)


def figure_of(made: Figure | None) -> Figure:
    assert made is not None
    return made


def words_of(made: Figure | None) -> str:
    return " ".join(text.get_text() for axes in figure_of(made).axes for text in axes.texts)


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


def error_rows(page: str) -> list[tuple[int, int, float]]:
    """Cycle, samples and mean error in mm, of one table after the other."""
    cell = r'<td class="number">([\d.]+)</td>'
    rows = re.findall(rf"<tr>{cell}{cell}{cell}", page)
    return [(int(cycle), int(samples), float(mean)) for cycle, samples, mean in rows]


def test_the_error_tables_have_a_row_for_each_cycle(page: str) -> None:
    """What the loop saw, then the same smoothed: the emulated tip of this run was not recorded."""
    rows = error_rows(page)
    assert [cycle for cycle, _, _ in rows] == [1, 2, 1, 2]
    assert all(samples > 50 for _, samples, _ in rows)
    assert "The same of the smoothed tip" in page
    for seen, smoothed in zip(rows[:2], rows[2:], strict=True):
        assert smoothed[2] == pytest.approx(seen[2], abs=0.15)


@pytest.mark.usefixtures("undrawn")
def test_where_the_true_tip_is_known_nothing_is_smoothed(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result = read_result(whole)
    assert result is not None
    row = CycleError(cycle=0, samples=99, mean_mm=0.125, std_mm=0.1, max_mm=0.5)
    run = read_run(whole)
    run.result = msgspec.structs.replace(result, true_cycles=[row])
    monkeypatch.setitem(sys.modules, "filterpy.kalman", None)
    page = report_html(run)
    assert error_rows(page)[2:] == [(1, 99, 0.125)]
    assert "The same of the true tip" in page


def test_what_was_not_believed_is_not_smoothed(whole: Path) -> None:
    """Wild readings change nothing as long as the loop has not believed them either."""
    run = read_run(whole)
    assert run.tip is not None
    before = smoothed_cycles(run.tip, PoseFilterSettings())
    wild = slice(100, 300, 20)
    run.tip["measured_mm"][wild] += 1000.0
    assert max(row.max_mm for row in smoothed_cycles(run.tip, PoseFilterSettings())) > 100.0
    run.tip["believed"][wild] = 0.0
    after = smoothed_cycles(run.tip, PoseFilterSettings())
    assert [row.mean_mm for row in after] == pytest.approx(
        [row.mean_mm for row in before], abs=0.05
    )
    assert sum(row.samples for row in before) > sum(row.samples for row in after)


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


@pytest.mark.usefixtures("undrawn")
def test_an_unfinished_recording_is_shown_as_such(tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=CYCLE_S)
    content = (tmp_path / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").unlink()
    (tmp_path / "run.mcap.part").write_bytes(content[: len(content) - 5])
    page = write_report(tmp_path).read_text()
    assert "was not ended properly" in page
    assert "run.mcap.part" in page


@pytest.mark.usefixtures("undrawn")
def test_a_run_whose_recorder_was_started_again_is_shown_whole_with_its_gap(
    tmp_path: Path,
) -> None:
    recorded = make_parts(tmp_path, slice(600, 700))
    run = read_run(tmp_path)
    assert run.counts["/tip"] == sum(isinstance(each, Tip) for each in recorded)
    page = write_report(tmp_path).read_text()
    assert "run.mcap.part, run-2.mcap" in page
    assert (
        "what happened from 4.9 to 5.7 s, between run.mcap.part and run-2.mcap, was not recorded"
    ) in page
    assert "This is one of several" not in page
    alone = write_report(tmp_path / "run-2.mcap").read_text()
    assert "This is one of several recordings of its run" in alone
    assert "was not recorded" not in alone


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
    assert main(["report", str(whole / "run.mcap"), "--out", str(out)]) == EXIT_OK
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
    assert main(["report", str(tmp_path)]) == EXIT_DATA
    assert told in capsys.readouterr().err


def test_a_missing_run_and_an_unwritable_place_are_refused_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["report", str(tmp_path / "nothing")]) == EXIT_NO_INPUT
    assert "there is no such file or folder" in capsys.readouterr().err
    asyncio.run(direct_run(tmp_path, list(messages(1, 1.0))[-3:]))
    out = tmp_path / "no" / "report.html"
    assert main(["report", str(tmp_path), "--out", str(out)]) == EXIT_NO_INPUT
    assert "No such file or directory" in capsys.readouterr().err


def test_the_recover_command_makes_a_run_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = make_run(tmp_path, cycles=1, cycle_s=CYCLE_S)
    (tmp_path / "run.mcap.part").write_bytes(path.read_bytes()[:-5])
    path.unlink()
    assert main(["recover", str(tmp_path)]) == EXIT_OK
    assert "messages saved" in capsys.readouterr().out
    assert path.exists()
    assert main(["recover", str(tmp_path)]) == EXIT_OK
    assert "no unfinished recording" in capsys.readouterr().out
    damaged = bytearray(path.read_bytes())
    damaged[40:48] = bytes(8)
    (tmp_path / "run.mcap.part").write_bytes(damaged)
    assert main(["recover", str(tmp_path)]) == EXIT_FAILED
    heard = capsys.readouterr()
    assert "messages saved; " in (told := heard.out), heard.err
    assert "kept as run.mcap.damaged" in told
    assert (tmp_path / "run.mcap.damaged").read_bytes() == damaged
    (tmp_path / "run.mcap.part").write_bytes(b"not a recording")
    assert main(["recover", str(tmp_path)]) == EXIT_FAILED
    assert "left as it is" in capsys.readouterr().out


def test_errors_of_the_daemons_own_are_listed_with_their_tracebacks(tmp_path: Path) -> None:
    error = InternalError(
        t_ns=2_000_000_000,
        place="daemon.loop.control_step:77",
        text="control step",
        traceback="Traceback (most recent call last):\n  a <line>\nZeroDivisionError: ours",
        kept_back=3,
    )
    writer = RunWriter(tmp_path / "run.mcap", {"robot": "soft_arm"}, 0)
    writer.write(TOPICS[InternalError], error.t_ns, telemetry_payload(error))
    writer.finish()
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert "Internal errors" in page
    assert "daemon.loop.control_step:77: control step (and 3 times more before)" in page
    assert "a &lt;line&gt;\nZeroDivisionError: ours" in page
