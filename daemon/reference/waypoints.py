"""Waypoints: a CSV file with the header `t, x, y, z`, in s and mm, or rows of the same four.

With three columns more, `dx, dy, dz`, it says where the tip points as well: vectors of any length.
"""

import select
from collections.abc import Iterable, Sequence
from math import hypot, isfinite
from pathlib import Path
from typing import Final

import numpy as np

from config.tasks.trajectory import FARTHEST_MM, LONGEST_S
from daemon.files import read_regular
from drivers.pose import Vector

HEADER = ("t", "x", "y", "z")
WITH_DIRECTION: Final = (*HEADER, "dx", "dy", "dz")
LINES_AT_MOST = 20_000
_MOST_BYTES: Final = 200 * LINES_AT_MOST
_CLOSED_WITHIN_MM = 0.01
_SHORTEST: Final = 1e-6
"""Of a vector that points somewhere."""
_LINES_IN_A_ROW: Final = 50
"""After so many lines other threads get their turn: one of them may be the control loop's."""

Row = tuple[float, ...]


class WaypointError(ValueError):
    """Waypoints that cannot be used: one `where: what` per problem. Never quotes what it read:
    whoever named a file may not be somebody who may read it."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(self.problems)  # as it is made again on the other side of a process

    def __str__(self) -> str:
        return "\n".join(self.problems)


def read_waypoints(path: Path, *, closed: bool) -> tuple[Vector, Vector]:
    """(n,) times in s, from 0 and rising, and (n, 3) points in mm; (n, 6) with unit vectors of
    the directions behind, where it has them.

    closed: the last point must be the first. Raises WaypointError with every bad line.
    """
    try:
        text = read_regular(path, _MOST_BYTES).decode("utf-8-sig")
    except OSError as error:
        raise WaypointError([f"{path}: {error.strerror or error}"]) from None
    except UnicodeDecodeError as error:
        raise WaypointError([f"{path}: not UTF-8 text at byte {error.start}"]) from None
    lines = text.splitlines()
    if len(lines) > LINES_AT_MOST:
        raise WaypointError([f"{path}: {len(lines)} lines are more than {LINES_AT_MOST}"])
    return _table(str(path), _numbered(lines), closed)


def checked_waypoints(rows: Iterable[Row], *, closed: bool) -> tuple[Vector, Vector]:
    """The same for rows that came as data."""
    return _table("points", list(enumerate(rows, start=1)), closed)


def _numbered(lines: list[str]) -> list[tuple[int, Row | str]]:
    """What each line is that counts: numbers, or what is wrong with it."""
    rows: list[tuple[int, Row | str]] = []
    header: tuple[str, ...] = ()
    for number, line in enumerate(lines, start=1):
        if number % _LINES_IN_A_ROW == 0:
            select.select((), (), (), 0)
        words = [word.strip().strip('"') for word in line.split(",")]
        if not any(words) or line.lstrip().startswith("#"):
            continue
        if header:
            rows.append((number, _row(words, header)))
            continue
        header = WITH_DIRECTION if tuple(words) == WITH_DIRECTION else HEADER
        if tuple(words) != header:
            more = ", ".join(WITH_DIRECTION[len(HEADER) :])
            names = ", ".join(HEADER)
            what = f"the header must be `{names}`, with commas, or have `{more}` behind"
            rows.append((number, what))
    return rows


def _row(words: list[str], header: tuple[str, ...]) -> Row | str:
    """As many numbers as the header has names, or what is wrong."""
    if len(words) != len(header):
        return f"needs {len(header)} numbers, and has {len(words)}"
    values: list[float] = []
    for name, word in zip(header, words, strict=True):
        try:
            values.append(float(word))
        except ValueError:
            return f"{name} is not a number"
    return tuple(values)


def _table(
    where: str, found: Sequence[tuple[int, Row | str]], closed: bool
) -> tuple[Vector, Vector]:
    problems: list[str] = []
    rows: list[Row] = []
    for number, row in found:
        why = row if isinstance(row, str) else _why_not(row, rows)
        if why:
            problems.append(f"{where}:{number}: {why}")
        else:
            assert not isinstance(row, str)
            rows.append(row)
    end = found[-1][0] if found else 1
    problems += _problems_of_all(f"{where}:{end}", rows, closed) if not problems else []
    if problems:
        raise WaypointError(problems)
    table = np.array(rows)
    table[:, 4:] /= np.maximum(np.linalg.norm(table[:, 4:], axis=1, keepdims=True), _SHORTEST)
    return table[:, 0] - table[0, 0], table[:, 1:]


def _why_not(row: Row, before: list[Row]) -> str:
    """What is wrong with a row of numbers, or nothing."""
    for name, value in zip(WITH_DIRECTION, row, strict=False):
        if not isfinite(value):
            return f"{name} is not finite"
    if max(map(abs, row[1:4])) > FARTHEST_MM:
        return f"more than {FARTHEST_MM:g} mm from the origin"
    if before and len(row) != len(before[0]):
        return "has no direction, or the ones before have none"
    if len(row) > len(HEADER) and not hypot(*row[4:]) > _SHORTEST:
        return "dx, dy, dz point nowhere"
    if before and row[0] <= before[-1][0]:
        return "t is not after the one before"
    if before and row[0] - before[0][0] > LONGEST_S:
        return f"more than {LONGEST_S:g} s after the first"
    return ""


def _problems_of_all(where: str, rows: list[Row], closed: bool) -> list[str]:
    if len(rows) < 2:
        return [f"{where}: needs two points or more, and has {len(rows)}"]
    gap_mm = max(abs(a - b) for a, b in zip(rows[0][1:4], rows[-1][1:4], strict=True))
    if closed and gap_mm > _CLOSED_WITHIN_MM:
        return [
            f"{where}: the last point must be the first one, as it is gone round several "
            f"times: they are {gap_mm:.2f} mm apart"
        ]
    return []
