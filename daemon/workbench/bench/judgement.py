"""Who wins in each cell of a bench, who is within noise of the best, and what that says of ours."""

from collections.abc import Callable, Mapping, Sequence
from math import inf, isfinite, sqrt
from typing import Final

import msgspec
import numpy as np

from config.tasks.study import Study
from config.tasks.study_matrix import Judged
from daemon.workbench.experiments.measures import Measures
from daemon.workbench.studies.run import Outcome
from daemon.workbench.studies.study_file import StudyFile

_STANDARD_ERRORS: Final = 2.0
_IN_TIME: Final = 1.02
"""Times as long as the trajectory says: who takes longer is not compared with who keeps time."""
_LEAST_SHARE: Final = 0.03
"""Of an error: a smaller difference is none. With one seed alone nothing else tells the noise."""
CRITERION: Final = (
    "Within noise: the medians over seeds differ by no more than 3 %, or by no more than two "
    "standard errors of their difference, by the cell's noise: the median over all controllers in "
    "it of an error's relative standard deviation over seeds, so that nobody gains by being "
    "unsteady. A run that was held, refused, unstable or given up is worse than any that was not. "
    "Who slows a path is told with how many times as long it took, and wins nothing by it."
)


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    """One controller in one cell: medians over seeds. Infinite (null in JSON): it failed. Errors in
    mm, of the filtered tip and of the true one."""

    variant: str
    runs: int
    trouble: str
    """What did not go well, in few words."""
    settled_mm: float
    settled_all_mm: list[float]
    """Of each run."""
    first_mm: float
    worst_mm: float
    true_settled_mm: float
    true_first_mm: float
    true_worst_mm: float
    floor_mm: float | None
    recovery_s: float | None
    """Of the slowest of the load's changes. None: there were none."""
    true_recovery_s: float | None
    """The same of the body's own tip."""
    overshoot_mm: float | None
    effort_per_m: float | None
    acceleration_per_s2: float | None
    times_as_long: float = 1.0
    """As the trajectory says: more than 1 where the path was slowed."""
    against_expected: float | None = None
    """Errors by what the controller itself expected; None: it says nothing of that."""
    ratio: float = inf
    """To the best settled error of the cell."""
    within_noise: bool = False
    """Whether it is the best, or within noise of it."""

    @property
    def failed(self) -> bool:
        """In half of the runs or more."""
        return not isfinite(self.settled_mm)

    @property
    def in_time(self) -> bool:
        """Whether it kept the path's own time."""
        return self.times_as_long <= _IN_TIME


class CellFindings(msgspec.Struct, frozen=True, kw_only=True):
    """One cell, all controllers in it."""

    cell: str
    label: str
    robot: str
    body: str | None
    refused: str
    """Why no controller can follow the path; empty: it can be followed."""
    figures: list[Figures]

    @property
    def group(self) -> str:
        """Robot and body, with which its label begins."""
        return self.label.partition(": ")[0]

    @property
    def short_label(self) -> str:
        """Path, speed, load and gain: the rest of it."""
        return self.label.partition(": ")[2]

    def of(self, variant: str) -> Figures | None:
        """None: it was not run."""
        return next((one for one in self.figures if one.variant == variant), None)

    @property
    def best(self) -> Figures | None:
        """None: nobody came to its end."""
        ended = [one for one in self.figures if not one.failed and one.in_time]
        return min(ended, key=lambda one: one.settled_mm) if ended else None


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """What the cells say of the judged controller."""

    ours: str
    cells: int
    """In which somebody came to the end."""
    refused: int
    best: int
    """In which it is the best, or within noise of it."""
    worst_ratio: float
    behind: list[str]
    """Cells in which it is not, the farthest behind first."""
    worse_than_without_learning: list[str]
    """Cells in which learning made it worse by more than noise."""
    reached: bool


def cell_findings(file: StudyFile, outcomes: Sequence[Outcome]) -> list[CellFindings]:
    """Of all cells in which something was run, in the study's order."""
    grouped: dict[str, dict[str, list[Outcome]]] = {}
    for outcome in outcomes:
        grouped.setdefault(outcome.experiment, {}).setdefault(outcome.variant, []).append(outcome)
    found = []
    for name, cell in file.cells.items():
        mine = grouped.get(name)
        if mine:
            found.append(
                CellFindings(
                    cell=name,
                    label=cell.label,
                    robot=cell.robot,
                    body=cell.body,
                    refused=_refused(mine),
                    figures=_compared(
                        [
                            _figures(variant.variant, mine[variant.variant], file.study)
                            for variant in file.study.variants
                            if variant.variant in mine
                        ]
                    ),
                )
            )
    return found


def verdict(judged: Judged, cells: Sequence[CellFindings]) -> Verdict:
    """Over all cells that can be followed."""
    counted = [cell for cell in cells if not cell.refused and cell.best and cell.of(judged.ours)]
    mine = {cell.cell: figures for cell in counted if (figures := cell.of(judged.ours))}
    behind = [cell.cell for cell in counted if not mine[cell.cell].within_noise]
    ratio = max((one.ratio for one in mine.values()), default=inf)
    worse = [
        cell.cell
        for cell in counted
        if (other := cell.of(judged.without_learning or "")) is not None
        and not other.failed
        and not no_worse(mine[cell.cell], other, relative_noise(cell.figures))
    ]
    best = len(counted) - len(behind)
    enough = bool(counted) and best >= judged.share_best * len(counted)
    return Verdict(
        ours=judged.ours,
        cells=len(counted),
        refused=sum(bool(cell.refused) for cell in cells),
        best=best,
        worst_ratio=ratio,
        behind=sorted(behind, key=lambda name: -mine[name].ratio),
        worse_than_without_learning=worse,
        reached=enough and ratio <= judged.never_above and not worse,
    )


