"""What a run comes to for a bench: errors, recovery from loads, effort and smoothness."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from config.tasks.experiment import Happening
from daemon.reference.trajectories import make_trajectory
from daemon.workbench.experiments.carry_out import STEPS_FILE
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.experiments.step_statistics import Array, StepSeries, tracker_limits

_RECOVERED_MM: Final = 1.0
_FOR_S: Final = 1.0
"""Below that for so long a tip is back."""
_DISTURBED_S: Final = 3.0
"""So long after a load has changed, errors are of that, which nobody could expect."""
_OVERSHOOT_WITHIN_S: Final = 5.0
"""After the farthest point of a push."""
_SMALLEST_PUSH_MM: Final = 1.0
_GAP_S: Final = 0.2
"""Steps that are farther apart belong to two motions."""


@dataclass(frozen=True)
class LoadChange:
    """A load that is hung on, or taken off, at once."""

    at_s: float
    load_g: float


class Recovery(msgspec.Struct, frozen=True, kw_only=True):
    """What became of the error after a load had changed."""

    at_s: float
    load_g: float
    """From then on."""
    peak_mm: float
    """The farthest that the tip was off."""
    back_s: float | None
    """When the error was below 1 mm for a whole second, since the change; None: not before the
    next change, or the end."""
    true_back_s: float | None
    """The same of the body's own tip; None as well where nobody knows it."""
    overshoot_mm: float
    """How far beyond its reference the tip went on the way back."""


class Measures(msgspec.Struct, frozen=True, kw_only=True):
    """Of one run. Errors are distances of the tip from its reference, in mm: as the tracker and
    its filter have it, and true ones of the body's own tip, where somebody knows it."""

    floor_mm: float | None
    """What the filtered error is for the tracker's noise alone."""
    first_mm: float
    """Mean of the first cycle."""
    settled_mm: float
    """Median of the means of the last cycles: of the later half, without the first."""
    worst_mm: float
    true_first_mm: float | None
    true_settled_mm: float | None
    true_worst_mm: float | None
    recoveries: list[Recovery]
    effort_per_m: float | None
    """Way of all axes together, in travels, per metre of the reference's path."""
    acceleration_per_s2: float | None
    """Of all axes, root mean square, in travels per s²: the less the smoother."""
    times_as_long: float = 1.0
    """How long it took, in times of what the trajectory says: more than 1 where it was slowed."""
    against_expected: float | None = None
    """Errors by what the controller expected them to be, both root mean square, without the seconds
    after a load has changed: about 1 where it knows how sure it may be. None: it does not say."""


def measures_of(file: ExperimentFile, folder: Path) -> Measures | None:
    """Of the experiment that was carried out there. None: nothing was followed."""
    try:
        series = StepSeries.load(folder / STEPS_FILE)
    except (OSError, ValueError, KeyError):
        return None
    experiment = file.experiment
    trajectory = make_trajectory(experiment.trajectory, file.path.parent)
    loads = load_changes(experiment.tip_load_g, experiment.happenings, trajectory.cycle_s)
    return measured(series, trajectory.duration_s, loads)


def recovery_lines(recoveries: Sequence[Recovery]) -> list[str]:
    """What became of the error after each change of load, for people."""
    return [
        f"{one.load_g:g} g from {one.at_s:.1f} s on: {one.peak_mm:.1f} mm off, back below "
        f"{_RECOVERED_MM:g} mm {_after(one.back_s)} (the true tip {_after(one.true_back_s)}), "
        f"{one.overshoot_mm:.1f} mm beyond"
        for one in recoveries
    ]


def _after(back_s: float | None) -> str:
    return "not at all" if back_s is None else f"after {back_s:.2f} s"


def load_changes(
    tip_load_g: float, happenings: Sequence[Happening], cycle_s: float
) -> list[LoadChange]:
    """Those at once, in the order of their times, where another load hung there before, be it one
    that was poured in."""

    def at_s(one: Happening) -> float:
        return one.at_s if one.at_s is not None else (one.at_cycle or 0) * cycle_s

    changes, before_g = list[LoadChange](), tip_load_g
    for one in sorted(happenings, key=at_s):
        if one.tip_load_g is not None:
            if one.fill_g_s is None and one.tip_load_g != before_g:
                changes.append(LoadChange(at_s(one), one.tip_load_g))
            before_g = one.tip_load_g
    return changes


def measured(series: StepSeries, duration_s: float, loads: Sequence[LoadChange]) -> Measures | None:
    """duration_s: of the whole trajectory. None: there is nothing to measure."""
    if not len(series.t_s):
        return None
    limits = tracker_limits(series)
    known = bool(np.isfinite(series.true_mm).all())
    true_mm = np.asarray(np.linalg.norm(series.true_mm - series.reference_mm, axis=1))
    first_mm, settled_mm, worst_mm = _errors(series, series.error_mm)
    true = _errors(series, true_mm) if known else (None, None, None)
    ends_s = [change.at_s for change in loads[1:]] + [duration_s]
    recoveries = [
        found
        for change, end_s in zip(loads, ends_s, strict=False)
        if (found := _recovery(series, true_mm, change, end_s)) is not None
    ]
    return Measures(
        floor_mm=None if limits is None else limits.noise_mm,
        first_mm=first_mm,
        settled_mm=settled_mm,
        worst_mm=worst_mm,
        true_first_mm=true[0],
        true_settled_mm=true[1],
        true_worst_mm=true[2],
        recoveries=recoveries,
        effort_per_m=_effort_per_m(series),
        acceleration_per_s2=_acceleration(series),
        times_as_long=_times_as_long(series),
        against_expected=_against_expected(series, loads),
    )


