"""Sees every step of an experiment, and the truth beside it where somebody knows it."""

from array import array
from collections.abc import Callable
from typing import Final, Protocol

import numpy as np

from daemon.messages import Axes, Tip
from daemon.robot.axes import AxisRanges
from daemon.workbench.experiments.step_series import Array, StepSeries
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
        self._reference, self._believed = array("d"), array("d")
        self._reading, self._true = array("d"), array("d")
        self._u = array("d")

    def hear_tip(self, tip: Tip) -> None:
        """Only what belongs to a step within a cycle counts."""
        counts = tip.cycle >= 0 and tip.error_mm is not None and tip.state == _RUNNING
        self._tip = tip if counts else None

    def hear_axes(self, axes: Axes) -> None:
        """Completes the step."""
        tip, self._tip = self._tip, None
        if tip is not None and tip.sequence == axes.sequence:
            self._take(tip, axes)

    def series(self) -> StepSeries:
        """All steps so far."""
        travel = self._axes.travel
        return StepSeries(
            t_s=np.array(self._times),
            cycle=np.array(self._cycles),
            reference_mm=_points(self._reference),
            tip_mm=_points(self._believed),
            reading_mm=_points(self._reading),
            true_mm=_points(self._true),
            u=(np.array(self._u).reshape(-1, len(travel)) - self._axes.lowest) / travel,
        )

    def _take(self, tip: Tip, axes: Axes) -> None:
        self._times.append(self.elapsed_s())
        self._cycles.append(tip.cycle)
        self._reference.extend(tip.reference_mm or _UNKNOWN)
        self._believed.extend(tip.tip_mm or _UNKNOWN)
        self._reading.extend(tip.measured_mm or _UNKNOWN)
        self._true.extend(_UNKNOWN if self._truth is None else self._truth.tip_mm().tolist())
        self._u.extend(axes.actual)


def _points(values: "array[float]") -> Array:
    return np.array(values).reshape(-1, 3)
