"""Which recordings a page may ask for: those of the folders, and nothing beside them."""

from pathlib import Path

import pytest

from daemon.dashboard.recorded_runs import RecordedRuns
from daemon.recording.result import CycleError, Result, write_result
from tests.daemon.recording.synthetic_run import make_run


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "runs" / "arm-2026"
    folder.mkdir(parents=True)
    make_run(folder, cycles=1, cycle_s=1.0)
    (folder / "provenance.json").write_text('{"robot": "arm", "started": "2026-01-02T03:04:05Z"}')
    (folder / "report.html").write_text("<p>")
    (folder / "secret.txt").write_text("no")
    (tmp_path / "runs" / "empty").mkdir()
    return tmp_path / "runs"


def test_runs_are_told_with_what_is_known_of_them(root: Path) -> None:
    error = CycleError(cycle=0, samples=9, mean_mm=0.5, std_mm=0.1, max_mm=1.0)
    result = Result(
        robot="arm",
        simulated=True,
        trajectory="circle",
        controller="broyden",
        seed=1,
        duration_s=4.0,
        cycles=[error],
        steps=9,
        holds=0,
        refusals=0,
    )
    write_result(root / "arm-2026", result)
    (told,) = RecordedRuns([root]).offered()
    assert told["name"] == "arm-2026" and told["robot"] == "arm" and told["report"]
    assert told["trajectory"] == "circle" and told["mean_mm"] == 0.5 and told["finished"]
    assert [file["name"] for file in told["files"]] == ["run.mcap"]
    assert told["files"][0]["bytes"] == (root / "arm-2026" / "run.mcap").stat().st_size


@pytest.mark.parametrize(
    "name", ["..", ".", "", "empty", "../runs/arm-2026", "arm-2026/", "/etc", "arm-2026\x00"]
)
def test_no_name_leads_anywhere_else(root: Path, name: str) -> None:
    assert RecordedRuns([root]).find(name) is None


@pytest.mark.parametrize("file", ["secret.txt", "../arm-2026/run.mcap", "provenance.json", "", "."])
def test_only_recordings_report_and_surroundings_are_handed_out(root: Path, file: str) -> None:
    runs = RecordedRuns([root])
    assert runs.file("arm-2026", file) is None
    assert runs.file("arm-2026", "run.mcap") == root / "arm-2026" / "run.mcap"
    assert runs.file("arm-2026", "report.html") is not None


def test_links_are_not_followed(root: Path, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (root / "linked").symlink_to(tmp_path / "elsewhere")
    make_run(tmp_path / "elsewhere", cycles=1, cycle_s=1.0)
    (root / "arm-2026" / "run-2.mcap").symlink_to("/etc/passwd")
    runs = RecordedRuns([root])
    assert runs.find("linked") is None and runs.file("arm-2026", "run-2.mcap") is None
    assert [row["name"] for row in runs.offered()] == ["arm-2026"]


def test_a_run_that_was_named_is_found_wherever_it_is(root: Path, tmp_path: Path) -> None:
    make_run(tmp_path, cycles=1, cycle_s=1.0).rename(tmp_path / "kept.mcap")
    runs = RecordedRuns([], [tmp_path / "kept.mcap", root / "arm-2026"])
    assert runs.find("kept.mcap") == tmp_path / "kept.mcap"
    assert runs.find("arm-2026") == root / "arm-2026"
    assert {row["name"] for row in runs.offered()} == {"kept.mcap", "arm-2026"}


def test_folders_that_come_later_are_seen_and_missing_ones_are_no_error(tmp_path: Path) -> None:
    runs = RecordedRuns([tmp_path / "not there"])
    assert runs.offered() == []
    (tmp_path / "later" / "one").mkdir(parents=True)
    make_run(tmp_path / "later" / "one", cycles=1, cycle_s=1.0)
    runs.add_root(tmp_path / "later")
    runs.add_root(tmp_path / "later")
    assert [row["name"] for row in runs.offered()] == ["one"]
