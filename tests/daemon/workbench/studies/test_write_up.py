"""Tables have the paper's figures beside ours; pictures are there and show something."""

from pathlib import Path

import matplotlib.image
import msgspec
import pytest

from daemon.workbench.studies.error_tables import (
    aims_text,
    comparison_table,
    error_table,
    more_table,
    trouble_text,
)
from daemon.workbench.studies.figures import comparison_figure
from daemon.workbench.studies.findings import Findings, findings
from daemon.workbench.studies.study_file import StudyFile, load_study
from daemon.workbench.studies.table import Table, ordinal
from daemon.workbench.studies.write_up import (
    comparison_figures,
    comparison_tables,
    median_run,
    reproduction_figures,
    reproduction_tables,
    write_up,
)
from tests.daemon.workbench.studies.made_up import leave_steps, outcome, write_study

OUTCOMES = [
    outcome([2.0, 0.5], 1, "calm"),
    outcome([3.0, 0.7], 2, "calm"),
    outcome([2.0, 0.8], 1, "loaded", settled_s=12.0),
    outcome([5.0, 1.0], 2, "loaded", holds=1),
    outcome([6.0, 9.0], 1, "loaded", "arcs"),
    outcome([6.0, 9.0], 2, "loaded", "arcs", failure="the motion was held too often"),
]


@pytest.fixture
def file(tmp_path: Path) -> StudyFile:
    return load_study(write_study(tmp_path / "study"))


@pytest.fixture
def found(file: StudyFile) -> Findings:
    return findings(file, OUTCOMES, planned=8)


def cells(table: Table, heading: str) -> dict[str, list[str]]:
    (section,) = [one for one in table.sections if one.heading == heading]
    return {row[0]: row[1:] for row in section.rows}


def test_the_papers_figures_stand_above_ours(file: StudyFile, found: Findings) -> None:
    table = error_table(file, file.study.tables[0], found)
    assert list(table.head) == ["", "1st mean", "2nd mean", "1st max", "2nd max", "runs"]
    rows = cells(table, "a load")
    assert list(rows) == ["Somebody 2018", "measured Jacobian", "arcs"]
    assert rows["Somebody 2018"] == ["4.56 (1.99)", "5.50 (1.12)", "9.02", "–", ""]
    assert rows["measured Jacobian"] == [
        "3.50 (1.75) [2.00–5.00]",
        "0.90 (0.45) [0.80–1.00]",
        "10.50",
        "2.70",
        "2: 1 held",
    ]
    assert rows["arcs"][1] == "∞ (∞) [9.00–∞]"
    assert rows["arcs"][-1] == "2: 1 failed, 1 unstable"
    assert list(cells(table, "no load")) == ["measured Jacobian"]


def test_the_other_table_has_what_the_paper_has_not(file: StudyFile, found: Findings) -> None:
    rows = cells(more_table(file, file.study.tables[0], found), "a load")
    assert rows["measured Jacobian"] == [
        "3.60 / 1.00",
        "1.0 / 2.0",
        "12 (1 of 2)",
        "2",
        "0.20 (0.40)",
        "0.12 (0.34)",
        "0.56",
        "0.15 (0.30) [0.84]",
    ]
    assert (rows["arcs"][2], rows["arcs"][-1]) == ("never", "–")


def test_one_table_compares_all(file: StudyFile, found: Findings) -> None:
    table = comparison_table(file, found)
    assert cells(table, "a load")["measured Jacobian"][:2] == [
        "3.50 (1.75) 10.50",
        "0.90 (0.45) 2.70",
    ]
    lengths = {len(row) for section in table.sections for row in section.rows}
    assert lengths == {len(table.head)}


def test_aims_are_told_reached_or_missed_for_each_controller(
    file: StudyFile, found: Findings
) -> None:
    lines = aims_text(file, found)
    assert "reached  loaded, measured Jacobian: cycle 2: 0.90 mm, at most 1.00 mm" in lines
    assert "reached  loaded, measured Jacobian: 0 of 2 runs unstable or given up" in lines
    assert "MISSED   loaded, arcs: cycle 2: ∞ mm, at most 1.00 mm" in lines
    assert "MISSED   loaded, arcs: 2 of 2 runs unstable or given up" in lines
    pairs = "first cycle no worse than in calm: 1 of 2 runs"
    assert f"MISSED   loaded, measured Jacobian: {pairs}" in lines


