"""Recordings as tables: what each column is, what is missing, and what a damaged run tells."""

import asyncio
import csv
import sys
import tracemalloc
from pathlib import Path

import pytest

from daemon import api
from daemon.commands.outcome.exit_codes import EXIT_DATA, EXIT_OK, EXIT_UNAVAILABLE, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.messages import Message, Tip
from daemon.recording.export import tables
from daemon.recording.export.files import read_frame, read_frames, write_csv, write_parquet
from daemon.recording.export.tables import STEPS, TABLES, Column, read_tables
from tests.daemon.recording.synthetic_run import (
    BOOT_NS,
    RATE_HZ,
    WALL_NS,
    direct_run,
    event,
    make_run,
    messages,
)

CYCLE_S = 4.0
AXES = ("proximal_1", "proximal_2", "proximal_3", "distal_1", "distal_2", "distal_3")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    make_run(folder, cycles=1, cycle_s=CYCLE_S)
    return folder


def tips() -> list[Tip]:
    return [one for one in messages(1, CYCLE_S) if isinstance(one, Tip)]


def test_a_row_for_each_control_step_with_units_in_the_names(run: Path) -> None:
    steps = read_tables(run).tables[STEPS]
    known = tips()
    assert steps.rows == len(known)
    assert steps.columns["sequence"] == [tip.sequence for tip in known]
    assert steps.columns["t_ns"] == [tip.t_ns for tip in known]
    wall_ns = [tip.t_ns - BOOT_NS + WALL_NS for tip in known]
    assert steps.columns["date_ns"] == wall_ns
    assert steps.columns["t_s"][-1] == pytest.approx((known[-1].t_ns - known[0].t_ns) * 1e-9)
    for number, name in enumerate(("tip_x_mm", "tip_y_mm", "tip_z_mm")):
        assert steps.columns[name] == [tip.tip_mm[number] for tip in known if tip.tip_mm]
    assert steps.columns["error_mm"] == [tip.error_mm for tip in known]
    assert steps.columns["velocity_x_mm_s"][0] == 0.0
    assert steps.columns["quaternion_w"][0] == 1.0
    assert {f"target_{axis}_mm" for axis in AXES} <= set(steps.columns)
    assert {f"force_{axis}_n" for axis in AXES} <= set(steps.columns)
    assert {"contact_risk", "body_point_risk", "risk_threshold", "risk_scale"} <= set(steps.columns)


def test_what_was_not_known_is_none_and_columns_are_of_one_length(run: Path) -> None:
    tables = read_tables(run).tables
    reference = tables[STEPS].columns["reference_x_mm"]
    unknown = [tip.reference_mm is None for tip in tips()]
    assert [value is None for value in reference] == unknown
    assert any(unknown) and not all(unknown)
    for table in tables.values():
        assert {len(column) for column in table.columns.values()} == {table.rows}


