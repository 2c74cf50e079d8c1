"""Clouds of a real body: files in a folder and a table, checked as a whole, become a data set."""

import csv
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from daemon.commands.outcome.exit_codes import EXIT_DATA, EXIT_OK, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.host import processes
from daemon.risk.model_file import read_model
from daemon.workbench.body_model.clouds.cloud_dataset import CloudDataset
from daemon.workbench.body_model.clouds.cloud_import import ImportSettings, import_clouds
from daemon.workbench.body_model.clouds.cloud_table import TABLE, CloudImportError
from tests.daemon.workbench.body_model.clouds.test_centreline_fit import off_curve
from tests.daemon.workbench.body_model.clouds.test_collection import Silent
from tests.daemon.workbench.body_model.seen_bodies import Seen, seen_bodies
from tests.daemon.workbench.body_model.small_clouds import TENDON_ARM

POINTS = 200
AXES = ["straight_1", "straight_2", "straight_3", "helical"]
Cell = str | float
Change = Callable[[list[list[Cell]], Path], object]


@pytest.fixture(scope="module")
def seen() -> Seen:
    return seen_bodies("tendon_arm", configurations=6)


@pytest.fixture
def settings(seen: Seen) -> ImportSettings:
    return ImportSettings(seen.surface, seen.radius_mm, points=POINTS)


@pytest.fixture
def worker() -> Iterator[Executor]:
    with ThreadPoolExecutor(1) as pool:
        yield pool


def write_cloud(path: Path, points: NDArray[Any], kind: str) -> None:
    if kind == "npz":
        np.savez(path, points=points)
    else:
        path.write_bytes(
            trimesh.exchange.ply.export_ply(trimesh.PointCloud(points), encoding=kind)  # type: ignore[no-untyped-call]
        )


def table(seen: Seen, folder: Path, unit_mm: float = 1.0) -> list[list[Cell]]:
    """Of all clouds, in files of all kinds."""
    rows: list[list[Cell]] = [["file", *AXES, *(f"start_{name}" for name in AXES), "test"]]
    for i, (u, starts) in enumerate(
        zip(seen.plan["configurations"], seen.plan["starts"], strict=True)
    ):
        for j, start in enumerate(starts):
            kind = ("ascii", "binary", "npz")[(i + j) % 3]
            name = f"c{i}_{j}.{'npz' if kind == 'npz' else 'ply'}"
            write_cloud(folder / name, seen.clouds["clouds_mm"][i, j] / unit_mm, kind)
            rows.append([name, *u.tolist(), *start.tolist(), int(i % 5 == 0)])
    return rows


def write_table(folder: Path, rows: list[list[Cell]]) -> None:
    with (folder / TABLE).open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def few(rows: list[list[Cell]]) -> list[list[Cell]]:
    """As few configurations as can be imported."""
    return rows[:7]


def without(rows: list[list[Cell]], *names: str) -> list[list[Cell]]:
    keep = [k for k, name in enumerate(rows[0]) if name not in names]
    return [[row[k] for k in keep] for row in rows]


def imported(seen: Seen, folder: Path, settings: ImportSettings, worker: Executor) -> CloudDataset:
    return import_clouds(seen.robot, folder, settings, worker, Silent())


