"""The status for people: what state, why, and what the robot does, on one page."""

from collections.abc import Sequence
from math import degrees
from typing import Final

from rich.console import RenderableType
from rich.text import Text

from daemon.commands.views.page import BAD, DIM, GOOD, Size, cut, grid, page, paragraph, table
from daemon.messages import AxisStatus, Reason, RiskStatus, Status
from daemon.remote.reason_groups import ReasonGroup, detail_of, grouped, subjects
from safety.risk_source import NoModel

_BANNER: Final = {
    "STANDBY": "black on white",
    "READY": "black on green",
    "ARMED": "black on yellow",
    "RUNNING": "white on blue",
    "HOLD": "black on yellow",
    "HOMING": "white on blue",
    "FAULT": "white on red",
    "ESTOP": "white on red",
}
NO_MODEL: Final = NoModel().name
_LABEL: Final = 11
"""Columns for what a line is about."""
_FEW: Final = 3
"""So many causes are told where there is little room; the others are named."""


def status_view(status: Status, size: Size | None = None) -> RenderableType:
    """The whole robot. size: of the page; what matters least goes where that is not enough."""
    room = Size(80) if size is None else size

    banner, causes = _banner(status), _causes(status, room)
    few_causes = _causes(status, room, brief=True)
    figures, few_figures = _figures(status, room), _figures(status, room, brief=True)
    axes, axes_briefly = _axes(status.axes, room), _axes_briefly(status.axes, room)
    return page(
        room,
        (
            [banner, *causes, *figures, *axes],
            [banner, *causes, *few_figures, *axes],
            [banner, *causes, *few_figures, *axes_briefly],
            [banner, *few_causes, *few_figures, *axes_briefly],
        ),
    )


def gone_view(last: Status | None, why: str, since_s: float) -> RenderableType:
    """No status comes any more: nothing that was shown before may be taken for the present."""
    known = "" if last is None else f"; it was {last.state}"
    return Text(f" NO DATA for {since_s:.1f} s: {why}{known} ", style="bold white on red")


def _banner(status: Status) -> Text:
    text = Text()
    style = _BANNER.get(status.state.upper(), "reverse")
    text.append(f"  {status.state.upper()}  ", style=f"bold {style}")
    text.append(f"  {status.robot}", style="bold")
    if status.simulated:
        text.append("  SIMULATED", style="bold magenta")
    text.append(f"  tentacled {status.version}", style=DIM)
    return text


def _causes(status: Status, size: Size, *, brief: bool = False) -> list[Text]:
    """What is wrong, and what has stopped the robot and is over. brief: remedies of the first one,
    and no more than a few."""
    told = [(group, False) for group in grouped(status.reasons)]
    told += [(group, True) for group in grouped(_no_more(status))]
    lines = []
    for place, (group, over) in enumerate(told[: _FEW if brief else None]):
        lines += _group(group, size, over=over, brief=brief and place > 0)
    more = [group.lead.text for group, _ in told[_FEW:]] if brief else []
    if more:
        text = f"and {len(more)} more: {'; '.join(more)}"
        lines.append(Text(cut(text, size.row_width), style=BAD))
    return lines


def _group(group: ReasonGroup, size: Size, *, over: bool, brief: bool) -> list[Text]:
    reason = group.lead
    what = f"{'stopped by ' if over else ''}{group.subjects}: {reason.text}"
    detail = detail_of(reason.text, reason.detail)
    when = f"over, began {reason.since_s:.1f} s ago" if over else _since(reason)
    spans = ((what, "" if over else BAD), (detail, ""), (f"  {reason.severity}, {when}", DIM))
    if brief:
        line = Text().append(cut(what, size.row_width), style="" if over else BAD)
        return [line]
    lines = paragraph(size, *spans)
    lines += paragraph(size, (reason.remedy, DIM), first=4)
    for alike in () if over else group.follow.values():
        text = f"from that: {subjects(alike)}: {alike[0].text}"
        lines += paragraph(size, (text, "default"), first=4, indent=6)
    return lines


