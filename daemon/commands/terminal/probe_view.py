"""The live table of `tentacled probe`."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

Json = Mapping[str, Any]

_GOOD, _BAD, _DIM = "green", "bold red", "dim"


def view(state: Json, events: Sequence[Json]) -> RenderableType:
    """Tracker, drives, buses, what is wrong, and what happened last."""
    return Group(
        _headline(state),
        _tools(state["tracker"]),
        _axes(state["axes"]),
        _buses(state["buses"]),
        _conditions(state["conditions"]),
        _events(events),
    )


def event_line(event: Json) -> str:
    """One thing that came or went, on one line."""
    came = "+" if event["present"] else "-"
    detail = f": {event['detail']}" if event["detail"] and event["present"] else ""
    return f"{event['t_s']:8.3f} s {came} {event['subject']} {event['name']}{detail}"


def _headline(state: Json) -> Text:
    tracker = state["tracker"]
    text = Text()
    text.append(f"{state['robot']}", style="bold")
    text.append(f"   {state['t_s']:.1f} s   tracker ")
    text.append(tracker["state"], style=_GOOD if tracker["state"] == "tracking" else _BAD)
    text.append(f" at {tracker['baud_rate']} baud, {tracker['rate_hz']:.1f} frames/s")
    if tracker["age_s"] is not None:
        text.append(f", newest {tracker['age_s'] * 1e3:.0f} ms old")
    if tracker["firmware"]:
        text.append(f"   firmware {tracker['firmware']}, {tracker['control_unit']}", style=_DIM)
    return text


def _tools(tracker: Json) -> Table:
    table = _table("tool", "serial", "port", "status", "x mm", "y mm", "z mm", "indicator")
    for tool in tracker["tools"]:
        place = tool["position_mm"] or ["", "", ""]
        table.add_row(
            tool["role"] or "-",
            tool["serial"],
            f"{tool['port']}.{tool['channel']}",
            _marked(tool["status"], tool["status"] == "valid"),
            *(f"{value:9.2f}" if value != "" else "" for value in place),
            "" if tool["indicator"] is None else f"{tool['indicator']:.2f}",
        )
    tip = tracker["tip_mm"]
    if tip is not None:
        table.add_row(
            "tip in base", "", "", "", *(f"{value:9.2f}" for value in tip), "", style="bold"
        )
    return table


def _axes(axes: Sequence[Json]) -> Table:
    table = _table("axis", "node", "node is", "drive is", "position", "volume mL", "torque %")
    for axis in axes:
        position, volume, torque = axis["position"], axis["volume_ml"], axis["torque_percent"]
        table.add_row(
            axis["name"],
            f"{axis['node']}.{axis['axis']}",
            _marked(axis["node_state"], axis["node_state"] == "operational"),
            axis["drive_state"],
            "" if position is None else f"{position:9.3f} {axis['unit']}",
            "" if volume is None else f"{volume:8.3f}",
            "" if torque is None else f"{torque:6.1f}",
        )
    return table


def _buses(buses: Mapping[str, Json]) -> Table:
    table = _table("bus", "interface", "link", "cycle", "load", "sent", "received", "refused")
    for name, bus in buses.items():
        table.add_row(
            name,
            bus["interface"],
            _marked("open" if bus["connected"] else "closed", bus["connected"]),
            f"{bus['cycle_hz']:g} Hz",
            f"{bus['load']:.1%}",
            str(bus["sent"]),
            str(bus["received"]),
            str(bus["refused"]),
        )
    return table


def _conditions(conditions: Sequence[Json]) -> RenderableType:
    if not conditions:
        return Text("nothing is wrong", style=_GOOD)
    lines = Text()
    for condition in conditions:
        lines.append(f"{condition['subject']}: {condition['text']}", style=_BAD)
        if condition["detail"]:
            lines.append(f" ({condition['detail']})")
        lines.append(f"\n    {condition['remedy']}\n", style=_DIM)
    return lines


def _events(events: Sequence[Json]) -> Text:
    return Text("\n".join(event_line(event) for event in events), style=_DIM)


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, header_style=_DIM, padding=(0, 2, 0, 0))
    numbers = {"x mm", "y mm", "z mm", "position", "volume mL", "torque %", "indicator"}
    for column in columns:
        table.add_column(column, justify="right" if column in numbers else "left", no_wrap=True)
    return table


def _marked(text: str, good: bool) -> Text:
    return Text(text, style=_GOOD if good else _BAD)
