"""The tip's error by cycle: as the loop saw it, and as is known afterwards.

A loop acts on a filtered tip, and its table is what papers give. Where the tip really was is told
by the emulation; on a rig it is told best by all measurements together, those that came later too.
That second table shows whether the first one is the tracker's noise, or the robot.
"""

from html import escape
from typing import Any, Final

import numpy as np
import yaml
from pydantic import ValidationError

from config.control import PoseFilterSettings
from daemon.recording.result import CycleError, ErrorTable
from daemon.workbench.report.report_data import RunData, Series
from daemon.workbench.report.report_table import Array

_NS_PER_S: Final = 1e9
_HEADS: Final = ("cycle", "samples", "mean / mm", "std / mm", "max / mm")
_FEWEST: Final = 2


def error_tables(run: RunData) -> str:
    """HTML."""
    if not run.cycles:
        return "<p>No cycle was followed.</p>"
    note = (
        "Euclidean distance between filtered tip and reference, while following: what the loop "
        "saw. Bars show the mean."
    )
    cycles, other_note = known_afterwards(run)
    return _table(run.cycles, note) + (_table(cycles, other_note) if cycles else "")


def known_afterwards(run: RunData) -> tuple[list[CycleError], str]:
    """The table of where the tip really was, and what it is. Empty: nobody knows."""
    if run.result is not None and run.result.true_cycles:
        return run.result.true_cycles, "The same of the true tip, which the emulation knows."
    if run.tip is None:
        return [], ""
    return smoothed_cycles(run.tip, _settings_of(run.robot_yaml)), (
        "The same of the smoothed tip: each place told by the measurements before it and after it. "
        "No loop can know it in time."
    )


def smoothed_cycles(tip: Series, settings: PoseFilterSettings) -> list[CycleError]:
    """Errors of what was measured and believed, once it is smoothed."""
    # Filterpy takes a second to come, and most reports do without.
    from daemon.estimation.recorded_path import recorded_path

    t_ns = np.round(tip.t_s * _NS_PER_S).astype(np.int64)
    later = np.diff(t_ns, prepend=t_ns[:1] - 1) > 0
    seen = (tip["believed"] > 0.0) & np.isfinite(tip["measured_mm"]).all(axis=1) & later
    if seen.sum() < _FEWEST:
        return []
    path = recorded_path(t_ns[seen], tip["measured_mm"][seen], settings)
    away_mm = np.linalg.norm(path.tip_mm - tip["reference_mm"][seen], axis=1)
    counts = (tip["running"][seen] > 0.0) & (tip["cycle"][seen] >= 0.0)
    return _by_cycle(tip["cycle"][seen][counts], away_mm[counts])


def _by_cycle(cycle: Array, away_mm: Array) -> list[CycleError]:
    table = ErrorTable()
    for number, error_mm in zip(cycle.tolist(), away_mm.tolist(), strict=True):
        table.count(int(number), error_mm)
    return table.rows()


def _settings_of(robot_yaml: str) -> PoseFilterSettings:
    """The loop's filter, as the run's copy of the robot file has it; else as it is by default."""
    try:
        value: Any = yaml.safe_load(robot_yaml)
        return PoseFilterSettings.model_validate(value["pose_filter"])
    except (yaml.YAMLError, ValidationError, KeyError, TypeError):
        return PoseFilterSettings()


def _table(cycles: list[CycleError], note: str) -> str:
    worst = max(row.mean_mm for row in cycles) or 1.0
    rows = "".join(
        f'<tr><td class="number">{row.cycle + 1}</td><td class="number">{row.samples}</td>'
        f'<td class="number">{row.mean_mm:.3f}</td><td class="number">{row.std_mm:.3f}</td>'
        f'<td class="number">{row.max_mm:.3f}</td>'
        f'<td class="bar"><i style="width:{100 * row.mean_mm / worst:.1f}%"></i></td></tr>'
        for row in cycles
    )
    head = "".join(f'<th class="number">{name}</th>' for name in _HEADS)
    return f'<table><tr>{head}<th></th></tr>{rows}</table><div class="note">{escape(note)}</div>'
