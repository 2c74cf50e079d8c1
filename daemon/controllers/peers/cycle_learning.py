"""Norm-optimal iterative learning along a path that repeats: cycle by cycle a better reference.

After each cycle its error e, from the tip to the path, makes the correction c of the next one, the
c that minimises |e − T Δc|² + λ |Δc|² over one period (Amann, Owens and Rogers, IEE Proc. Control
Theory 143, 1996; Bristow, Tharayil and Alleyne, IEEE Control Systems 26, 2006). T is how the closed
loop follows a correction of its reference. The path closes, so over a period T is a product for
every harmonic, and so is the answer: Δc = T* e / (|T|² + λ). A filter Q without phase, the squared
magnitude of a Butterworth filter's, keeps out noise and what T is not known for.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from daemon.control.controller import Phase
from daemon.control.repeated_path import RepeatedPath
from daemon.control.task import within
from drivers.pose import Vector

_SEEN_SHARE: Final = 0.75
"""Of a cycle, of which less was measured: nothing is learnt from it."""
_MOST_TAKEN_MM: Final = 10.0
"""No error counts as more: whatever made it was hardly the path."""
_FARTHEST_MM: Final = 20.0
_BLEND_S: Final = 0.5
"""From one cycle's correction to the next one's: nothing jumps."""


class ClosedLoop(NamedTuple):
    """A body that answers with dead time and a first-order lag, under a gain and feed-forward."""

    gain_per_s: float
    dead_s: float
    lag_s: float
    feed_forward: bool

    def answer(self, rad_s: Vector) -> NDArray[np.complex128]:
        """(n,) of the tip to its reference at (n,) frequencies."""
        s = 1j * np.maximum(rad_s, 1e-9)
        body = np.exp(-s * self.dead_s) / (1.0 + s * self.lag_s)
        asked = self.gain_per_s + (s if self.feed_forward else 0.0)
        return np.asarray(asked * body / (s + self.gain_per_s * body))


class CycleLearning:
    """Takes errors by phase, gives corrections by phase. For one path."""

    def __init__(self, cycle_s: float, caution: float, cutoff_hz: float) -> None:
        """caution: λ. cutoff_hz: where Q leaves a half."""
        self.path = RepeatedPath(cycle_s)
        self.cycles = 0
        """How many were learnt from."""
        count = self.path.count
        self._cycle_s = cycle_s
        self._caution = caution
        self._hertz = np.fft.rfftfreq(count, self.path.spacing_s)
        self._smooth = 1.0 / (1.0 + (self._hertz / cutoff_hz) ** 4)
        self._corrections = self._before = np.zeros((count, 3))
        self._errors = np.zeros((count, 3))
        self._seen = np.zeros(count)
        self._last_s: float | None = None

    def break_off(self) -> None:
        """What was seen of this cycle is no whole one. What was learnt stays."""
        self._last_s = None
        self._errors[:] = 0.0
        self._seen[:] = 0.0

    def take(
        self, phase: Phase, reference_mm: Vector, error_mm: Vector | None, loop: ClosedLoop
    ) -> None:
        """(3,) from the tip to its reference; None: not measured. loop: as it is known by now."""
        if self._last_s is not None and phase.seconds < self._last_s - 0.5 * self._cycle_s:
            self._learn(loop)
        self._last_s = phase.seconds
        place = self.path.passes(phase, reference_mm)
        if error_mm is not None:
            self._errors[place] += within(error_mm, _MOST_TAKEN_MM)
            self._seen[place] += 1.0

    def at(self, phase_s: float) -> tuple[Vector, Vector]:
        """(3,) mm to add to the reference, and (3,) mm/s by which that changes."""
        new, new_change = self.path.at(self._corrections, phase_s)
        share = phase_s / _BLEND_S
        if share >= 1.0:
            return new, new_change
        old, old_change = self.path.at(self._before, phase_s)
        change = share * new_change + (1.0 - share) * old_change + (new - old) / _BLEND_S
        return share * new + (1.0 - share) * old, change

    def _learn(self, loop: ClosedLoop) -> None:
        seen = np.flatnonzero(self._seen)
        self._before = self._corrections
        if len(seen) >= _SEEN_SHARE * len(self._seen):
            errors = self._errors[seen] / self._seen[seen, None]
            everywhere, count = np.arange(len(self._seen)), len(self._seen)
            filled = [np.interp(everywhere, seen, one, period=count) for one in errors.T]
            self._corrections = self._better(np.stack(filled, axis=1), loop)
            self.cycles += 1
        self._errors[:] = 0.0
        self._seen[:] = 0.0

    def _better(self, errors: Vector, loop: ClosedLoop) -> Vector:
        answer = loop.answer(np.asarray(2.0 * np.pi * self._hertz, np.float64))
        taken = np.conj(answer) / (np.abs(answer) ** 2 + self._caution)
        spectrum = np.fft.rfft(self._corrections, axis=0)
        spectrum = spectrum + taken[:, None] * np.fft.rfft(errors, axis=0)
        found = np.fft.irfft(self._smooth[:, None] * spectrum, n=len(errors), axis=0)
        sizes = np.maximum(np.linalg.norm(found, axis=1), 1e-9)
        return np.asarray(found * np.minimum(1.0, _FARTHEST_MM / sizes)[:, None])
