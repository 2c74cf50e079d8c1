"""The report of a run: one HTML file with all figures and tables, and nothing from outside."""

from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from daemon.messages import Event
from daemon.recording.run_folder import REPORT_FILE, VIRTUAL_TIME, utc_text
from daemon.remote.reason_groups import detail_of
from daemon.workbench.report.report_body import body_figure
from daemon.workbench.report.report_data import RunData, read_run
from daemon.workbench.report.report_errors import error_tables
from daemon.workbench.report.report_looks import PAGE_STYLE
from daemon.workbench.report.report_paths import close_up_figure, path_figure
from daemon.workbench.report.report_series import (
    actuator_figure,
    error_figure,
    force_figure,
    risk_figure,
    timing_figure,
)
from daemon.workbench.report.report_style import as_data_uri, styled
from daemon.workbench.report.two_processes import one_after_the_other

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
        _section("Tip error by cycle", error_tables(run)),
        *draw(lambda place: _figure(run, place), len(_FIGURES)),
        _events(run),
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
