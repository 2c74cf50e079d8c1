"""The report of a run: one HTML file with all figures and tables, and nothing from outside."""

from collections.abc import Callable, Sequence
from html import escape
from math import degrees
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml
from matplotlib.figure import Figure
from pydantic import ValidationError

from config.control import PoseFilterSettings
from daemon.messages import Event
from daemon.recording.result import CycleError, ErrorTable
from daemon.recording.run_folder import REPORT_FILE, VIRTUAL_TIME, utc_text
from daemon.remote.reason_groups import detail_of
from daemon.workbench.report.report_body import body_figure
from daemon.workbench.report.report_data import RunData, Series, read_run
from daemon.workbench.report.report_paths import close_up_figure, path_figure
from daemon.workbench.report.report_plans import plans_figure, plans_table
from daemon.workbench.report.report_series import (
    actuator_figure,
    error_figure,
    force_figure,
    risk_figure,
    timing_figure,
)
from daemon.workbench.report.report_style import PAGE_STYLE, as_data_uri, styled
from daemon.workbench.report.report_table import Array
from daemon.workbench.report.two_processes import one_after_the_other

_NS_PER_S: Final = 1e9
_HEADS: Final = ("cycle", "samples", "mean / mm", "std / mm", "max / mm")
_POSE_HEADS: Final = ("cycle", "x / mm", "y / mm", "z / mm", "direction / °")
_FEWEST: Final = 2
_EVENTS_AT_MOST: Final = 1000
_STATE_LOOKS: Final = {"hold": "warning", "fault": "alarm", "estop": "alarm", "running": "good"}
_SEVERITY_LOOKS: Final = {
    "warning": "warning",
    "not_ready": "warning",
    "hold": "warning",
    "disarm": "alarm",
    "fault": "alarm",
    "estop": "alarm",
}

_FIGURES: Final[tuple[tuple[str, str, Callable[[RunData], Figure | None]], ...]] = (
    (
        "Path of the tip",
        "Later cycles are darker. Distances have the same scale in all directions.",
        lambda run: None if run.tip is None else path_figure(run.tip),
    ),
    (
        "Close-up",
        "Thin lines join the tip with the reference at the same moment.",
        lambda run: None if run.tip is None else close_up_figure(run.tip),
    ),
    (
        "Error over time",
        "Distance between filtered tip and reference. Figures at the top are numbers of cycles.",
        error_figure,
    ),
    ("Actuators", "As told by the drives at the moment of each tracker frame.", actuator_figure),
    ("Forces", "Estimated from the drives' torques.", force_figure),
    (
        "Risk and permission",
        "What the gate was told about each step, and which share of it was let through.",
        risk_figure,
    ),
    (
        "Planned paths",
        "Above: where they lead the tip, and where it went. Below: how likely a body touches at "
        "each place, as planned, and what was told of the rest of the path while it was gone.",
        plans_figure,
    ),
    (
        "The body and what is near",
        "Dots joined: the components of the mixture over the body, at some moments, and blue where "
        "there was least room. Grey: places of the surface that were nearest at some moment.",
        lambda run: None if run.risk is None else body_figure(run.risk),
    ),
    ("Timing", "Lateness and lengths are figures of one second each.", timing_figure),
)


def write_report(path: Path, out: Path | None = None) -> Path:
    """Write the report of a run (its folder, or its recording). Returns where it is.

    out: None means the run's folder. Raises UnreadableRunError, OSError.
    """
    run = read_run(path)
    target = run.path.parent / REPORT_FILE if out is None else out
    target.write_text(report_html(run), encoding="utf-8")
    return target


def report_html(
    run: RunData,
    draw: Callable[[Callable[[int], str], int], list[str]] = one_after_the_other,
) -> str:
    """The whole page. draw: carries out the drawing of so many figures, each by its place."""
    title = escape(_title(run))
    parts = [
        _header(run),
        *(f'<div class="notice">{escape(text)}</div>' for text in _notices(run)),
        _tiles(run),
        _section("Tip error by cycle", _error_tables(run)),
        *draw(lambda place: _figure(run, place), len(_FIGURES)),
        _section("What was planned", plans_table(run.plans)) if run.plans else "",
        _events(run),
        _internal_errors(run),
        _provenance(run),
    ]
    body = "\n".join(filter(None, parts))
    return (
        f'<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{title}</title>\n<style>\n{PAGE_STYLE}</style></head>\n"
        f"<body><main>\n{body}\n</main></body></html>\n"
    )


def _title(run: RunData) -> str:
    followed = run.result or (run.status.reference if run.status is not None else None)
    robot = _robot(run)
    return f"{robot}: {followed.trajectory}" if followed and followed.trajectory else robot


def _robot(run: RunData) -> str:
    if run.status is not None:
        return run.status.robot
    return run.header.get("robot", run.path.parent.name)