def _since(reason: Reason) -> str:
    if reason.over:
        return "over"
    return "over, waits for `tentacled clear`" if reason.latched else f"{reason.since_s:.1f} s"


def _no_more(status: Status) -> list[Reason]:
    """What has stopped the robot, and is over."""
    still = {(reason.name, reason.subject) for reason in status.reasons}
    return [why for why in status.stopped_by if (why.name, why.subject) not in still]


def _figures(status: Status, size: Size, *, brief: bool = False) -> list[Text]:
    """One line each, as long as there is room. brief: the fewest lines, and details left out."""
    error = "-" if status.error_mm is None else f"{status.error_mm:.2f} mm"
    if status.expected_mm is not None:
        error += f", about {status.expected_mm:.1f} mm expected"
    if status.error_rad is not None:
        error += f", {degrees(status.error_rad):.2f}°"
    tip, reference = _vector(status.tip_mm), _vector(status.reference_mm)
    rows: list[tuple[str, str, str]] = [("tip", tip, ""), ("reference", reference, "")]
    if brief:
        rows = [("tip", f"{tip}    error {error}", "")]
    else:
        rows.append(("error", error, ""))
    rows += [
        ("following", _following(status), ""),
        ("tracker", _tracker(status), GOOD if _frames_come(status) else BAD),
        ("risk", _risk(status.risk), ""),
        ("loop", _loop(status), ""),
    ]
    if not brief:
        loop = status.loop
        late = f"missed last: {loop.last_overrun}" if loop.last_overrun else ""
        more = "; ".join(filter(None, (late, loop.real_time)))
        rows += [("", more, DIM)] if more else []
        rows += [("", status.risk.detail, DIM)] if _has_detail(status.risk) else []
    lease = _lease(status)
    recording = status.recording or "none"
    if brief:
        left = size.width - _LABEL - len(lease) - len("; recording ")
        rows.append(("lease", f"{lease}; recording {cut(recording, max(left, 2), tail=True)}", ""))
    else:
        rows += [("lease", lease, ""), ("recording", recording, "")]
    return [line for row in rows for line in _row(*row, size, brief)]


def _row(label: str, value: str, style: str, size: Size, brief: bool) -> list[Text]:
    room = size.row_width - _LABEL
    if label == "recording" or brief:
        value = cut(value, room, tail=label == "recording")
    head = label.ljust(_LABEL)
    first, _, rest = value.partition(",")  # only what it is has a colour
    spans = ((first, style), (f",{rest}" if rest else "", ""))
    lines = paragraph(size, *spans, first=_LABEL, indent=_LABEL)
    if lines:
        lines[0] = Text(head, style=DIM) + lines[0][_LABEL:]
    return lines


def _vector(values: Sequence[float] | None) -> str:
    return "-" if values is None else "  ".join(f"{value:8.2f}" for value in values) + "  mm"


def _following(status: Status) -> str:
    reference = status.reference
    if reference is None:
        return "nothing"
    if reference.note:
        return f"{reference.trajectory}, {reference.controller}: {reference.note}"
    cycles = "" if reference.cycles is None else f" of {reference.cycles}"
    cycle = "on the way to its start" if reference.cycle < 0 else f"cycle {reference.cycle + 1}"
    duration = "" if reference.duration_s is None else f" of {reference.duration_s:.1f}"
    slowed = "" if reference.pace >= 1.0 else f", slowed to {reference.pace:.0%}"
    return (
        f"{reference.trajectory}, {reference.controller}: {cycle}"
        f"{cycles if reference.cycle >= 0 else ''}, {reference.elapsed_s:.1f}{duration} s{slowed}"
    )


def _frames_come(status: Status) -> bool:
    """A tracker that is closed has brought some of late, perhaps, and brings none any more."""
    return status.tracker.state == "tracking" and status.tracker.rate_hz > 0.0


