"""The status for people: what state, why, and what the robot does."""

from collections.abc import Sequence
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from daemon.messages import AxisStatus, Reason, Status
from daemon.remote.reason_groups import ReasonGroup, grouped, subjects

_DIM: Final = "dim"
_BAD: Final = "bold red"
_GOOD: Final = "green"
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


def status_view(status: Status) -> RenderableType:
    """The whole robot."""
    parts: list[RenderableType] = [_banner(status)]
    parts += [_group(group) for group in grouped(status.reasons)]
    parts += [_over(group) for group in grouped(_no_more(status))]
    parts += [_figures(status), _axes(status.axes)]
    return Group(*parts)


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
    text.append(f"  tentacled {status.version}", style=_DIM)
    return text


def _group(group: ReasonGroup) -> Text:
    reason = group.lead
    text = Text(f"{group.subjects}: {reason.text}", style=_BAD)
    if reason.detail:
        text.append(f" ({reason.detail})")
    text.append(f"  {reason.severity}, {_since(reason)}", style=_DIM)
    text.append(f"\n    {reason.remedy}", style=_DIM)
    for alike in group.follow.values():
        text.append(f"\n    from that: {subjects(alike)}: {alike[0].text}", style="default")
    return text


def _since(reason: Reason) -> str:
    if reason.over:
        return "over"
    return "over, waits for `tentacled clear`" if reason.latched else f"{reason.since_s:.1f} s"


def _no_more(status: Status) -> list[Reason]:
    """What has stopped the robot, and is over."""
    still = {(reason.name, reason.subject) for reason in status.reasons}
    return [why for why in status.stopped_by if (why.name, why.subject) not in still]


def _over(group: ReasonGroup) -> Text:
    reason = group.lead
    text = Text(f"stopped by {group.subjects}: {reason.text}")
    if reason.detail:
        text.append(f" ({reason.detail})")
    text.append(f"  {reason.severity}, over, began {reason.since_s:.1f} s ago", style=_DIM)
    text.append(f"\n    {reason.remedy}", style=_DIM)
    return text


def _figures(status: Status) -> Table:
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style=_DIM)
    table.add_column()
    table.add_row("tip", _vector(status.tip_mm))
    table.add_row("reference", _vector(status.reference_mm))
    table.add_row("error", "-" if status.error_mm is None else f"{status.error_mm:.2f} mm")
    table.add_row("following", _following(status))
    table.add_row("tracker", _tracker(status))
    table.add_row("risk", _risk(status))
    table.add_row("loop", _loop(status))
    table.add_row("lease", _lease(status))
    table.add_row("recording", status.recording or "none")
    return table


def _vector(values: Sequence[float] | None) -> str:
    return "-" if values is None else "  ".join(f"{value:8.2f}" for value in values) + "  mm"


def _following(status: Status) -> str:
    reference = status.reference
    if reference is None:
        return "nothing"
    cycles = "" if reference.cycles is None else f" of {reference.cycles}"
    cycle = "on the way to its start" if reference.cycle < 0 else f"cycle {reference.cycle + 1}"
    duration = "" if reference.duration_s is None else f" of {reference.duration_s:.1f}"
    return (
        f"{reference.trajectory}, {reference.controller}: {cycle}"
        f"{cycles if reference.cycle >= 0 else ''}, {reference.elapsed_s:.1f}{duration} s"
    )


def _tracker(status: Status) -> Text:
    tracker = status.tracker
    text = Text(tracker.state, style=_GOOD if tracker.state == "tracking" else _BAD)
    text.append(f", {tracker.rate_hz:.1f} frames/s, {tracker.quality:.0%} good", style="default")
    if tracker.age_s is not None:
        text.append(f", {_ms(tracker.age_s)} old", style="default")
    if tracker.latency_s is not None:
        text.append(f", {_ms(tracker.latency_s)} on its way", style="default")
    return text


def _risk(status: Status) -> str:
    risk = status.risk
    contact = "unknown" if risk.contact_risk is None else f"{risk.contact_risk:.4f}"
    body = "" if risk.body_point_risk is None else f", of a body point {risk.body_point_risk:.4f}"
    detail = f", {risk.detail}" if risk.detail else ""
    return (
        f"contact {contact} (most {risk.threshold:g}){body}, {risk.scale:.0%} let through, "
        f"by {risk.source}{detail}"
    )


def _loop(status: Status) -> str:
    loop = status.loop
    overrun = f", last late for {loop.last_overrun}" if loop.last_overrun else ""
    real_time = f", {loop.real_time}" if loop.real_time else ""
    return (
        f"{loop.rate_hz:.1f} steps/s, {loop.cycle_rate_hz:.0f} cycles/s, late by "
        f"{_ms(loop.lateness_p50_s)} (p99 {_ms(loop.lateness_p99_s)}), step "
        f"{_ms(loop.step_p50_s)} (p99 {_ms(loop.step_p99_s)}), {loop.missed} missed"
        f"{overrun}{real_time}"
    )


def _lease(status: Status) -> str:
    lease = status.lease
    if lease.holder is None:
        return "free"
    left = "" if lease.expires_in_s is None else f", {lease.expires_in_s:.1f} s left"
    return f"{lease.holder}{left}"


def _axes(axes: Sequence[AxisStatus]) -> Table:
    table = Table(box=None, pad_edge=False, header_style=_DIM, padding=(0, 2, 0, 0))
    for column in ("axis", "node is", "drive is"):
        table.add_column(column, no_wrap=True)
    for column in ("actual", "target", "force", "volume"):
        table.add_column(column, justify="right", no_wrap=True)
    for axis in axes:
        table.add_row(
            axis.name,
            Text(axis.node_state, style=_GOOD if axis.node_state == "operational" else _BAD),
            axis.drive_state,
            _number(axis.actual, 3, axis.unit),
            _number(axis.target, 3, axis.unit),
            _number(axis.force, 2, axis.force_unit),
            _number(axis.volume_ml, 3, "mL"),
        )
    return table


def _number(value: float | None, digits: int, unit: str) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.2f} ms" if seconds < 0.01 else f"{seconds * 1e3:.0f} ms"
