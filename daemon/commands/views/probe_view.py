"""The live page of `tentacled probe`."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

from rich.console import RenderableType
from rich.text import Text

from daemon.commands.views.page import BAD, DIM, GOOD, Size, cut, grid, page, paragraph, table
from daemon.remote.reason_groups import detail_of

Json = Mapping[str, Any]

_FEW_EVENTS: Final = 2
"""So many are shown where there is little room."""
_TROUBLE: Final = {
    "crc_errors": "CRC errors",
    "strays": "replies to nothing",
    "timeouts": "replies missing",
    "reconnects": "reconnections",
    "resets": "resets",
}
"""Counters of the tracker's line that stay at 0 where it is sound, and how they are called."""


def view(state: Json, events: Sequence[Json], size: Size | None = None) -> RenderableType:
    """Tracker, drives, buses, what is wrong, and what happened last.

    size: of the page; what matters least goes where that is not enough.
    """
    room = Size(80) if size is None else size
    head = [*_headline(state, room), *_tools(state["tracker"], room)]
    axes, buses = _axes(state["axes"], room), _buses(state["buses"], room)
    axes_briefly = _axes_briefly(state["axes"], room)
    conditions = state["conditions"]
    wrong, last = _conditions(conditions, room), _events(events, room)
    few = last[-_FEW_EVENTS:]
    kinds = [
        [*head, *axes, *buses, *wrong, *last],
        [*head, *axes, *buses, *wrong, *few],
        [*head, *axes_briefly, *buses, *wrong, *few],
    ]
    for remedies in range(len(conditions) - 1, 0, -1):
        fewer = _conditions(conditions, room, remedies)
        kinds.append([*head, *axes_briefly, *buses, *fewer, *few])
    kinds.append([*head, *_conditions(conditions, room, 1), *axes_briefly, *buses])
    return page(room, kinds)


def event_line(event: Json) -> str:
    """One thing that came or went, on one line."""
    came = "+" if event["present"] else "-"
    detail = f": {event['detail']}" if event["detail"] and event["present"] else ""
    return f"{event['t_s']:8.3f} s {came} {event['subject']} {event['name']}{detail}"


def _headline(state: Json, size: Size) -> list[Text]:
    tracker = state["tracker"]
    first = Text(state["robot"], style="bold")
    first.append(f"   {state['t_s']:.1f} s   tracker ", style="not bold")
    first.append(tracker["state"], style=GOOD if tracker["state"] == "tracking" else BAD)
    frames = f"{tracker['rate_hz']:.1f} frames/s" if tracker["rate_hz"] else "no frames"
    told = [f"{tracker['baud_rate']} baud", frames]
    if tracker["age_s"] is not None:
        told.append(f"newest {tracker['age_s'] * 1e3:.0f} ms old")
    if tracker["firmware"]:
        told.append(f"firmware {tracker['firmware']}, {tracker['control_unit']}")
    counted = [(tracker["counters"][name], words) for name, words in _TROUBLE.items()]
    told += [f"{count} {words}" for count, words in counted if count]
    return [first, *paragraph(size, (", ".join(told), DIM))]


def _tools(tracker: Json, size: Size) -> list[Text]:
    head = ("tool", "serial", "port", "status", "x mm", "y mm", "z mm", "indicator")
    rows: list[list[tuple[str, str]]] = []
    for tool in tracker["tools"]:
        indicator = tool["indicator"]
        rows.append(
            [
                (tool["role"] or "-", ""),
                (tool["serial"], ""),
                (f"{tool['port']}.{tool['channel']}", ""),
                _marked(tool["status"], tool["status"] == "valid"),
                *_place(tool["position_mm"]),
                ("" if indicator is None else f"{indicator:.2f}", ""),
            ]
        )
    if tracker["tip_mm"] is not None:
        nothing = ("", "")
        rows.append([("tip in base", ""), *[nothing] * 3, *_place(tracker["tip_mm"]), nothing])
    return table(head, rows, (4, 5, 6, 7), width=size.row_width)


