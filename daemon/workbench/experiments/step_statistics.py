"""What the steps of an experiment come to: errors by cycle, drift, and what the tracker allows."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Final

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from daemon.array_files import save_npz
from daemon.recording.result import CycleError, PoseError, TrackerLimits

# Every step of an experiment that counts, as arrays: what figures and statistics are made of.


Array = NDArray[np.float64]


@dataclass(frozen=True)
class StepSeries:
    """The steps within cycles, while the robot was RUNNING, in their order. nan: not known."""

    t_s: Array
    """(n,) along the trajectory, which stands still while the robot does, and may be slowed."""
    clock_s: Array
    """(n,) since the first step, as it passes for everybody."""
    cycle: Array
    """(n,) whole numbers from 0."""
    reference_mm: Array
    """(n, 3)"""
    tip_mm: Array
    """(n, 3) filtered: what the controller saw."""
    reading_mm: Array
    """(n, 3) as the tracker gave it."""
    true_mm: Array
    """(n, 3) where it was."""
    u: Array
    """(n, m) where the axes were, in shares of their travel."""
    reference_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(n, 3) unit vectors along the tip's axis. These and the following are (0, 3) where nothing is
    known of them, and not a number at steps where the tip may point anywhere."""
    tip_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    reading_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    sensor_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """Of the tip's sensor, as the tracker gave it."""
    true_direction: Array = field(default_factory=lambda: np.zeros((0, 3)))
    expected_mm: Array = field(default_factory=lambda: np.zeros(0))
    """(n,) error that the controller expected, root mean square; nan where it says nothing. (0,) in
    files that were written before any did."""

    @property
    def error_mm(self) -> Array:
        """(n,) distance of the filtered tip from its reference."""
        return np.asarray(np.linalg.norm(self.tip_mm - self.reference_mm, axis=1))

    @property
    def cycles(self) -> list[int]:
        """The numbers of the cycles that were begun."""
        return [int(number) for number in np.unique(self.cycle)]

    def save(self, path: Path) -> None:
        """Write all, in single precision. A reader sees the whole file or none. Raises OSError."""
        arrays = {one.name: getattr(self, one.name) for one in fields(self)}
        save_npz(path, {name: array.astype(np.float32) for name, array in arrays.items()})

    @classmethod
    def load(cls, path: Path) -> "StepSeries":
        """Raises OSError, ValueError, KeyError for what is no such file."""
        with np.load(path, allow_pickle=False) as stored:
            names = [one.name for one in fields(cls) if one.name in stored]
            arrays = {name: stored[name].astype(float) for name in names}
            # A file without a clock is of paths that kept their time.
            return cls(**{"clock_s": arrays["t_s"], **arrays})


CONVERGED_BELOW_MM: Final = 1.0
_CONVERGED_OVER: Final = 0.25
"""Share of a cycle over which the error is averaged: a corner is not the end of convergence."""
_SMOOTH_OVER_STEPS: Final = 81
"""Two seconds at 40 Hz: long against the filter's memory, short against a path's curves."""
_COURSE_STEPS: Final = 7
_OUTLIER_MM: Final = 3.0
"""A reading so far from its neighbours' median course is wrong, and no noise."""


def errors_by_cycle(series: StepSeries, points_mm: Array) -> list[CycleError]:
    """Distances of `points_mm`, (n, 3), from the reference; cycles without any are left out."""
    distances = np.linalg.norm(points_mm - series.reference_mm, axis=1)
    rows = []
    for number in series.cycles:
        mine = distances[(series.cycle == number) & np.isfinite(distances)]
        if mine.size:
            rows.append(
                CycleError(
                    cycle=number,
                    samples=int(mine.size),
                    mean_mm=float(mine.mean()),
                    std_mm=float(mine.std()),
                    max_mm=float(mine.max()),
                )
            )
    return rows


def pose_errors(series: StepSeries, points_mm: Array, directions: Array) -> list[PoseError]:
    """Root mean squares of `points_mm`, (n, 3), and of `directions`, (n, 3) or (0, 3), by cycle."""
    off_mm, off_rad = points_mm - series.reference_mm, angles_rad(series, directions)
    known = np.isfinite(off_mm).all(axis=1)
    rows = []
    for number in series.cycles:
        mine = (series.cycle == number) & known
        if mine.any():
            x_mm, y_mm, z_mm = np.sqrt((off_mm[mine] ** 2).mean(axis=0)).tolist()
            angles = off_rad[mine & np.isfinite(off_rad)]
            rows.append(
                PoseError(
                    cycle=number,
                    samples=int(mine.sum()),
                    x_mm=x_mm,
                    y_mm=y_mm,
                    z_mm=z_mm,
                    angle_rad=float(np.sqrt((angles**2).mean())) if angles.size else None,
                )
            )
    return rows