def test_what_was_seen_comes_back(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    write_table(tmp_path, table(seen, tmp_path))
    heard = Silent()
    made = import_clouds(seen.robot, tmp_path, settings, worker, heard)
    assert heard.begun == [("clouds", 12, 0), ("centrelines", 12, 0)]
    assert heard.done == 12
    np.testing.assert_array_equal(made.configurations, seen.plan["configurations"])
    np.testing.assert_array_equal(made.starts, seen.plan["starts"])
    assert np.flatnonzero(made.test).tolist() == [0, 5]
    assert made.radius_mm == 15.0
    for cloud, all_of_it in zip(
        made.clouds_mm.reshape(-1, POINTS, 3),
        seen.clouds["clouds_mm"].reshape(12, -1, 3),
        strict=True,
    ):
        seen_there = cloud - np.array(made.provenance["clouds_moved_by_mm"])
        away = np.abs(seen_there[:, None] - all_of_it).max(axis=2).min(axis=1)
        assert away.max() < 1e-3
    truly = seen.clouds["true_centrelines_mm"].astype(np.float64).reshape(12, -1, 3)
    fitted = made.centrelines_mm.astype(np.float64).reshape(12, -1, 3)
    off = [off_curve(line, fit) for line, fit in zip(truly, fitted, strict=True)]
    assert np.median(off) < 0.5
    assert 0.05 < np.median(made.fit_error_mm) < 1.0
    told = made.provenance["imported"]
    assert told["not_known"] == ["forces"]
    assert told["surface"]["disks"] == 9
    assert told["miss_mm"] < 0.5
    assert made.provenance["tip_load_g"] == 0.0
    assert "seen_on" not in made.provenance


@pytest.mark.parametrize(("unit", "unit_mm"), [("m", 1000.0), ("cm", 10.0)])
def test_units_are_what_they_are_said_to_be(
    unit: Any,
    unit_mm: float,
    seen: Seen,
    settings: ImportSettings,
    worker: Executor,
    tmp_path: Path,
) -> None:
    write_table(tmp_path, few(table(seen, tmp_path, unit_mm)))
    made = imported(seen, tmp_path, replace(settings, unit=unit), worker)
    assert made.clouds_mm[..., 2].max() > 100.0
    with pytest.raises(CloudImportError, match=r"line 2: c0_0\.ply: no body of 200 mm lies in it"):
        imported(seen, tmp_path, settings, worker)


def test_columns_that_need_not_be_there_are_made_up_for(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    rows = few(table(seen, tmp_path))
    write_table(tmp_path, without(rows, "test", *(f"start_{name}" for name in AXES)))
    made = imported(seen, tmp_path, settings, worker)
    assert made.test.sum() == 1
    np.testing.assert_array_equal(made.starts[:, 0], made.configurations)
    assert made.provenance["imported"]["not_known"] == ["starts", "forces"]
    again = imported(seen, tmp_path, settings, worker)
    assert again.sha256 == made.sha256


def ruined(cell: Cell, row: int, column: int) -> Change:
    def change(rows: list[list[Cell]], _: Path) -> None:
        rows[row][column] = cell

    return change


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (ruined("nothing.ply", 2, 0), r"line 3: nothing\.ply: no such file"),
        (
            ruined("../c0_1.ply", 2, 0),
            r"line 3: file is '\.\./c0_1\.ply'; it must be the name",
        ),
        (ruined("c0_1.txt", 2, 0), r"line 3: c0_1\.txt: must end with \.ply or \.npz"),
        (ruined("c0_0.ply", 2, 0), r"line 3: c0_0\.ply: is there already, in line 2"),
        (ruined("nan", 2, 1), "line 3: straight_1 is 'nan': not a finite number"),
        (ruined("much", 2, 4), "line 3: helical is 'much': not a finite number"),
        (ruined(15.5, 2, 2), "line 3: straight_2 is 15.5: the axis goes -15 to 15"),
        (ruined(-99.0, 2, 5), "line 3: start_straight_1 is -99: the axis goes -15 to 15"),
        (ruined("maybe", 2, 9), "line 3: test is 'maybe'; it must be 1 or 0"),
        (ruined(0, 2, 9), "line 3: is not to test with, and line 2 of the same configuration is"),
        (ruined(0.123, 2, 1), "line 3: its configuration is there 1 times, and most are 2 times"),
        (ruined("straight_9", 0, 1), "line 1: the column 'straight_1' is missing"),
        (ruined("straight_9", 0, 1), "line 1: the column 'straight_9' is unknown; there can be: f"),
        (ruined("straight_1", 0, 2), "line 1: the column 'straight_1' is there 2 times"),
        (ruined("x", 0, 5), "line 1: the column 'start_straight_1' is missing"),
        (lambda rows, _: rows[2].pop(), "line 3: 9 columns, not 10"),
        (lambda rows, _: rows.__delitem__(slice(1, None)), "0 configurations: a body is learnt"),
        (lambda rows, _: rows.__delitem__(slice(5, None)), "2 configurations: a body is learnt"),
        (lambda _, folder: (folder / "c0_0.ply").write_bytes(b"ply\n"), r"c0_0\.ply: is no cloud"),
    ],
)
def test_what_is_wrong_is_named(
    change: Change,
    told: str,
    seen: Seen,
    settings: ImportSettings,
    worker: Executor,
    tmp_path: Path,
) -> None:
    rows = table(seen, tmp_path)
    change(rows, tmp_path)
    write_table(tmp_path, rows)
    with pytest.raises(CloudImportError, match=told):
        imported(seen, tmp_path, settings, worker)


