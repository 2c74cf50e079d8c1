"""Tuning a study's controllers: the same search with the same effort for each of them.

Sobol points over the options that a variant declares, halved by and by: many points on few cells
first, the better half of them on twice as many, until few points have seen all cells. What a point
is worth is the mean over its runs of the logarithm of the settled error; a run that was not
finished counts as one that is unstable.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from typing import Final

from scipy.stats import qmc

from config.tasks.study import Study, Variant
from config.tasks.study_matrix import Range
from daemon.workbench.studies.run import Outcome, PlanError
from daemon.workbench.studies.study_file import StudyFile

_DIGITS: Final = 3
"""Of an option's figure: nothing depends on more."""
_LEAST_MM: Final = 0.01
"""No tracker tells less."""


@dataclass(frozen=True)
class Candidate:
    """A point of the search, as a variant of its own."""

    of: str
    """The variant that is tuned."""
    options: Mapping[str, float]
    variant: Variant


@dataclass(frozen=True)
class Stage:
    """So many points of each variant, on so many of the cells."""

    points: int
    cells: int


def stages(points: int, cells: int) -> list[Stage]:
    """Half of the points, twice the cells, until two points are left or one."""
    counts = [points]
    while counts[-1] > 2:
        counts.append(-(-counts[-1] // 2))
    last = len(counts) - 1
    return [Stage(count, max(1, cells >> (last - k))) for k, count in enumerate(counts)]


def candidates(study: Study, points: int, seed: int, only: Sequence[str] = ()) -> list[Candidate]:
    """Of every variant that declares options, or of these: so many points each.

    Raises PlanError where nothing is to be tuned.
    """
    tuned = {variant.variant: variant for variant in study.variants if variant.tune}
    if not tuned:
        raise PlanError("no variant of this study says by `tune` which options are to be sought")
    unknown = [name for name in only if name not in tuned]
    if unknown:
        raise PlanError(
            f"no options of {', '.join(unknown)} are to be sought in this study: those of "
            f"{', '.join(tuned)} are"
        )
    return [
        _candidate(tuned[name], number, options)
        for name in only or tuned
        for number, options in enumerate(_points(tuned[name].tune, points, seed))
    ]


def with_candidates(file: StudyFile, made: Sequence[Candidate]) -> StudyFile:
    """The study, with these instead of its variants."""
    variants = [candidate.variant for candidate in made]
    study = file.study.model_copy(update={"variants": variants, "judged": None})
    return replace(file, study=study)


def scores(outcomes: Sequence[Outcome], study: Study) -> dict[str, float]:
    """By variant: the mean of the logarithms of its runs' settled errors in mm.

    What all refuse nobody can follow, and it counts for nobody. Who refuses alone has not finished.
    """

    def where(outcome: Outcome) -> tuple[str, int, int]:
        return outcome.experiment, outcome.plant, outcome.seed

    possible = {where(outcome) for outcome in outcomes if not outcome.refused}
    logs: dict[str, list[float]] = {}
    for outcome in outcomes:
        finished = outcome.verdict(study.unstable_above_mm) == "finished"
        error_mm = study.unstable_above_mm
        if finished and outcome.measures is not None:
            error_mm = max(outcome.measures.settled_mm, _LEAST_MM)
        if where(outcome) in possible:
            logs.setdefault(outcome.variant, []).append(log(error_mm))
    return {variant: sum(values) / len(values) for variant, values in logs.items()}


def survivors(
    made: Sequence[Candidate], scored: Mapping[str, float], count: int
) -> list[Candidate]:
    """The best of each variant, the best first; of equal ones the earlier."""
    kept = []
    for of in dict.fromkeys(candidate.of for candidate in made):
        mine = [candidate for candidate in made if candidate.of == of]
        mine.sort(key=lambda one: scored.get(one.variant.variant, float("inf")))
        kept += mine[:count]
    return kept


def tuned_text(
    study: Study, winners: Sequence[Candidate], scored: Mapping[str, float], search: str
) -> str:
    """The file that a study names as `tuned`."""
    lines = [f"tuned: {study.study}", f"search: {search}", "variants:"]
    for one in winners:
        options = ", ".join(f"{name}: {value:g}" for name, value in one.options.items())
        error_mm = exp(scored[one.variant.variant])
        lines.append(f"  {one.of}: {{{options}}}  # {error_mm:.3g} mm, geometric mean")
    return "\n".join(lines) + "\n"


def search_text(file: StudyFile, points: int, seed: int, bodies: Sequence[int]) -> str:
    """How it was sought, in a sentence."""
    first = ", ".join(map(str, bodies))
    return (
        f"All variants were tuned by the same search of the same effort, {points} Sobol points "
        f"with seed {seed}, halved over {len(file.experiments)} cells of the study "
        f"{file.study.study}, on bodies that are not in the table (number {first})."
    )


def _candidate(variant: Variant, number: int, options: Mapping[str, float]) -> Candidate:
    controller = {**variant.controller, **options}
    name = f"{variant.variant}_{number}"
    update = {"variant": name, "controller": controller, "tune": {}}
    return Candidate(variant.variant, options, variant.model_copy(update=update))


def _points(ranges: Mapping[str, Range], count: int, seed: int) -> list[dict[str, float]]:
    sobol = qmc.Sobol(len(ranges), seed=seed)
    shares = sobol.random_base2(max(count - 1, 0).bit_length())[:count]
    return [
        {name: _within(one, share) for (name, one), share in zip(ranges.items(), row, strict=True)}
        for row in shares.tolist()
    ]


def _within(one: Range, share: float) -> float:
    if one.log:
        value = one.low * (one.high / one.low) ** share
    else:
        value = one.low + share * (one.high - one.low)
    return float(f"{value:.{_DIGITS}g}")
