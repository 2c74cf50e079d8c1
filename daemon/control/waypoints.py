"""Waypoint files: CSV with the header `t, x, y, z`, in s and mm."""

from math import isfinite
from pathlib import Path

import numpy as np

from drivers.pose import Vector

HEADER = ("t", "x", "y", "z")
LINES_AT_MOST = 20_000
_CLOSED_WITHIN_MM = 0.01


class WaypointError(ValueError):
    """A waypoint file that cannot be used: one `file:line: what` per problem."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(problems))


def read_waypoints(path: Path, *, closed: bool) -> tuple[Vector, Vector]:
    """(n,) times in s, from 0 and rising, and (n, 3) points in mm.

    closed: the last point must be the first. Raises WaypointError with every bad line.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise WaypointError([f"{path}: {error.strerror or error}"]) from None
    except UnicodeDecodeError as error:
        raise WaypointError([f"{path}: not UTF-8 text at byte {error.start}"]) from None
    if len(lines) > LINES_AT_MOST:
        raise WaypointError([f"{path}: {len(lines)} lines are more than {LINES_AT_MOST}"])
    problems: list[str] = []
    rows: list[tuple[float, ...]] = []
    header = False
    for number, line in enumerate(lines, start=1):
        words = [word.strip() for word in line.split(",")]
        if not any(words) or line.lstrip().startswith("#"):
            continue
        if not header:
            header = True
            if tuple(words) != HEADER:
                problems.append(f"{path}:{number}: the header must be `t, x, y, z`, not `{line}`")
            continue
        row = _row(words)
        if isinstance(row, str):
            problems.append(f"{path}:{number}: {row}")
        elif rows and row[0] <= rows[-1][0]:
            problems.append(f"{path}:{number}: t = {row[0]:g} is not after {rows[-1][0]:g}")
        else:
            rows.append(row)
    problems += _problems_of_all(path, len(lines), rows, closed) if not problems else []
    if problems:
        raise WaypointError(problems)
    table = np.array(rows)
    return table[:, 0] - table[0, 0], table[:, 1:]


def _row(words: list[str]) -> tuple[float, ...] | str:
    """Four finite numbers, or what is wrong."""
    if len(words) != len(HEADER):
        return f"needs {len(HEADER)} numbers, and has {len(words)}"
    values: list[float] = []
    for name, word in zip(HEADER, words, strict=True):
        try:
            value = float(word)
        except ValueError:
            return f"{name} = '{word}' is not a number"
        if not isfinite(value):
            return f"{name} = {word} is not finite"
        values.append(value)
    return tuple(values)


def _problems_of_all(
    path: Path, end: int, rows: list[tuple[float, ...]], closed: bool
) -> list[str]:
    if len(rows) < 2:
        return [f"{path}:{max(end, 1)}: needs two points or more, and has {len(rows)}"]
    gap_mm = max(abs(a - b) for a, b in zip(rows[0][1:], rows[-1][1:], strict=True))
    if closed and gap_mm > _CLOSED_WITHIN_MM:
        return [
            f"{path}:{end}: the last point must be the first one, as it is gone round several "
            f"times: they are {gap_mm:.2f} mm apart"
        ]
    return []