NAN = np.array([[np.nan, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("spoilt", "told"),
    [
        (lambda c: np.concatenate([c, NAN]), "1 of 257 points are not finite"),
        (lambda c: c[:150], "150 points, and 200 are wanted"),
        (lambda c: c[:, :2], r"must be \(n, 3\) numbers; it is \(256, 2\)"),
        (lambda c: c + np.array([0.0, 0.0, 900.0]), "are more than 320 mm from the base"),
        (lambda c: c[:, [2, 1, 0]], "no body of 200 mm lies in it"),
        (lambda c: c[c[:, 2] < -99.0], "0 points, and 200 are wanted"),
    ],
)
def test_a_cloud_that_is_none_of_this_body_is_named(
    spoilt: Callable[[NDArray[Any]], NDArray[Any]],
    told: str,
    seen: Seen,
    settings: ImportSettings,
    worker: Executor,
    tmp_path: Path,
) -> None:
    write_table(tmp_path, few(table(seen, tmp_path)))
    np.savez(tmp_path / "c2_0.npz", points=spoilt(seen.clouds["clouds_mm"][2, 0]))
    with pytest.raises(CloudImportError, match=rf"line 6: c2_0\.npz: .*{told}") as caught:
        imported(seen, tmp_path, settings, worker)
    assert len(caught.value.faults) == 1


def test_the_same_cloud_twice_is_found_though_the_files_are_not_the_same(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    write_table(tmp_path, table(seen, tmp_path))
    np.savez(tmp_path / "c2_0.npz", cloud=seen.clouds["clouds_mm"][1, 1], more=np.ones(3))
    with pytest.raises(CloudImportError, match="which of its arrays"):
        imported(seen, tmp_path, settings, worker)
    np.savez(tmp_path / "c2_0.npz", cloud=seen.clouds["clouds_mm"][1, 1])
    with pytest.raises(
        CloudImportError, match=r"line 6: c2_0\.npz: is the same cloud as c1_1\.npz"
    ):
        imported(seen, tmp_path, settings, worker)


def test_a_few_pixels_that_were_matched_wrongly_are_left_out(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    write_table(tmp_path, few(table(seen, tmp_path)))
    far = np.concatenate([seen.clouds["clouds_mm"][2, 0], [[0.0, 0.0, 5000.0]] * 3])
    np.savez(tmp_path / "c2_0.npz", points=far)
    made = imported(seen, tmp_path, settings, worker)
    assert np.linalg.norm(made.clouds_mm, axis=3).max() < 320.0


def test_all_that_is_wrong_is_said_at_once(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    rows = table(seen, tmp_path)
    rows[2][0], rows[4][1], rows[9][3] = "gone.ply", "?", 70.0
    write_table(tmp_path, rows)
    with pytest.raises(CloudImportError) as caught:
        imported(seen, tmp_path, settings, worker)
    assert [fault.split(":")[0] for fault in caught.value.faults] == ["line 3", "line 5", "line 10"]
    write_table(tmp_path, table(seen, tmp_path))
    for name in ("c0_0.ply", "c3_1.ply"):
        (tmp_path / name).write_bytes(b"")
    with pytest.raises(CloudImportError) as caught:
        imported(seen, tmp_path, settings, worker)
    assert [fault.split(":")[0] for fault in caught.value.faults] == ["line 2", "line 9"]


def test_of_very_many_faults_the_first_are_said() -> None:
    error = CloudImportError(Path("folder"), [f"line {k}: wrong" for k in range(2, 502)])
    assert len(str(error).splitlines()) == 21
    assert str(error).endswith("and 480 more")


def test_a_folder_without_a_table_is_named(
    seen: Seen, settings: ImportSettings, worker: Executor, tmp_path: Path
) -> None:
    with pytest.raises(CloudImportError, match=r"configurations\.csv: No such file"):
        imported(seen, tmp_path, settings, worker)


def test_from_files_to_a_model(
    seen: Seen,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(processes, "worker_processes", ThreadPoolExecutor)
    pytest.importorskip("torch", reason="pip install '.[training]'")
    folder, clouds, model = tmp_path / "seen", tmp_path / "clouds.npz", tmp_path / "model.npz"
    folder.mkdir()
    write_table(folder, table(seen, folder))
    words = ["mdn", "collect", str(TENDON_ARM), "--out", str(clouds), "--from", str(folder)]
    more = ["--points", str(POINTS), "--processes", "1", "--tip-load-g", "12", "--seen-on"]
    assert main([*words, *more, "2026-11-21"]) == EXIT_OK
    assert "6 configurations (2 to test with), 12 clouds of 200 points" in capsys.readouterr().out
    words = ["mdn", "train", str(TENDON_ARM), str(clouds), "--out", str(model), "--steps", "20"]
    small = ["--components", "2", "--shape-components", "1", "--coefficients", "2"]
    assert main([*words, *small]) == EXIT_OK
    file = read_model(model)
    assert file.robot == "tendon_arm"
    assert file.about["centrelines"] == "fitted to the clouds"
    assert "--from FOLDER --unit mm --length-mm 200 --radius-mm 15" in file.about["commands"][0]
    assert "--tip-load-g 12 --seen-on 2026-11-21" in file.about["commands"][0]
    assert (file.about["tip_load_g"], file.about["seen_on"]) == (12.0, "2026-11-21")
    assert all(file.model.knows(u) for u in seen.plan["configurations"][1:5])


def test_what_the_command_cannot_do_it_says(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["mdn", "collect", str(TENDON_ARM), "--out", str(tmp_path / "c.npz"), "--from"]
    assert main([*words, str(tmp_path)]) == EXIT_DATA
    assert "configurations.csv: No such file" in capsys.readouterr().err
    for wrong in ("--length-mm -5", "--points 5", "--processes 0", "--starts 3", "--seen-on today"):
        assert main([*words, str(tmp_path), *wrong.split()]) == EXIT_USAGE
    assert main([*words, str(tmp_path), "--seen-on", "2026-02-30"]) == EXIT_USAGE
