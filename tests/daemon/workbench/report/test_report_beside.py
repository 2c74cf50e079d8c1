"""The process that makes the report beside a run: same report, whatever becomes of the process."""

import os
import select
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.recording.run_folder import unfinished
from daemon.recording.run_parts import control_hash
from daemon.recording.run_reader import RunMessage, RunReader, UnreadableRunError
from daemon.workbench.report import report_process
from daemon.workbench.report.report import write_report
from daemon.workbench.report.report_data import GrowingRun
from daemon.workbench.report.report_process import REPORT, ReportBeside
from daemon.workbench.report.two_processes import in_two_processes, one_after_the_other
from tests.daemon.recording.synthetic_run import make_run

ENDS_WITHIN_S = 60.0

# Of later versions of Python, where there are threads; here it is only copies that do nothing.
pytestmark = pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    make_run(folder, cycles=2, cycle_s=3.0)
    return folder


@pytest.fixture(scope="module")
def page(whole: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """What `tentacled report` makes of it."""
    return write_report(whole, tmp_path_factory.mktemp("page") / "page.html").read_text()


@pytest.fixture
def beside(whole: Path) -> Iterator[ReportBeside]:
    (whole / "report.html").unlink(missing_ok=True)
    made = ReportBeside(whole)
    yield made
    made.end()


def process_of(beside: ReportBeside) -> "subprocess.Popen[bytes]":
    assert beside._process is not None
    return beside._process


def test_the_process_writes_what_the_command_would(beside: ReportBeside, page: str) -> None:
    beside.begin()
    assert beside.control_hash() == control_hash(beside._folder / "run.mcap")
    process = process_of(beside)
    path = beside.write()
    assert beside._process is process, "it was this process that answered"
    assert path.read_text() == page
    beside.end()
    assert process.returncode is not None


def test_a_process_that_has_died_costs_no_report(beside: ReportBeside, page: str) -> None:
    beside.begin()
    process_of(beside).kill()
    process_of(beside).wait()
    assert beside.control_hash() == control_hash(beside._folder / "run.mcap")
    assert beside.write().read_text() == page


def test_a_process_that_does_not_answer_costs_no_report(
    beside: ReportBeside, page: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside.begin()
    process = process_of(beside)
    process.send_signal(signal.SIGSTOP)
    monkeypatch.setattr(report_process, "_ANSWERS_WITHIN_S", 0.1)
    assert beside.write().read_text() == page
    assert process.returncode == -signal.SIGKILL


def test_a_process_that_cannot_be_started_costs_no_report(
    beside: ReportBeside, page: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_process, "_COMMAND", ("/nowhere/python",))
    beside.begin()
    assert beside.write().read_text() == page


def test_where_nothing_was_recorded_the_error_says_so(tmp_path: Path) -> None:
    beside = ReportBeside(tmp_path)
    beside.begin()
    with pytest.raises(UnreadableRunError, match="there is no run"):
        beside.write()
    assert beside._process is None, "a process that has failed is not kept"


def test_the_process_leaves_when_its_input_ends(whole: Path) -> None:
    command = [sys.executable, "-m", "daemon.workbench.report.report_process", str(whole)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(ENDS_WITHIN_S) == 0


def test_the_process_does_not_outlive_a_starter_that_is_killed(whole: Path) -> None:
    program = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from daemon.workbench.report.report_process import ReportBeside\n"
        "beside = ReportBeside(Path(sys.argv[1]))\n"
        "beside.begin()\n"
        "beside.control_hash()\n"  # it answers, so it is there
        "print(beside._process.pid, flush=True)\n"
        "time.sleep(600)\n"
    )
    command = [sys.executable, "-c", program, str(whole)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as starter:
        assert starter.stdout is not None
        watched = os.pidfd_open(int(starter.stdout.readline()))
        try:
            assert select.select([watched], [], [], 0.0)[0] == []
            starter.kill()
            assert select.select([watched], [], [], ENDS_WITHIN_S)[0] == [watched]
        finally:
            os.close(watched)


def test_a_recording_is_read_as_it_grows(whole: Path, tmp_path: Path) -> None:
    """Cut at any place, also within the magic bytes at the beginning and at the end."""
    data = (whole / "run.mcap").read_bytes()
    expected = list(RunReader(whole / "run.mcap").messages())
    part = unfinished(tmp_path / "run.mcap")
    seen: list[RunMessage] = []
    growing = GrowingRun(tmp_path, seen.append)
    with pytest.raises(UnreadableRunError):
        growing.catch_up()
    for end in (0, 3, 8, 20, *range(1000, len(data), 20_011), len(data) - 9, len(data) - 3):
        part.write_bytes(data[:end])
        growing.catch_up()
    part.rename(tmp_path / "run.mcap")
    assert not growing._parts.whole
    (tmp_path / "run.mcap").write_bytes(data)
    assert growing.data().whole
    growing.catch_up()
    assert seen == expected
    assert growing._parts.readers[1].read_bytes == len(data)


def test_the_process_reads_along_and_reports_what_came_last(whole: Path, tmp_path: Path) -> None:
    data = (whole / "run.mcap").read_bytes()
    (tmp_path / "run.mcap.part").write_bytes(data[: len(data) // 2])
    requests, to_process = os.pipe()
    from_process, answers = os.pipe()
    process = report_process.ReportProcess(tmp_path, requests, answers)
    process._run.catch_up()
    read_before = process._run._parts.readers[1].read_bytes
    (tmp_path / "run.mcap.part").rename(tmp_path / "run.mcap")
    (tmp_path / "run.mcap").write_bytes(data)
    os.write(to_process, REPORT)
    os.close(to_process)
    process.run()
    assert 0 < read_before <= len(data) // 2
    assert os.read(from_process, 100) == b"\n"
    once = (tmp_path / "report.html").read_text()
    for descriptor in (requests, answers, from_process):
        os.close(descriptor)
    assert write_report(tmp_path).read_text() == once


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_work_in_two_processes_comes_back_in_order(count: int) -> None:
    def make(place: int) -> str:
        return f"{place}" * 100_000  # more than a pipe holds

    assert in_two_processes(make, count) == one_after_the_other(make, count)


def test_what_the_copy_does_not_bring_is_made_here() -> None:
    here = os.getpid()

    def make(place: int) -> str:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return str(place)

    assert in_two_processes(make, 3) == ["0", "1", "2"]


def test_an_error_in_the_work_is_told_and_leaves_no_process(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    copies: list[int] = []
    fork = os.fork

    def remembering() -> int:
        copies.append(fork())
        return copies[-1]

    monkeypatch.setattr(os, "fork", remembering)

    def make(place: int) -> str:
        raise ValueError(f"no {place}")

    with pytest.raises(ValueError, match="no 0"):
        in_two_processes(make, 3)
    with pytest.raises(ChildProcessError):
        os.waitpid(copies[0], os.WNOHANG)