def _header(run: RunData) -> str:
    simulated = _simulated(run)
    badges = []
    if simulated is not None:
        badges.append(_badge("SIMULATED", "warning") if simulated else _badge("HARDWARE", ""))
    state = run.states[-1][1] if run.states else ""
    if state:
        badges.append(_badge(f"ended in {state.upper()}", _STATE_LOOKS.get(state, "")))
    followed = run.result or (run.status.reference if run.status is not None else None)
    controller = f"controller {followed.controller}" if followed and followed.controller else ""
    about = [
        VIRTUAL_TIME
        if run.in_virtual_time
        else utc_text(run.started_ns).replace("T", " ").replace("Z", " UTC")
    ]
    about += [f"{run.duration_s:.1f} s", controller]
    return (
        f"<header><h1>{escape(_title(run))}{''.join(badges)}</h1>"
        f'<div class="about">{escape(" · ".join(filter(None, about)))}</div></header>'
    )


def _simulated(run: RunData) -> bool | None:
    if run.status is not None:
        return run.status.simulated
    return None if run.result is None else run.result.simulated


def _badge(text: str, look: str) -> str:
    return f' <span class="badge {look}">{escape(text)}</span>'


def _notices(run: RunData) -> list[str]:
    """What a reader must know before believing the rest."""
    notices = []
    if not run.whole:
        notices.append(
            "This recording was not ended properly: what came last is missing. "
            "`tentacled recover` makes unfinished recordings whole."
        )
    notices += [
        f"The recorder was lost and started again: what happened from {gap.from_s:.1f} to "
        f"{gap.to_s:.1f} s, between {gap.before} and {gap.after}, was not recorded."
        for gap in run.gaps
    ]
    if run.one_of_more:
        notices.append("This is one of several recordings of its run: its folder shows all.")
    if run.dropped:
        notices.append(f"{run.dropped} messages were dropped while recording.")
    if run.unreadable:
        notices.append(f"{run.unreadable} parts of the recording could not be read.")
    missing = [
        name
        for name, part in (
            ("tip", run.tip),
            ("axes", run.axes),
            ("risk", run.risk),
            ("loop", run.loop),
        )
        if part is None
    ]
    if missing:
        notices.append(f"Not in this recording: {', '.join(missing)}.")
    return notices


def _tiles(run: RunData) -> str:
    tiles = []
    if run.cycles:
        last = run.cycles[-1]
        tiles.append((f"{last.mean_mm:.2f} mm", f"mean error, cycle {last.cycle + 1} (last)"))
        tiles.append((f"{max(row.max_mm for row in run.cycles):.2f} mm", "largest error"))
    if run.result is not None:
        tiles.append((f"{run.result.steps}", "control steps"))
        tiles.append((f"{run.result.holds}", "times held"))
        tiles.append((f"{run.result.refusals}", "steps refused"))
    elif run.tip is not None:
        tiles.append((f"{len(run.tip.t_s)}", "control steps"))
        tiles.append((f"{sum(state == 'hold' for _, state in run.states)}", "times held"))
    status = run.result.timing if run.result is not None else None
    if status is None and run.status is not None:
        status = run.status.loop
    if status is not None and not run.in_virtual_time:
        tiles.append((f"{status.step_p99_s * 1e3:.2f} ms", "frame to targets, p99"))
        tiles.append((f"{status.missed}", "bus cycles missed"))
    inner = "".join(
        f'<div class="tile"><b>{escape(value)}</b><span>{escape(name)}</span></div>'
        for value, name in tiles
    )
    return f'<div class="tiles">{inner}</div>' if inner else ""


# The tip's error by cycle: as the loop saw it, and as is known afterwards.
#
# A loop acts on a filtered tip, and its table is what papers give. Where the tip really was, the
# emulation knows; on a rig all measurements together tell it best, those that came later too. That
# second table shows whether the first one is the tracker's noise, or the robot.


def _error_tables(run: RunData) -> str:
    """HTML."""
    if not run.cycles:
        return "<p>No cycle was followed.</p>"
    note = (
        "Euclidean distance between filtered tip and reference, while following: what the loop "
        "saw. Bars show the mean."
    )
    cycles, other_note = _known_afterwards(run)
    return _table(run.cycles, note) + (_table(cycles, other_note) if cycles else "") + _poses(run)


def _poses(run: RunData) -> str:
    """HTML: by coordinate, where the tip had to point somewhere. Lengths and angles apart."""
    if run.result is None or not any(row.angle_rad for row in run.result.tip_pose):
        return ""
    shown = [("filtered", run.result.tip_pose), ("true", run.result.true_pose)]
    rows = "".join(
        f'<tr><td>{whose}</td><td class="number">{row.cycle + 1}</td>'
        f'<td class="number">{row.x_mm:.3f}</td><td class="number">{row.y_mm:.3f}</td>'
        f'<td class="number">{row.z_mm:.3f}</td>'
        f'<td class="number">{_in_degrees(row.angle_rad)}</td></tr>'
        for whose, poses in shown
        for row in poses
    )
    head = "".join(f'<th class="number">{name}</th>' for name in _POSE_HEADS)
    note = (
        "Root mean squares by coordinate, and of the angle between the tip's direction and where "
        "it was to point."
    )
    return f'<table><tr><th>tip</th>{head}</tr>{rows}</table><div class="note">{escape(note)}</div>'