def _tracker(status: Status) -> str:
    tracker = status.tracker
    if not _frames_come(status):
        why = "silent" if tracker.state == "tracking" else tracker.state
        last = "" if tracker.age_s is None else f", the newest tip {_time(tracker.age_s)} old"
        return f"no frames: it is {why}{last}"
    told = [tracker.state, f"{tracker.rate_hz:.1f} frames/s", f"{tracker.quality:.0%} good"]
    if tracker.age_s is not None:
        told.append(f"{_time(tracker.age_s)} old")
    if tracker.latency_s is not None:
        told.append(f"{_time(tracker.latency_s)} on its way")
    return ", ".join(told)


def _has_detail(risk: RiskStatus) -> bool:
    return bool(risk.detail) and risk.source != NO_MODEL


def _risk(risk: RiskStatus) -> str:
    through = f"{risk.scale:.0%} of the step let through"
    if risk.source == NO_MODEL:
        return f"no model of what the body may touch; {through}"
    contact = "unknown" if risk.contact_risk is None else f"{risk.contact_risk:.4f}"
    body = "" if risk.body_point_risk is None else f", of a body point {risk.body_point_risk:.4f}"
    return f"contact {contact} (most {risk.threshold:g}){body}, {through}, by {risk.source}"


def _loop(status: Status) -> str:
    loop = status.loop
    return (
        f"{loop.rate_hz:.1f} steps/s, {loop.cycle_rate_hz:.0f} cycles/s, {loop.missed} missed, "
        f"late {loop.lateness_p99_s * 1e3:.3g}, step {loop.step_p99_s * 1e3:.3g} ms (p99)"
    )


def _lease(status: Status) -> str:
    lease = status.lease
    if lease.holder is None:
        return "free"
    left = "" if lease.expires_in_s is None else f", {lease.expires_in_s:.1f} s left"
    return f"{lease.holder}{left}"


def _axes(axes: Sequence[AxisStatus], size: Size) -> list[Text]:
    """A line for each."""
    head = ["axis", "drive is", "actual", "target", "", "force", "volume"]
    rows = [
        [
            (axis.name, ""),
            _drive(axis),
            (_number(axis.actual, 3), ""),
            (_number(axis.target, 3), ""),
            (axis.unit, ""),
            (_with_unit(axis.force, 2, axis.force_unit), ""),
            (_with_unit(axis.volume_ml, 3, "mL"), ""),
        ]
        for axis in axes
    ]
    if all(axis.volume_ml is None for axis in axes):
        head, rows = head[:-1], [row[:-1] for row in rows]
    return table(head, rows, (2, 3, 5, 6), width=size.row_width)


def _drive(axis: AxisStatus) -> tuple[str, str]:
    """What its node is, until that is operational: a drive behind another one says nothing."""
    if axis.node_state != "operational":
        return axis.node_state, BAD
    return axis.drive_state, ""


def _axes_briefly(axes: Sequence[AxisStatus], size: Size) -> list[Text]:
    """What drives are, each state once; and where they are, side by side."""
    drives: dict[str, list[str]] = {}
    for axis in axes:
        drives.setdefault(_drive(axis)[0], []).append(axis.name)
    if len(drives) == 1:
        told = [f"all drives: {next(iter(drives))}"]
    else:
        told = [f"{', '.join(names)}: {state}" for state, names in drives.items()]
    lines = [line for text in told for line in paragraph(size, (text, DIM))]
    cells = [f"{axis.name} {_with_unit(axis.actual, 2, axis.unit)}" for axis in axes]
    return lines + grid(cells, size.width)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _with_unit(value: float | None, digits: int, unit: str) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"


def _time(seconds: float) -> str:
    if seconds >= 1.0:
        return f"{seconds:.1f} s"
    return f"{seconds * 1e3:.2f} ms" if seconds < 0.01 else f"{seconds * 1e3:.0f} ms"