def test_no_aim_is_reached_by_runs_that_were_refused_or_lost(file: StudyFile) -> None:
    """Not even where they were lost alike in what they are compared with."""
    lost = [
        outcome([], seed, name, failure="the axes are too slow")
        for name in ("calm", "loaded")
        for seed in (1, 2)
    ]
    refused = [msgspec.structs.replace(one, refused=True, result=None) for one in lost]
    for outcomes in (lost, refused):
        lines = aims_text(file, findings(file, outcomes, planned=8))
        assert "MISSED   loaded, measured Jacobian: 2 of 2 runs unstable or given up" in lines
        pairs = "first cycle no worse than in calm: 0 of 2 runs"
        assert f"MISSED   loaded, measured Jacobian: {pairs}" in lines


def test_what_went_wrong_is_told_with_its_reason(file: StudyFile, found: Findings) -> None:
    assert trouble_text(file, found) == [
        "loaded, measured Jacobian: 1 held; causes: tracker_late",
        "loaded, arcs: 1 failed, 1 unstable; the motion was held too often",
    ]


def test_every_row_of_a_file_has_as_many_cells_as_its_head(
    file: StudyFile, found: Findings
) -> None:
    for table in (*reproduction_tables(file, found), *comparison_tables(file, found)):
        lines = [line for line in table.markdown().splitlines() if line.startswith("|")]
        assert len({line.count("|") for line in lines}) == 1
        assert len(lines) == 2 + sum(
            len(section.rows) + bool(section.heading) for section in table.sections
        )


def test_the_run_in_the_middle_stands_for_all() -> None:
    runs = [outcome([1.0, mean_mm], seed) for seed, mean_mm in enumerate((0.9, 0.3, 0.5, 0.4))]
    assert median_run(runs, 1).seed == 3
    assert median_run(runs[:3], 1).seed == 2


def test_pictures_and_tables_are_written(file: StudyFile, found: Findings, tmp_path: Path) -> None:
    for one in OUTCOMES[:5]:
        leave_steps(tmp_path, one, error_mm=0.3)
    tables = reproduction_tables(file, found)
    written = write_up(file, found, tmp_path, tables, reproduction_figures)
    pictures = ["figure7-broyden.png", "figure7-arcs.png"]
    assert [path.name for path in written] == ["tables.md", "tables.json", *pictures]
    for name in pictures:
        picture = matplotlib.image.imread(tmp_path / name)
        assert picture.shape[1] == 1600
        assert 0.01 < (picture[..., :3].min(axis=2) < 0.9).mean() < 0.5
    text = (tmp_path / "tables.md").read_text()
    assert "6 of 8 runs" in text
    assert all(f"({name})" in text for name in pictures)
    data = msgspec.json.decode((tmp_path / "tables.json").read_bytes())
    assert data["summaries"][0]["cycles"][0]["mean_mm"]["median"] == 2.5


def test_what_made_the_runs_is_named_with_what_differed_from_it(
    file: StudyFile, tmp_path: Path
) -> None:
    """Runs of several programs do not quite compare: none of them is kept quiet."""
    commit = "0123456789abcdef0123456789abcdef01234567"
    made_by = [commit, f"{commit}+", "1.2.0"]
    outcomes = [
        msgspec.structs.replace(outcome([2.0, 0.5], seed), commit=one)
        for seed, one in enumerate(made_by)
    ]
    found = findings(file, outcomes, planned=8)
    write_up(file, found, tmp_path, [], comparison_figures)
    text = (tmp_path / "tables.md").read_text()
    assert "Made by 0123456789ab, 0123456789ab+, 1.2.0." in text


def test_one_picture_compares_all(file: StudyFile, found: Findings, tmp_path: Path) -> None:
    written = write_up(file, found, tmp_path, comparison_tables(file, found), comparison_figures)
    picture = matplotlib.image.imread(written[-1])
    assert written[-1].name == "comparison.png"
    assert (picture[..., :3].min(axis=2) < 0.9).mean() > 0.005


def test_the_picture_names_controllers_that_the_first_experiment_has_not_seen_yet(
    file: StudyFile,
) -> None:
    outcomes = [outcome([2.0, 0.5], 1, "calm"), *OUTCOMES[2:]]
    made = comparison_figure(file, findings(file, outcomes, planned=8))
    (legend,) = made.legends
    assert [text.get_text() for text in legend.get_texts()] == ["measured Jacobian", "arcs"]


def test_where_nothing_was_run_there_is_no_picture(file: StudyFile, tmp_path: Path) -> None:
    nothing = findings(file, [], planned=8)
    for figures in (comparison_figures, reproduction_figures):
        assert list(figures(file, nothing, tmp_path)) == []
    assert "0 of 8 runs" in write_up(file, nothing, tmp_path, [], comparison_figures)[0].read_text()


@pytest.mark.parametrize(
    ("cycle", "text"), [(0, "1st"), (1, "2nd"), (2, "3rd"), (3, "4th"), (10, "11th"), (20, "21st")]
)
def test_cycles_are_counted_as_people_do(cycle: int, text: str) -> None:
    assert ordinal(cycle) == text
