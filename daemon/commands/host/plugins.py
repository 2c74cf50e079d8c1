"""`tentacled plugins`: every kind that a file may name, where it comes from, and whether it works.

Each is imported, as it would be for a file that names it.
"""

import argparse
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table

from config.documents.kinds import API_VERSION, GROUPS, Entry, KindError, entries, kind_of, shadowed
from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result


@dataclass(frozen=True)
class _Row:
    group: str
    name: str
    source: str
    options: str
    """The first sentence of what its options are for."""
    problem: str
    """Why it cannot be used; empty: it can."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser


def run(arguments: argparse.Namespace) -> Result:
    del arguments
    rows = [row for group in GROUPS for row in _rows(group)]
    return Result(
        {"api_version": API_VERSION, "kinds": rows},
        lambda: _show(rows),
        EXIT_FAILED if any(row.problem for row in rows) else EXIT_OK,
    )


def _rows(group: str) -> list[_Row]:
    known = next(one for one in GROUPS if one == group)
    hidden = [
        _Row(group, one.name, one.source, "", "tentacled has one of this name, which is used")
        for one in shadowed(known)
    ]
    return [_row(entry) for entry in entries(known).values()] + hidden


def _row(entry: Entry) -> _Row:
    try:
        options = kind_of(entry.group, entry.name).options
    except KindError as error:
        return _Row(entry.group, entry.name, entry.source, "", str(error))
    about = " ".join((options.__doc__ or "").split()).partition(". ")[0].rstrip(".")
    return _Row(entry.group, entry.name, entry.source, about, "")


def _show(rows: list[_Row]) -> None:
    console = Console()
    for group in GROUPS:
        table = Table(box=None, title=group, title_justify="left", title_style="bold")
        for head in ("name", "from", "what it is"):
            table.add_column(head, overflow="fold")
        for row in rows:
            if row.group == group:
                table.add_row(row.name, row.source, row.problem or row.options)
        console.print(table)
