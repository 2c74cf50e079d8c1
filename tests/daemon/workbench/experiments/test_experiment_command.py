"""`tentacled experiment` as it is typed: what it leaves, and that it leaves no process."""

import os
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_CANNOT_CREATE, EXIT_OK
from daemon.commands.terminal.command_line import main
from daemon.recording.result import read_result
from daemon.recording.run_parts import control_hash
from daemon.workbench.report.report import write_report
from tests import SOFT_ARM

WITHIN_S = 120.0

CIRCLE = """
experiment: circle
robot: builtin:soft_arm
trajectory: {{kind: circle, center_mm: [0, 0, 185], radius_mm: 8, cycle_s: {cycle_s}}}
controller: {{kind: constant_curvature}}
"""


def words(folder: Path, cycle_s: float = 3.0) -> list[str]:
    path = folder / "circle.yaml"
    path.write_text(CIRCLE.format(cycle_s=cycle_s))
    return ["experiment", str(path), "--out", str(folder / "run")]


def command(folder: Path, cycle_s: float = 3.0) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "daemon.commands.terminal.command_line", *words(folder, cycle_s)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def without_progress(complaints: str) -> list[str]:
    """A machine that is slow enough gets to see how far it is."""
    told = ("circle: ", "compiling kernels", "drawing the report", "getting ready")
    return [line for line in complaints.splitlines() if not line.startswith(told)]


def child_of(process: "subprocess.Popen[str]") -> int:
    """A descriptor of the only process that this one has started."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    wait_until(process, lambda: children.read_text() != "")
    return os.pidfd_open(int(children.read_text().split()[0]))


def wait_until(process: "subprocess.Popen[str]", seen: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WITHIN_S
    while not seen():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)


def has_ended(watched: int) -> bool:
    return bool(select.select([watched], [], [], WITHIN_S)[0])


def test_the_command_leaves_tables_files_and_no_process(tmp_path: Path) -> None:
    process = command(tmp_path)
    beside = child_of(process)
    said, complaints = process.communicate(timeout=WITHIN_S)
    assert (process.returncode, without_progress(complaints)) == (EXIT_OK, [])
    assert has_ended(beside)
    os.close(beside)
    run = tmp_path / "run"
    assert said.splitlines()[-1] == str(run / "report.html")
    assert {path.name for path in run.iterdir()} == {
        "run.mcap",
        "robot.yaml",
        "provenance.json",
        "result.json",
        "steps.npz",
        "report.html",
    }
    result = read_result(run)
    assert result is not None
    assert result.control_sha256 == control_hash(run / "run.mcap")
    assert (result.virtual_time, result.timing) == (True, None)
    assert '"started": "virtual time"' in (run / "provenance.json").read_text()
    page = re.sub(
        r"data:image[^\"]*|<style>.*?</style>", "", (run / "report.html").read_text(), flags=re.S
    )
    assert "virtual time" in page
    assert "2020" not in page
    assert " ms<" not in page
    assert "<h2>Timing</h2>" not in page
    again = write_report(run, tmp_path / "again.html")
    assert again.read_text() == (run / "report.html").read_text()


def test_without_a_report_the_result_is_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words(tmp_path), "--no-report"]) == EXIT_OK
    told = capsys.readouterr()
    assert without_progress(told.err) == []
    run = tmp_path / "run"
    assert not (run / "report.html").exists()
    assert "report" not in told.out
    result = read_result(run)
    assert result is not None
    assert result.control_sha256 == control_hash(run / "run.mcap")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_an_end_before_its_time_leaves_no_process(tmp_path: Path, number: signal.Signals) -> None:
    process = command(tmp_path, cycle_s=5000.0)
    beside = child_of(process)
    wait_until(process, (tmp_path / "run" / "run.mcap.part").exists)
    process.send_signal(number)
    assert has_ended(beside)
    os.close(beside)
    process.communicate(timeout=WITHIN_S)
    assert process.returncode != EXIT_OK


def test_a_folder_that_is_there_is_not_written_to(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "run").mkdir()
    assert main(words(tmp_path)) == EXIT_CANNOT_CREATE
    assert "is there already" in capsys.readouterr().err
    assert list((tmp_path / "run").iterdir()) == []


def test_noise_that_the_robot_s_filter_is_not_told_of_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SOFT_ARM.read_text().replace("  port: lab:", "  frame_rate: fast\n  port: lab:", 1)
    (tmp_path / "arm.yaml").write_text(text)
    path = tmp_path / "circle.yaml"
    path.write_text(CIRCLE.format(cycle_s=3.0).replace("builtin:soft_arm", "arm.yaml"))
    assert main(["experiment", str(path), "--out", str(tmp_path)]) == EXIT_CANNOT_CREATE
    assert "pose_filter: {position_noise_mm: 0.4}" in capsys.readouterr().err
