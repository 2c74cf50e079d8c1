"""What a study has found so far: summaries of its runs, and what became of its aims."""

from collections.abc import Sequence
from math import isfinite
from typing import Final

import msgspec

from daemon.reference.trajectories import make_trajectory
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.studies.run import Outcome, Verdict
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import Summary, cycle_mean_mm, summary
from daemon.workbench.studies.table import number

_LOST: Final[tuple[Verdict, ...]] = ("unstable", "failed", "refused")
"""What is said of runs that were given up, before anything moved or later, or should have been."""


class StudyAim(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that the study set out to show, for one controller."""

    experiment: str
    variant: str
    text: str
    reached: bool


class Findings(msgspec.Struct, frozen=True, kw_only=True):
    """Of all runs that are done."""

    study: str
    planned: int
    """Runs of the study, done or not."""
    commits: list[str]
    """Of the programs that made them; more than one: they do not quite compare."""
    summaries: list[Summary]
    """Experiment by experiment; one that was not run is not there."""
    aims: list[StudyAim]
    runs: list[Outcome]

    def of(self, experiment: str, variant: str) -> Summary | None:
        """None: nothing of it was run."""
        for one in self.summaries:
            if (one.experiment, one.variant) == (experiment, variant):
                return one
        return None


def findings(file: StudyFile, outcomes: Sequence[Outcome], planned: int) -> Findings:
    """outcomes: in any order. planned: runs of the whole study."""
    grouped: dict[tuple[str, str], list[Outcome]] = {}
    for outcome in outcomes:
        grouped.setdefault((outcome.experiment, outcome.variant), []).append(outcome)
    found = []
    for name, experiment in file.experiments.items():
        for variant in file.study.variants:
            mine = grouped.get((name, variant.variant))
            if mine:
                found.append(summary(mine, cycles_of(experiment), file.study.unstable_above_mm))
    return Findings(
        study=file.study.study,
        planned=planned,
        commits=sorted({outcome.commit for outcome in outcomes if outcome.commit}),
        summaries=found,
        aims=_aims(file, found, grouped),
        runs=list(outcomes),
    )


def cycles_of(file: ExperimentFile) -> int:
    """Cycles of an experiment's trajectory."""
    return make_trajectory(file.experiment.trajectory, file.path.parent).cycles


def _aims(
    file: StudyFile,
    summaries: Sequence[Summary],
    grouped: dict[tuple[str, str], list[Outcome]],
) -> list[StudyAim]:
    aims = []
    for one in summaries:
        row = file.rows[one.experiment]
        for cycle, aim_mm in zip(one.cycles, row.aim_mm or (), strict=False):
            if aim_mm is not None:
                mean_mm = cycle.mean_mm.median
                text = f"cycle {cycle.cycle + 1}: {number(mean_mm)} mm, at most {number(aim_mm)} mm"
                aims.append(_aim(one, text, mean_mm <= aim_mm))
        if row.aim_mm is not None:
            runs = f"{one.runs} runs"
            lost = sum(one.verdicts.get(verdict, 0) for verdict in _LOST)
            aims.append(_aim(one, f"{lost} of {runs} unstable or given up", not lost))
        others = grouped.get((row.first_no_worse_than or "", one.variant))
        if others:
            aims.append(_first_no_worse(one, grouped[one.experiment, one.variant], others))
    return aims


def _first_no_worse(one: Summary, mine: Sequence[Outcome], others: Sequence[Outcome]) -> StudyAim:
    """Compares run by run: same body, same tracker. A run that was lost is worse than any."""
    other_mm = {(run.plant, run.seed): cycle_mean_mm(run, 0) for run in others}
    pairs = [
        (cycle_mean_mm(run, 0), other_mm[run.plant, run.seed])
        for run in mine
        if (run.plant, run.seed) in other_mm
    ]
    better = sum(here <= there for here, there in pairs if isfinite(here))
    text = f"first cycle no worse than in {others[0].experiment}: {better} of {len(pairs)} runs"
    return _aim(one, text, 2 * better > len(pairs))


def _aim(one: Summary, text: str, reached: bool) -> StudyAim:
    return StudyAim(experiment=one.experiment, variant=one.variant, text=text, reached=reached)