def test_steps_are_put_together_as_they_come_in_whatever_number_are_open(
    run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_once = read_tables(run, [STEPS]).tables
    monkeypatch.setattr(tables, "_STEPS_OPEN", 4)
    assert read_tables(run, [STEPS]).tables == at_once


def test_a_column_keeps_its_values_in_little_room() -> None:
    count, whole = 50_000, 2**70
    tracemalloc.start()
    floats, unknown, words = Column(), Column(unknown=count), Column()
    for number in range(count):
        floats.append(number * 0.1)
        words.append("running" if number % 2 else None)
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert kept < 16 * count, "bytes"
    assert floats == [number * 0.1 for number in range(count)]
    assert unknown == [None] * count
    assert words[-2:] == [None, "running"]
    mixed = Column()
    for value in (1, 1.0, True, None, "1", whole) * 500:
        mixed.append(value)
    assert list(map(repr, mixed)) == list(map(repr, (1, 1.0, True, None, "1", whole))) * 500


def test_every_kind_of_message_has_its_table(run: Path) -> None:
    tables = read_tables(run).tables
    assert list(tables) == [name for name in TABLES if name in tables]
    assert {"steps", "state", "tip", "axes", "risk", "loop", "event", "body"} == set(tables)
    assert tables["event"].columns["name"][0] == "running"
    assert "tracker_rate_hz" in tables["state"].columns
    assert "status_lateness_p99_s" in tables["loop"].columns
    with pytest.raises(ValueError, match="no table tips: there are steps, "):
        read_tables(run, ["tips"])


def test_a_table_has_the_same_times_whichever_others_are_read(tmp_path: Path) -> None:
    tip = Tip(sequence=1, t_ns=BOOT_NS + 500_000_000, state="running")
    told: list[Message] = [event(1, BOOT_NS, "armed", "running"), tip]
    asyncio.run(direct_run(tmp_path, told))
    everything = read_tables(tmp_path).tables
    assert list(everything["tip"].columns["t_s"]) == pytest.approx([0.5])
    for name, table in everything.items():
        assert read_tables(tmp_path, [name]).tables[name].columns == table.columns


def test_a_recording_without_axes_names_counts_them(tmp_path: Path) -> None:
    kept = [one for one in messages(1, CYCLE_S) if type(one).__name__ == "Axes"]
    asyncio.run(direct_run(tmp_path, kept))
    steps = read_tables(tmp_path).tables[STEPS]
    assert steps.rows == len(kept)
    assert {f"target_{number}" for number in range(1, 7)} <= set(steps.columns)


def test_csv_has_dates_numbers_and_nothing_for_what_is_not_known(run: Path, tmp_path: Path) -> None:
    written = write_csv(read_tables(run, [STEPS]), tmp_path / "new" / "folder")
    assert [path.name for path in written] == ["steps.csv"]
    with written[0].open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    known = tips()
    assert len(rows) == len(known)
    assert rows[0]["date_utc"] == "2020-01-01T00:00:00." + f"{known[0].t_ns - BOOT_NS:09d}Z"
    assert float(rows[-1]["tip_x_mm"]) == known[-1].tip_mm[0]  # type: ignore[index]
    assert rows[0]["reference_x_mm"] == ""
    assert rows[0]["believed"] == "true"


def test_frames_have_dates_and_numbers(run: Path) -> None:
    frame = read_frame(run)
    assert str(frame["date_utc"].dtype).startswith("datetime64[ns")
    assert frame["date_utc"].iloc[0].value == tips()[0].t_ns - BOOT_NS + WALL_NS
    assert frame["tip_x_mm"].dtype.kind == "f"
    assert frame["reference_x_mm"].isna().sum() == sum(not tip.reference_mm for tip in tips())
    assert 1.0 / frame["t_s"].diff().median() == pytest.approx(RATE_HZ, rel=0.02)
    assert frame.attrs["notes"] == []
    assert set(read_frames(run, ["tip", "event"])) == {"tip", "event"}
    assert api.read_frame is read_frame
    with pytest.raises(ValueError, match="nothing was recorded of internal_error"):
        read_frame(run, "internal_error")


def test_parquet_is_what_the_frames_are(run: Path, tmp_path: Path) -> None:
    import pandas as pd

    tables = read_tables(run)
    written = {path.stem: path for path in write_parquet(tables, tmp_path)}
    assert set(written) == set(tables.tables)
    for name, frame in read_frames(run).items():
        again = pd.read_parquet(written[name])
        assert list(again.columns) == list(frame.columns)
        assert len(again) == len(frame)
    steps = pd.read_parquet(written["steps"])
    assert (steps["tip_x_mm"] == read_frame(run)["tip_x_mm"]).all()
    assert (steps["date_utc"] == read_frame(run)["date_utc"]).all()


def test_a_damaged_recording_tells_what_is_left_and_what_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = make_run(tmp_path, cycles=2, cycle_s=20.0)
    whole = read_tables(tmp_path).tables[STEPS].rows
    content = bytearray(path.read_bytes())
    content[len(content) // 3] ^= 0xFF
    path.write_bytes(content[: len(content) * 2 // 3])
    found = read_tables(tmp_path)
    assert 0 < found.tables[STEPS].rows < whole
    assert not found.whole
    assert main(["export", str(tmp_path)]) == EXIT_OK
    told = capsys.readouterr()
    assert "no proper end" in told.err
    assert str(tmp_path / "export" / "steps.csv") in told.out.splitlines()
    path.write_bytes(b"nonsense, and much of it")
    assert main(["export", str(tmp_path)]) == EXIT_DATA
    assert "is not a recording" in capsys.readouterr().err


def test_the_command_takes_tables_and_formats(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["export", str(run / "run.mcap"), "--out", str(tmp_path / "out")]
    assert main([*words, "--format", "parquet", "--table", "tip", "--table", "event"]) == EXIT_OK
    assert capsys.readouterr().out.splitlines() == [
        str(tmp_path / "out" / "tip.parquet"),
        str(tmp_path / "out" / "event.parquet"),
    ]
    assert main([*words, "--table", "tips"]) == EXIT_USAGE
    assert "there is no table tips" in capsys.readouterr().err


def test_without_the_libraries_it_is_said_how_to_get_them_and_csv_goes_on(
    run: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    words = ["export", str(run), "--out", str(tmp_path)]
    assert main([*words, "--format", "parquet"]) == EXIT_UNAVAILABLE
    assert "pip install 'tentacled[export]'" in capsys.readouterr().err
    with pytest.raises(RuntimeError, match="needs pandas"):
        read_frame(run)
    assert main(words) == EXIT_OK


def test_tables_that_were_in_the_folder_before_and_stay_are_named(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "risk.csv").write_text("of another run\n")
    (tmp_path / "notes.csv").write_text("somebody's own\n")
    words = ["export", str(run), "--out", str(tmp_path), "--table", STEPS]
    assert main(words) == EXIT_OK
    told = capsys.readouterr().err
    assert f"{tmp_path / 'risk.csv'} was there before, and is not of this export" in told
    assert "notes.csv" not in told
    assert "steps.csv" not in told