def _refused(mine: Mapping[str, Sequence[Outcome]]) -> str:
    """Why all were refused before the start; empty: some were not."""
    all_of_them = [outcome for outcomes in mine.values() for outcome in outcomes]
    return all_of_them[0].failure if all(one.refused for one in all_of_them) else ""


def _figures(variant: str, outcomes: Sequence[Outcome], study: Study) -> Figures:
    verdicts = [outcome.verdict(study.unstable_above_mm) for outcome in outcomes]
    sound = [
        outcome.measures
        for outcome, said in zip(outcomes, verdicts, strict=True)
        if said == "finished" and outcome.measures is not None
    ]

    def median(of: Callable[[Measures], float | None]) -> float:
        """Runs that did not come to their end count as the worst."""
        values = [value for one in sound if (value := of(one)) is not None]
        lowest_first = sorted([*values, *[inf] * (len(outcomes) - len(values))])
        low, high = lowest_first[(len(outcomes) - 1) // 2], lowest_first[len(outcomes) // 2]
        return low if low == high else 0.5 * (low + high)

    return Figures(
        variant=variant,
        runs=len(outcomes),
        trouble=_trouble(verdicts),
        settled_mm=median(lambda one: one.settled_mm),
        settled_all_mm=[one.settled_mm for one in sound],
        first_mm=median(lambda one: one.first_mm),
        worst_mm=median(lambda one: one.worst_mm),
        true_settled_mm=median(lambda one: one.true_settled_mm),
        true_first_mm=median(lambda one: one.true_first_mm),
        true_worst_mm=median(lambda one: one.true_worst_mm),
        floor_mm=_known(sound, lambda one: one.floor_mm),
        recovery_s=_known(sound, lambda one: slowest_s([r.back_s for r in one.recoveries])),
        true_recovery_s=_known(
            [one for one in sound if one.true_first_mm is not None],
            lambda one: slowest_s([r.true_back_s for r in one.recoveries]),
        ),
        overshoot_mm=_known(
            sound, lambda one: max((r.overshoot_mm for r in one.recoveries), default=None)
        ),
        effort_per_m=_known(sound, lambda one: one.effort_per_m),
        acceleration_per_s2=_known(sound, lambda one: one.acceleration_per_s2),
        times_as_long=_known(sound, lambda one: one.times_as_long) or 1.0,
        against_expected=_known(sound, lambda one: one.against_expected),
    )


def slowest_s(times_s: Sequence[float | None]) -> float | None:
    """Of all changes; infinite where the tip did not come back. None: there were none."""
    return max((inf if one is None else one for one in times_s), default=None)


def _known(sound: Sequence[Measures], of: Callable[[Measures], float | None]) -> float | None:
    values = [value for one in sound if (value := of(one)) is not None]
    return float(np.median(values)) if values else None


def _trouble(verdicts: Sequence[str]) -> str:
    other = sorted({said for said in verdicts if said != "finished"})
    return ", ".join(f"{verdicts.count(said)} {said}" for said in other)


def _compared(figures: Sequence[Figures]) -> list[Figures]:
    """With what each is against the best of those that kept the time."""
    ended = [one for one in figures if not one.failed and one.in_time]
    if not ended:
        return list(figures)
    best, noise = min(ended, key=lambda one: one.settled_mm), relative_noise(figures)
    return [
        msgspec.structs.replace(
            one,
            ratio=one.settled_mm / best.settled_mm,
            within_noise=one.in_time and no_worse(one, best, noise),
        )
        for one in figures
    ]


def relative_noise(figures: Sequence[Figures]) -> float:
    """Standard deviation of a settled error over seeds, as a share of it: the median over all
    controllers that came to their end with two seeds or more; 0: none did."""
    deviations = []
    for one in figures:
        values = one.settled_all_mm
        if len(values) > 1 and not one.failed:
            deviation = float(np.std(values, ddof=1)) / float(np.mean(values))
            deviations.append(deviation / _median_of_deviation(len(values) - 1))
    return float(np.median(deviations)) if deviations else 0.0


def _median_of_deviation(freedom: int) -> float:
    """The median of a standard deviation's estimate, of 1, by Wilson and Hilferty (1931)."""
    return float((1.0 - 2.0 / (9.0 * freedom)) ** 1.5)


def no_worse(one: Figures, other: Figures, noise: float) -> bool:
    """Whether one's settled error is above the other's by no more than noise, a share."""
    if one.failed:
        return False
    runs = [max(len(figures.settled_all_mm), 1) for figures in (one, other)]
    share = _STANDARD_ERRORS * noise * sqrt(sum(1.0 / count for count in runs))
    return one.settled_mm <= (1.0 + max(share, _LEAST_SHARE)) * other.settled_mm
