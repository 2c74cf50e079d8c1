"""Sees every step of an experiment, and the truth beside it where somebody knows it."""

from array import array
from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from daemon.control.axis_ranges import AxisRanges
from daemon.experiment.step_series import Array, StepSeries
from daemon.remote.messages import Axes, Message, Tip
from safety.states import OperatingState

_RUNNING: Final = OperatingState.RUNNING.value
_UNKNOWN: Final = (float("nan"),) * 3


class Truth(Protocol):
    """Knows what no device can measure."""

    def tip_mm(self) -> Array:
        """(3,) where the tip is now, in the base's frame."""
        ...

    def failures(self) -> int:
        """How often the emulated body found no equilibrium, and stayed as it was."""
        ...


class Witness:
    """Listens to telemetry. A step comes as a Tip, and then as Axes of the same number."""

    def __init__(self, axes: AxisRanges, truth: Truth | None) -> None:
        """truth: None where nobody knows it."""
        self.elapsed_s: Callable[[], float] = lambda: 0.0
        """Along the trajectory, now."""
        self._axes = axes
        self._truth = truth
        self._tip: Tip | None = None
        self._times, self._cycles = array("d"), array("d")
        self._points = {name: array("d") for name in ("reference", "tip", "reading", "true")}
        self._u = array("d")

    def hear(self, message: Message) -> None:
        """Take what belongs to a step within a cycle."""
        if isinstance(message, Tip):
            counts = message.state == _RUNNING and message.cycle >= 0
            self._tip = message if counts and message.error_mm is not None else None
        elif isinstance(message, Axes) and self._tip is not None:
            if self._tip.sequence == message.sequence:
                self._take(self._tip, message)
            self._tip = None

    def series(self) -> StepSeries:
        """All steps so far."""
        points = {name: _points(values) for name, values in self._points.items()}
        travel = self._axes.travel
        return StepSeries(
            t_s=np.array(self._times),
            cycle=np.array(self._cycles),
            reference_mm=points["reference"],
            tip_mm=points["tip"],
            reading_mm=points["reading"],
            true_mm=points["true"],
            u=(np.array(self._u).reshape(-1, len(travel)) - self._axes.lowest) / travel,
        )

    def _take(self, tip: Tip, axes: Axes) -> None:
        self._times.append(self.elapsed_s())
        self._cycles.append(tip.cycle)
        points = self._points
        points["reference"].extend(tip.reference_mm or _UNKNOWN)
        points["tip"].extend(tip.tip_mm or _UNKNOWN)
        points["reading"].extend(tip.measured_mm or _UNKNOWN)
        points["true"].extend(_UNKNOWN if self._truth is None else self._truth.tip_mm())
        self._u.extend(axes.actual)


def _points(values: "array[float]") -> Array:
    return np.array(values).reshape(-1, 3)