def angles_rad(series: StepSeries, directions: Array) -> Array:
    """(n,) between `directions`, (n, 3), and the reference's; not a number where one is missing."""
    if len(directions) != len(series.t_s) or len(series.reference_direction) != len(series.t_s):
        return np.full(len(series.t_s), np.nan)
    across = np.linalg.norm(np.cross(directions, series.reference_direction), axis=1)
    return np.asarray(np.arctan2(across, (directions * series.reference_direction).sum(axis=1)))


def drifts(series: StepSeries) -> list[float]:
    """How far the axes' places at each cycle's end are from those at its beginning."""
    found = []
    for number in series.cycles:
        u = series.u[series.cycle == number]
        found.append(float(np.linalg.norm(u[-1] - u[0])))
    return found


def converged_s(series: StepSeries, cycle_s: float) -> float | None:
    """From when on the error's moving mean stays below 1 mm; None: it does not.

    The mean is that over the last quarter of a cycle. 0: the first one is below already.
    """
    over_s = _CONVERGED_OVER * cycle_s
    t_s, error_mm = series.t_s, series.error_mm
    if not t_s.size or t_s[-1] - t_s[0] < over_s:
        return None
    first = np.searchsorted(t_s, t_s - over_s)
    sums = np.concatenate([[0.0], np.cumsum(error_mm)])
    places = np.arange(len(t_s))
    means = (sums[places + 1] - sums[first]) / (places + 1 - first)
    full = t_s - t_s[0] >= over_s
    above = np.flatnonzero(full & (means >= CONVERGED_BELOW_MM))
    if not above.size:
        return 0.0
    place = int(above[-1]) + 1
    return float(t_s[place]) if place < len(t_s) else None


def tracker_limits(series: StepSeries) -> TrackerLimits | None:
    """What the tracker alone puts into the errors. None: there are too few steps to tell."""
    if len(series.t_s) < 2 * _SMOOTH_OVER_STEPS:
        return None
    known = np.isfinite(series.true_mm).all(axis=1)
    about = series.true_mm if known.all() else series.reference_mm
    readings = _without_outliers(series.reading_mm - about)
    smooth = _smoothed(readings)
    return TrackerLimits(
        noise_mm=_noise(_without_outliers(series.tip_mm - about)),
        reading_noise_mm=_noise(readings),
        distortion_mm=_mean_length(smooth) if known.all() else None,
    )


def _noise(residual: Array) -> float:
    """Mean distance from the smooth course."""
    half = _SMOOTH_OVER_STEPS // 2
    return _mean_length(residual[half:-half] - _smoothed(residual))


def _mean_length(vectors: Array) -> float:
    return float(np.linalg.norm(vectors, axis=1).mean())


def _smoothed(values: Array) -> Array:
    """Moving mean of each column, where all of its steps are there."""
    even = np.full(_SMOOTH_OVER_STEPS, 1.0 / _SMOOTH_OVER_STEPS)
    return np.stack([np.convolve(column, even, mode="valid") for column in values.T], axis=1)


def _without_outliers(values: Array) -> Array:
    """(n, 3), with what is missing or wildly wrong put on the line between its neighbours."""
    places = np.arange(len(values))
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        return np.zeros_like(values)
    filled = _between(places, np.flatnonzero(known), values)
    near = np.linalg.norm(filled - _course(filled), axis=1) < _OUTLIER_MM
    return _between(places, np.flatnonzero(known & near), values)


def _course(values: Array) -> Array:
    """Moving median of each column; at the ends the last values go on."""
    half = _COURSE_STEPS // 2
    longer = np.pad(values, ((half, half), (0, 0)), mode="edge")
    return np.asarray(np.median(sliding_window_view(longer, _COURSE_STEPS, axis=0), axis=-1))


def _between(places: NDArray[np.int64], sound: NDArray[np.int64], values: Array) -> Array:
    columns = [np.interp(places, places[sound], column[sound]) for column in values.T]
    return np.stack(columns, axis=1)
