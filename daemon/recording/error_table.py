"""The tip's error, cycle by cycle, as the papers' tables give it."""

import math
from collections.abc import Sequence
from typing import Final

import msgspec

from daemon.messages import Tip
from safety.states import OperatingState

_RUNNING: Final = OperatingState.RUNNING.value
_HEAD: Final = ("cycle", "samples", "mean mm", "std mm", "max mm")


class CycleError(msgspec.Struct, frozen=True, kw_only=True):
    """Distance between tip and reference over one cycle of the trajectory."""

    cycle: int
    """From 0."""
    samples: int
    mean_mm: float
    std_mm: float
    """Of the samples about their mean, divided by their number."""
    max_mm: float


class ErrorTable:
    """Accumulates errors while the robot follows its trajectory; what leads to it is left out."""

    def __init__(self) -> None:
        self._cycles: dict[int, _Accumulated] = {}

    def add(self, tip: Tip) -> None:
        """Count this step in if it belongs to a cycle and has an error."""
        error_mm = tip.error_mm
        if tip.state != _RUNNING or tip.cycle < 0 or error_mm is None:
            return
        if math.isfinite(error_mm):
            cycle = self._cycles.get(tip.cycle)
            if cycle is None:
                cycle = self._cycles[tip.cycle] = _Accumulated()
            cycle.add(error_mm)

    def rows(self) -> list[CycleError]:
        """One row for each cycle that has samples, in order."""
        return [self._cycles[number].row(number) for number in sorted(self._cycles)]

    def __str__(self) -> str:
        return table_text(self.rows())


def table_text(rows: Sequence[CycleError]) -> str:
    """The table for a terminal."""
    if not rows:
        return "no cycle was followed"
    lines = ["  ".join(f"{name:>8}" for name in _HEAD)]
    for row in rows:
        figures = (row.mean_mm, row.std_mm, row.max_mm)
        cells = [f"{row.cycle + 1:>8}", f"{row.samples:>8}", *(f"{mm:>8.3f}" for mm in figures)]
        lines.append("  ".join(cells))
    return "\n".join(lines)


class _Accumulated:
    """Mean and spread in one pass, without the cancellation of a sum of squares."""

    __slots__ = ("_mean_mm", "_samples", "_squares_mm2", "_worst_mm")

    def __init__(self) -> None:
        self._samples = 0
        self._mean_mm = 0.0
        self._squares_mm2 = 0.0
        self._worst_mm = 0.0

    def add(self, error_mm: float) -> None:
        self._samples += 1
        before = error_mm - self._mean_mm
        self._mean_mm += before / self._samples
        self._squares_mm2 += before * (error_mm - self._mean_mm)
        self._worst_mm = max(self._worst_mm, error_mm)

    def row(self, cycle: int) -> CycleError:
        return CycleError(
            cycle=cycle,
            samples=self._samples,
            mean_mm=self._mean_mm,
            std_mm=math.sqrt(self._squares_mm2 / self._samples),
            max_mm=self._worst_mm,
        )
