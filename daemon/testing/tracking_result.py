"""What a run was like, in words that explain a failing assertion."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from daemon.messages import Tip
from daemon.recording.result import CycleError, Result
from daemon.recording.run_parts import RunParts

_FIGURES: Final = ("mean_mm", "std_mm", "max_mm")


@dataclass(frozen=True)
class Figures:
    """The tip's distance from its reference over one cycle, mm. Its repr is what pytest shows."""

    run: str
    cycle: int
    """From 1."""
    samples: int
    mean_mm: float
    std_mm: float
    max_mm: float

    def __repr__(self) -> str:
        return (
            f"cycle {self.cycle} of {self.run}: mean {self.mean_mm:.3f} mm, "
            f"std {self.std_mm:.3f} mm, max {self.max_mm:.3f} mm"
        )


@dataclass(frozen=True)
class TrackingResult:
    """One run. Its repr is what pytest shows of it."""

    name: str
    folder: Path
    """With recording, `result.json` and robot file."""
    seed: int
    plant: int
    result: Result
    problem: str = ""
    """Why it did not come to its end; empty: it did."""
    _states: list[tuple[float, str]] = field(default_factory=list)

    def cycle(self, number: int) -> Figures:
        """Of the filtered tip, which is what the controller saw; 1 is the first cycle."""
        return self._of(self.result.cycles, number)

    def true_cycle(self, number: int) -> Figures:
        """Of the emulated tip itself. Raises LookupError in real time, where nobody knows it."""
        return self._of(self.result.true_cycles, number)

    def _of(self, rows: list[CycleError], number: int) -> Figures:
        for row in rows:
            if row.cycle == number - 1:
                values = (getattr(row, name) for name in _FIGURES)
                return Figures(self.name, number, row.samples, *values)
        raise LookupError(f"{self.name} has no figures of a cycle {number}: {self!r}")

    @property
    def mean_mm(self) -> float:
        """Over all cycles."""
        rows = self.result.cycles
        count = sum(row.samples for row in rows)
        return sum(row.mean_mm * row.samples for row in rows) / count if count else float("nan")

    @property
    def max_mm(self) -> float:
        """Over all cycles."""
        return max((row.max_mm for row in self.result.cycles), default=float("nan"))

    @property
    def holds(self) -> int:
        """How often the motion was interrupted."""
        return self.result.holds

    @property
    def faults(self) -> list[str]:
        """Names of the causes that led to HOLD, FAULT or ESTOP, in order."""
        return self.result.faults

    @property
    def final_state(self) -> str:
        """In which the run ended."""
        return self.result.final_state

    def state_at(self, t_s: float) -> str:
        """The robot's state so long after the trajectory began; time goes on while it is held.

        Raises LookupError for a time that the recording does not have.
        """
        found = [state for at_s, state in self._all_states() if at_s <= t_s]
        if not found or t_s < 0.0:
            raise LookupError(f"{self.name}: nothing is recorded {t_s:g} s after the start")
        return found[-1]

    def _all_states(self) -> list[tuple[float, str]]:
        if not self._states:
            tips = [
                msgspec.json.decode(message.data, type=Tip)
                for message in RunParts(self.folder).messages(["/tip"])
            ]
            began_ns = next((tip.t_ns for tip in tips if tip.cycle >= 0), None)
            if began_ns is not None:
                self._states.extend(((tip.t_ns - began_ns) * 1e-9, tip.state) for tip in tips)
        return self._states

    def properties(self) -> list[tuple[str, object]]:
        """For the report of a test."""
        rows = [
            (f"cycle_{row.cycle + 1}.{name}", round(getattr(row, name), 4))
            for row in self.result.cycles
            for name in _FIGURES
        ]
        state = ("final_state", self.final_state)
        return [("seed", self.seed), ("plant", self.plant), ("holds", self.holds), state, *rows]

    def explanation(self) -> str:
        """A table of it, for who reads why a test has failed."""
        lines = [f"{self.name}: {self.result.trajectory}, {self.result.controller}"]
        lines += [f"  seed {self.seed}, body {self.plant}, recorded in {self.folder}"]
        lines += [f"  {'cycle':>5} {'mean mm':>9} {'std mm':>9} {'max mm':>9}"]
        lines += [
            f"  {row.cycle + 1:>5} {row.mean_mm:>9.3f} {row.std_mm:>9.3f} {row.max_mm:>9.3f}"
            for row in self.result.cycles
        ]
        ended = self.problem or f"ended in {self.final_state}"
        held = ", ".join(self.faults) or "nothing"
        return "\n".join([*lines, f"  held {self.holds} times by: {held}; {ended}"])

    def __repr__(self) -> str:
        return (
            f"<{self.name}: mean {self.mean_mm:.3f} mm, max {self.max_mm:.3f} mm in "
            f"{len(self.result.cycles)} cycles, {self.holds} holds, {self.final_state}>"
        )
