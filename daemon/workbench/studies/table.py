"""A table of text, for a terminal and for a file that people read."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isinf

from rich.table import Table as RichTable
from rich.text import Text

from daemon.workbench.studies.summary import Spread


@dataclass
class Section:
    """Rows under a heading of their own. A row's first cell says what it is about."""

    heading: str
    rows: list[list[str]] = field(default_factory=list)


@dataclass
class Table:
    """Cells as they are shown."""

    title: str
    head: Sequence[str]
    sections: list[Section] = field(default_factory=list)
    note: str = ""

    def markdown(self) -> str:
        """For a file."""
        lines = [f"### {self.title}", "", _row(self.head)]
        lines.append(_row(["---", *["---:"] * (len(self.head) - 1)]))
        for section in self.sections:
            if section.heading:
                lines.append(_row([f"**{section.heading}**", *[""] * (len(self.head) - 1)]))
            lines += [_row(row) for row in section.rows]
        if self.note:
            lines += ["", self.note]
        return "\n".join(lines) + "\n"

    def rich(self) -> RichTable:
        """For a terminal."""
        table = RichTable(title=Text(self.title), title_justify="left", title_style="bold")
        for place, name in enumerate(self.head):
            table.add_column(Text(name), justify="right" if place else "left", overflow="fold")
        for section in self.sections:
            if section.heading:
                table.add_row(Text(section.heading, style="bold"))
            for place, row in enumerate(section.rows):
                last = place == len(section.rows) - 1
                table.add_row(*map(Text, row), end_section=last)
        return table


def number(value: float | None, digits: int = 2) -> str:
    """`0.62`; `∞` where a run did not come so far, `–` where there is nothing."""
    if value is None:
        return "–"
    return "∞" if isinf(value) else f"{value:.{digits}f}"


def median_of(value: Spread | None, digits: int = 2) -> str:
    """`0.62`"""
    return number(None if value is None else value.median, digits)


def range_of(value: Spread, digits: int = 2) -> str:
    """`0.55–0.80`: from the best run to the worst."""
    return f"{number(value.low, digits)}–{number(value.high, digits)}"


def ordinal(cycle: int) -> str:
    """`1st`, counted from 0 as cycles are."""
    count = cycle + 1
    ending = "th" if count % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(count % 10)
    return f"{count}{ending or 'th'}"


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
