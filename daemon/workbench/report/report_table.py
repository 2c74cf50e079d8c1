"""Messages of one kind as columns of numbers: what a report needs of them, at a sixth of the size.

Times come as they were written, and columns come out in the order of time.
"""

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """What a column has of each message.

    width: numbers in a row; None means as many as the longest has. Where a message has fewer or
    none they are nan, and what it has beyond is left out.
    """

    of: Callable[[Any], Sequence[float] | None]
    width: int | None = None
    flat: bool = False
    """Rows of one number are no rows: the column is (N,)."""


def number(of: Callable[[Any], float | None]) -> Column:
    """A column of one number each."""

    def row(message: Any) -> Sequence[float] | None:
        value = of(message)
        return None if value is None else (value,)

    return Column(row, width=1, flat=True)


class MessageTable:
    """Grows message by message."""

    def __init__(self, columns: Mapping[str, Column]) -> None:
        self._times = array("q")
        self._columns = {name: (column, _Rows(column)) for name, column in columns.items()}

    def add(self, wall_ns: int, message: Any) -> None:
        self._times.append(wall_ns)
        for column, rows in self._columns.values():
            rows.add(column.of(message))

    def __len__(self) -> int:
        return len(self._times)

    def read(self) -> tuple[NDArray[np.int64], dict[str, Array]]:
        """Times of shape (N,) and columns, (N,) or (N, width), as they are by now."""
        times = np.array(self._times, dtype=np.int64)
        order = np.argsort(times, kind="stable")
        columns = {name: rows.read()[order] for name, (_, rows) in self._columns.items()}
        return times[order], columns


class _Rows:
    """Of one column, one after the other."""

    def __init__(self, column: Column) -> None:
        self._column = column
        self._numbers = array("d")
        self._count = 0
        self._set_width(column.width or 0)

    def add(self, row: Sequence[float] | None) -> None:
        if row is None:
            row = self._nothing
        elif len(row) != self._width:
            row = self._fitted(row)
        self._numbers.extend(row)
        self._count += 1

    def read(self) -> Array:
        table = np.array(self._numbers, dtype=np.float64)
        return table if self._column.flat else table.reshape(self._count, self._width)

    def _fitted(self, row: Sequence[float]) -> Sequence[float]:
        if self._column.width is None and len(row) > self._width:
            wider = fitted(self.read(), len(row))
            self._numbers = array("d", wider.ravel())
            self._set_width(len(row))
        return [*row, *self._nothing[len(row) :]][: self._width]

    def _set_width(self, width: int) -> None:
        self._width = width
        self._nothing = (np.nan,) * width


def fitted(table: Array, width: int) -> Array:
    """The table (N, any) in this width: with columns of nan, or without the last ones."""
    if table.shape[1] == width:
        return table
    made = np.full((len(table), width), np.nan)
    kept = min(width, table.shape[1])
    made[:, :kept] = table[:, :kept]
    return made