def _place(place_mm: Sequence[float] | None) -> list[tuple[str, str]]:
    if place_mm is None:
        return [("", "")] * 3
    return [(f"{value:.2f}", "") for value in place_mm]


def _axes(axes: Sequence[Json], size: Size) -> list[Text]:
    head = ["axis", "node", "drive is", "position", "volume mL", "torque %"]
    rows = [
        [
            (axis["name"], ""),
            (f"{axis['node']}.{axis['axis']}", ""),
            _drive(axis),
            ("" if axis["position"] is None else f"{axis['position']:.3f} {axis['unit']}", ""),
            ("" if axis["volume_ml"] is None else f"{axis['volume_ml']:.3f}", ""),
            ("" if axis["torque_percent"] is None else f"{axis['torque_percent']:.1f}", ""),
        ]
        for axis in axes
    ]
    if all(axis["volume_ml"] is None for axis in axes):
        head, rows = [*head[:4], head[5]], [[*row[:4], row[5]] for row in rows]
    return table(head, rows, (3, 4, 5), width=size.row_width)


def _drive(axis: Json) -> tuple[str, str]:
    """What its node is, until that is operational: a drive behind another one says nothing."""
    if axis["node_state"] != "operational":
        return axis["node_state"], BAD
    return axis["drive_state"], GOOD


def _axes_briefly(axes: Sequence[Json], size: Size) -> list[Text]:
    """Which drives are in which state, and where they are."""
    drives: dict[str, list[str]] = {}
    for axis in axes:
        drives.setdefault(_drive(axis)[0], []).append(axis["name"])
    lines = []
    for state, names in drives.items():
        who = "all drives" if len(names) == len(axes) else ", ".join(names)
        lines += paragraph(size, (f"{who}: {state}", DIM))
    known = [axis for axis in axes if axis["position"] is not None]
    cells = [f"{axis['name']} {axis['position']:.2f} {axis['unit']}" for axis in known]
    return lines + grid(cells, size.width)


def _buses(buses: Mapping[str, Json], size: Size) -> list[Text]:
    head = ("bus", "interface", "link", "cycle", "load", "sent", "received", "refused")
    rows = [
        [
            (name, ""),
            (bus["interface"], ""),
            _marked("open" if bus["connected"] else "closed", bus["connected"]),
            (f"{bus['cycle_hz']:g} Hz", ""),
            (f"{bus['load']:.1%}", ""),
            (str(bus["sent"]), ""),
            (str(bus["received"]), ""),
            (str(bus["refused"]), ""),
        ]
        for name, bus in buses.items()
    ]
    return table(head, rows, (4, 5, 6, 7), width=size.row_width)


def _conditions(conditions: Sequence[Json], size: Size, remedies: int | None = None) -> list[Text]:
    """Each with what it means and what helps. The same about others is told once.

    remedies: of the first ones alone, and one line for each of the others.
    """
    if not conditions:
        return [Text("nothing is wrong", style=GOOD)]
    lines = []
    for place, ((text, remedy), alike) in enumerate(_alike(conditions).items()):
        what = f"{_subjects(alike)}: {text}"
        if remedies is not None and place >= remedies:
            lines.append(Text(cut(what, size.row_width), style=BAD))
            continue
        detail = alike[0]["detail"] if len(alike) == 1 else ""
        lines += paragraph(size, (what, BAD), (detail_of(text, detail), ""))
        lines += paragraph(size, (remedy, DIM), first=4)
    return lines


def _alike(conditions: Sequence[Json]) -> dict[tuple[str, str], list[Json]]:
    """In the order in which they came, by text and remedy."""
    found: dict[tuple[str, str], list[Json]] = {}
    for condition in conditions:
        found.setdefault((condition["text"], condition["remedy"]), []).append(condition)
    return found


def _subjects(conditions: Sequence[Json]) -> str:
    return ", ".join(dict.fromkeys(condition["subject"] for condition in conditions))


def _events(events: Sequence[Json], size: Size) -> list[Text]:
    return [Text(cut(event_line(event), size.row_width), style=DIM) for event in events]


def _marked(text: str, good: bool) -> tuple[str, str]:
    return text, GOOD if good else BAD
