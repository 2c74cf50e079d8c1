"""What was planned while a run went on is in its report, with what it was said to risk."""

import asyncio
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from config.tasks.planned_path import PlannedPath
from daemon.messages import Message, PathPlanned, Risk
from daemon.reference.planned_path import write_path
from daemon.workbench.report.report import report_html
from daemon.workbench.report.report_data import RunData, read_run
from daemon.workbench.report.report_plans import plans_figure
from tests.daemon.recording.synthetic_run import BOOT_NS, direct_run, messages
from tests.daemon.workbench.report.test_report import titles

BY_PLACE = [0.0, 0.004, 0.001]
FIGURES: dict[str, Any] = {
    "length_mm": 61.4,
    "contact_risk": 0.0042,
    "body_point_risk_eq_10": 0.112,
    "before": {"contact_risk": 0.271},
    "contact_risk_by_place": BY_PLACE,
}


def planned_path(figures: dict[str, Any]) -> PlannedPath:
    return PlannedPath(
        tentacled_path=1,
        robot="soft_arm",
        axes=("a", "b"),
        model_sha256="0" * 64,
        surroundings_sha256="1" * 64,
        t_s=(0.0, 1.5, 4.0),
        u=((0.0, 0.0), (1.0, 0.0), (2.0, 1.0)),
        tip_mm=((0.0, 0.0, 180.0), (5.0, 1.0, 179.0), (12.0, 3.0, 176.0)),
        figures=figures,
    )


def told(file: str, t_s: float) -> PathPlanned:
    return PathPlanned(
        t_ns=BOOT_NS + round(t_s * 1e9),
        file=file,
        surroundings_sha256="1" * 64,
        model_sha256="0" * 64,
        duration_s=4.0,
        to_mm=[12.0, 3.0, 176.0],
        contact_risk=0.0113,
        clearance_mm=2.6,
    )


def run_with(folder: Path, *plans: PathPlanned) -> RunData:
    """A run in which these were told, and the gate told of the rest of a path."""
    recorded: list[Message] = []
    for message in messages(1, 4.0):
        recorded.append(with_path(message) if isinstance(message, Risk) else message)
        recorded += [one for one in plans if one not in recorded and one.t_ns <= at(message)]
    asyncio.run(direct_run(folder, recorded))
    return read_run(folder)


def at(message: Message) -> int:
    return int(getattr(message, "t_ns", 0))


def with_path(risk: Risk) -> Risk:
    left = max(0.0, 0.04 - 1e-11 * (risk.t_ns - BOOT_NS))
    return Risk(
        sequence=risk.sequence,
        t_ns=risk.t_ns,
        source=risk.source,
        threshold=0.05,
        scale=1.0,
        reasons=[],
        path_risk=left,
    )


def figure_of(run: RunData) -> Figure:
    made = plans_figure(run)
    assert made is not None
    return made


def test_each_plan_is_told_with_its_figures_and_drawn_beside_where_the_tip_went(
    tmp_path: Path,
) -> None:
    write_path(tmp_path / "plan-1.json", planned_path(FIGURES))
    write_path(tmp_path / "plan-2.json", planned_path({**FIGURES, "length_mm": 77.0}))
    run = run_with(tmp_path, told("plan-1.json", 1.0), told("plan-2.json", 3.0))
    assert [round(plan.t_s) for plan in run.plans] == [1, 3]
    page = report_html(run)
    assert {"Planned paths", "What was planned"} <= set(titles(page))
    for cell in ("plan-1.json", "plan-2.json", "0.42%", "1.13%", "27.10%", "2.6", "77", "11.2%"):
        assert f">{cell}<" in page
    axes = figure_of(run).axes
    ways = [line for line in axes[2].lines if line.get_linestyle() == "--"]
    assert len(ways) == 2
    assert np.column_stack(ways[0].get_data()).tolist() == [[0.0, 0.0], [5.0, 1.0], [12.0, 3.0]]
    courses = axes[3].lines
    assert courses[0].get_ydata().tolist() == BY_PLACE  # type: ignore[union-attr]
    labels = {str(line.get_label()) for line in axes[4].lines}
    assert "touching on what is left of the path" in labels
    assert "touched in the last minute" not in labels


@pytest.mark.usefixtures("undrawn")
def test_a_plan_whose_file_is_not_there_is_told_all_the_same(tmp_path: Path) -> None:
    (tmp_path / "damaged.json").write_text("{")
    run = run_with(tmp_path, told("lost.json", 1.0), told("damaged.json", 2.0))
    assert plans_figure(run) is None
    page = report_html(run)
    assert "What was planned" in titles(page) and "Planned paths" not in titles(page)
    assert page.count(">1.13%<") == 2 and ">–<" in page


def test_a_name_that_leads_elsewhere_is_looked_for_beside_the_recording(tmp_path: Path) -> None:
    write_path(tmp_path / "outside.json", planned_path(FIGURES))
    (tmp_path / "run").mkdir()
    run = run_with(tmp_path / "run", told("../outside.json", 1.0))
    assert run.plans[0].path is None


def test_figures_that_are_none_leave_the_path(tmp_path: Path) -> None:
    none_by_place = [None, [0.0], ["a", "b", "c"], [[1.0], [2.0, 3.0], 4.0]]
    for number, by_place in enumerate(none_by_place):
        figures = {**FIGURES, "contact_risk_by_place": by_place, "contact_risk": "?", "before": 3}
        path = planned_path(json.loads(json.dumps(figures)))
        write_path(tmp_path / f"plan-{number}.json", path)
    plans = [told(f"plan-{number}.json", 1.0) for number in range(len(none_by_place))]
    run = run_with(tmp_path, *plans)
    assert [plan.course for plan in run.plans] == [None] * len(none_by_place)
    assert all(plan.path is not None for plan in run.plans)
    assert len(figure_of(run).axes[3].lines) == 0
    assert ">–<" in report_html(run)


@pytest.mark.usefixtures("undrawn")
def test_a_run_in_which_nothing_was_planned_says_nothing_of_it(tmp_path: Path) -> None:
    run = run_with(tmp_path)
    assert plans_figure(run) is None
    assert "What was planned" not in report_html(run)