def _errors(series: StepSeries, error_mm: Array) -> tuple[float, float, float]:
    """First cycle, settled, worst."""
    means = [float(error_mm[series.cycle == number].mean()) for number in series.cycles]
    later = means[max(len(means) // 2, 1) :] or means
    return means[0], float(np.median(later)), float(error_mm.max())


def _against_expected(series: StepSeries, loads: Sequence[LoadChange]) -> float | None:
    if not len(series.expected_mm):
        return None
    counts = np.isfinite(series.expected_mm)
    for change in loads:
        after_s = series.t_s - change.at_s
        counts &= (after_s < 0.0) | (after_s > _DISTURBED_S)
    if not counts.any():
        return None
    error, expected = series.error_mm[counts], series.expected_mm[counts]
    return float(np.sqrt((error @ error) / (expected @ expected)))


def _recovery(
    series: StepSeries, true_mm: Array, change: LoadChange, end_s: float
) -> Recovery | None:
    """true_mm: (n,) error of the body's own tip; NaN where nobody knows it."""
    mine = (series.t_s >= change.at_s) & (series.t_s < end_s)
    if not mine.any():
        return None
    t_s = series.clock_s[mine] - series.clock_s[mine][0] + (series.t_s[mine][0] - change.at_s)
    error_mm = series.error_mm[mine]
    back_s = _back_s(t_s, error_mm)
    before = len(t_s) if back_s is None else int(np.searchsorted(t_s, back_s)) + 1
    peak = int(np.argmax(error_mm[:before]))
    off_mm = (series.tip_mm - series.reference_mm)[mine]
    return Recovery(
        at_s=change.at_s,
        load_g=change.load_g,
        peak_mm=float(error_mm[peak]),
        back_s=back_s,
        true_back_s=_back_s(t_s, true_mm[mine]) if np.isfinite(true_mm[mine]).all() else None,
        overshoot_mm=_overshoot_mm(t_s, off_mm, peak),
    )


def _back_s(t_s: Array, error_mm: Array) -> float | None:
    """From when on the error was small for a whole second of motion, the first time."""
    moved_s = np.concatenate([[0.0], np.cumsum(_while_it_moves(np.diff(t_s)))])
    off = np.flatnonzero(error_mm >= _RECOVERED_MM)
    for begin, end in zip([0, *off], [*off, len(t_s) - 1], strict=True):
        if moved_s[end] - moved_s[begin] >= _FOR_S:
            return 0.0 if error_mm[begin] < _RECOVERED_MM else float(t_s[begin + 1])
    return None


def _while_it_moves(dt_s: Array) -> Array:
    """Nothing for the time in which the robot stood: nobody knows the error then."""
    return np.where(dt_s < _GAP_S, dt_s, 0.0)


def _overshoot_mm(t_s: Array, off_mm: Array, peak: int) -> float:
    """How far the tip went to the other side, along the direction in which it was pushed."""
    push_mm = off_mm[peak]
    length_mm = float(np.linalg.norm(push_mm))
    if length_mm < _SMALLEST_PUSH_MM:
        return 0.0
    after = (t_s >= t_s[peak]) & (t_s <= t_s[peak] + _OVERSHOOT_WITHIN_S)
    return max(0.0, float(-(off_mm[after] @ (push_mm / length_mm)).min()))


def _effort_per_m(series: StepSeries) -> float | None:
    way_m = 1e-3 * float(np.linalg.norm(np.diff(series.reference_mm, axis=0), axis=1).sum())
    return float(np.abs(np.diff(series.u, axis=0)).sum()) / way_m if way_m > 0.0 else None


def _times_as_long(series: StepSeries) -> float:
    """Steps between which the robot stood do not count."""
    clock_s, along_s = np.diff(series.clock_s), np.diff(series.t_s)
    moved = (clock_s > 0.0) & (clock_s < _GAP_S)
    along = float(along_s[moved].sum())
    return float(clock_s[moved].sum()) / along if along > 0.0 else 1.0


def _acceleration(series: StepSeries) -> float | None:
    """By second differences of where the axes were."""
    dt_s = np.diff(series.clock_s)
    if len(dt_s) < 2:
        return None
    together = (dt_s > 0.0) & (dt_s < _GAP_S)
    speeds = np.diff(series.u, axis=0) / np.where(together, dt_s, 1.0)[:, None]
    middle_s = 0.5 * (dt_s[:-1] + dt_s[1:])
    both = together[:-1] & together[1:]
    if not both.any():
        return None
    changes = np.diff(speeds, axis=0)[both] / middle_s[both, None]
    return float(np.sqrt((changes**2).sum(axis=1).mean()))