def _in_degrees(angle_rad: float | None) -> str:
    return "–" if angle_rad is None else f"{degrees(angle_rad):.2f}"


def _known_afterwards(run: RunData) -> tuple[list[CycleError], str]:
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
    return _rows_by_cycle(tip["cycle"][seen][counts], away_mm[counts])


def _rows_by_cycle(cycle: Array, away_mm: Array) -> list[CycleError]:
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
        f'<td class="bar">{_bar(row.mean_mm / worst)}</td></tr>'
        for row in cycles
    )
    head = "".join(f'<th class="number">{name}</th>' for name in _HEADS)
    return f'<table><tr>{head}<th></th></tr>{rows}</table><div class="note">{escape(note)}</div>'


def _bar(share: float) -> str:
    """A drawing and no style: whoever serves a report may forbid styles that stand in elements."""
    return (
        '<svg viewBox="0 0 100 1" preserveAspectRatio="none">'
        f'<rect width="{100 * share:.1f}" height="1"/></svg>'
    )


def _figure(run: RunData, place: int) -> str:
    """One of _FIGURES; empty where the run has nothing to be drawn in it."""
    title, caption, make = _FIGURES[place]
    with styled():
        made = make(run)
        if made is None:
            return ""
        picture = as_data_uri(made)
    return _section(
        title,
        f'<figure><img alt="{escape(title)}" src="{picture}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>",
    )


def _events(run: RunData) -> str:
    if not run.events:
        return _section("Events", "<p>Nothing was told.</p>")
    rows = "".join(_event_row(t_s, event) for t_s, event in run.events[:_EVENTS_AT_MOST])
    more = len(run.events) - _EVENTS_AT_MOST
    note = f'<div class="note">and {more} more in the recording</div>' if more > 0 else ""
    head = "".join(f"<th>{name}</th>" for name in ("kind", "what", "about", "text"))
    return _section(
        "Events", f'<table><tr><th class="number">t / s</th>{head}</tr>{rows}</table>{note}'
    )


def _event_row(t_s: float, event: Event) -> str:
    if event.kind == "state":
        look = f"state {_STATE_LOOKS.get(event.name.lower(), '')}"
    else:
        look = _SEVERITY_LOOKS.get(event.severity.lower(), "") if event.present else ""
    name = event.name if event.present else f"{event.name} (over)"
    text = f"{event.text}{detail_of(event.text, event.detail)}"
    cells = (event.kind, name, event.subject, text)
    text = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    return f'<tr class="{look}"><td class="number">{t_s:.2f}</td>{text}</tr>'


def _internal_errors(run: RunData) -> str:
    """For whoever mends them; empty: there were none."""
    if not run.internal_errors:
        return ""
    listed = "".join(
        f"<p>{t_s:.2f} s, {escape(error.place)}: {escape(error.text)}"
        f"{f' (and {error.kept_back} times more before)' if error.kept_back else ''}</p>"
        f"<pre>{escape(error.traceback)}</pre>"
        for t_s, error in run.internal_errors
    )
    return _section("Internal errors", listed)


def _provenance(run: RunData) -> str:
    facts: list[tuple[str, str]] = [("recording", ", ".join(run.files))]
    facts += [(name, value) for name, value in run.header.items() if name != "wall_offset_ns"]
    if run.provenance is not None:
        facts += _provenance_facts(run)
    if run.result is not None and run.result.control_sha256:
        facts.append(("control channels", run.result.control_sha256))
    counts = ", ".join(f"{topic} {count}" for topic, count in run.counts.items())
    facts.append(("messages", counts))
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in facts
    )
    robot = ""
    if run.robot_yaml:
        robot = (
            f"<details><summary>Robot file</summary><pre>{escape(run.robot_yaml)}</pre></details>"
        )
    return _section("Provenance", f'<table class="facts">{rows}</table>{robot}')


def _provenance_facts(run: RunData) -> Sequence[tuple[str, str]]:
    provenance = run.provenance
    assert provenance is not None
    commit = provenance.commit or "not from a checkout"
    packages = [f"{name} {text}" for name, text in provenance.packages.items()]
    return [
        ("tentacled", provenance.version),
        ("commit", f"{commit}{' with changes' if provenance.modified else ''}"),
        ("python", f"{provenance.python} on {provenance.system}"),
        ("packages", ", ".join(packages)),
        ("seed", "none" if provenance.seed is None else str(provenance.seed)),
        ("robot file (SHA-256)", provenance.config_sha256),
        *((f"model {name} (SHA-256)", text) for name, text in provenance.models_sha256.items()),
    ]


def _section(title: str, content: str) -> str:
    return f"<section><h2>{escape(title)}</h2>\n{content}\n</section>"
