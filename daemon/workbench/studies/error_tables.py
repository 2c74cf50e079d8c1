"""A study's tables: the paper's figures and ours, one below the other, and what else was seen."""

from collections.abc import Sequence
from typing import Final

from config.tasks.study import Published, StudyTable
from daemon.workbench.studies.findings import Findings, cycles_of
from daemon.workbench.studies.pose_table import pose_aims
from daemon.workbench.studies.study_file import StudyFile
from daemon.workbench.studies.summary import CycleSummary, Spread, Summary
from daemon.workbench.studies.table import Section, Table, median_of, number, ordinal, range_of

_ERRORS: Final = (
    "Distance of the tip from its reference, as the tracker sees the tip, in mm. Ours: medians "
    "over all runs of a cycle's mean, its standard deviation (in brackets) and its maximum; [the "
    "mean of the best and of the worst run]. ∞: not reached in half of the runs, or in one."
)
_MORE: Final = (
    "Medians over all runs, cycle by cycle where there is more than one figure. True error: of the "
    "body's own tip, which no controller knows. Noise: what the error as the tracker sees it is if "
    "it is zero (single readings in brackets). Distortion: what the true error is then. Drift: "
    "distance between the axes' places at a cycle's beginning and at its end, in % of their "
    "travel. Settled: when the error's mean over the last quarter of a cycle was below 1 mm for "
    "good (0: the first one was), and in how many runs it was. Refused: steps, of all. Step: "
    "computing time of the controller in one step, median (99th percentile). Foretold: R² of the "
    "forward model that the controller began with, over all motions (median of its fields) [its "
    "root mean square error per coordinate, mm]."
)


def error_table(file: StudyFile, table: StudyTable, found: Findings) -> Table:
    """As the paper has it: mean and spread of each cycle, then the maxima."""
    names = _names(file, table)
    count = max(cycles_of(file.experiments[name]) for name in names)
    cycles = [ordinal(cycle) for cycle in range(count)]
    head = ["", *(f"{name} mean" for name in cycles), *(f"{name} max" for name in cycles), "runs"]
    made = Table(table.title, head, note=_ERRORS)
    for name in names:
        row = file.rows[name]
        section = Section(row.label)
        if row.published is not None:
            section.rows.append(_published_row(file.study.source, row.published, count))
        for variant in file.study.variants:
            mine = found.of(name, variant.variant)
            if mine is not None:
                section.rows.append(_own_row(variant.label, mine, count))
        if section.rows:
            made.sections.append(section)
    return made


def more_table(file: StudyFile, table: StudyTable, found: Findings) -> Table:
    """What the paper does not have."""
    head = (
        *("", "true error", "drift %", "settled s", "refused", "step ms", "noise", "distortion"),
        "foretold",
    )
    made = Table(f"{table.title}: more", head, note=_MORE)
    for name in _names(file, table):
        section = Section(file.rows[name].label)
        for variant in file.study.variants:
            mine = found.of(name, variant.variant)
            if mine is not None:
                section.rows.append([variant.label, *_more_cells(mine)])
        if section.rows:
            made.sections.append(section)
    return made


def comparison_table(file: StudyFile, found: Findings) -> Table:
    """Everything about every controller, in one table."""
    experiments = list(file.experiments.values())
    count = max(cycles_of(experiment) for experiment in experiments)
    cycles = [f"{ordinal(cycle)} mean (σ) max" for cycle in range(count)]
    head = (
        "",
        *cycles,
        "true, last",
        "drift %",
        "settled s",
        "refused",
        "step ms",
        "foretold",
        "runs",
    )
    note = f"{_ERRORS} {_MORE}"
    made = Table(file.study.description or file.study.study, head, note=note)
    for name, row in file.rows.items():
        section = Section(row.label)
        for variant in file.study.variants:
            mine = found.of(name, variant.variant)
            if mine is not None:
                section.rows.append([variant.label, *_comparison_cells(mine, count)])
        if section.rows:
            made.sections.append(section)
    return made


def aims_text(file: StudyFile, found: Findings) -> list[str]:
    """One line for each aim, reached or not."""
    labels = {variant.variant: variant.label for variant in file.study.variants}
    return [
        f"{'reached' if aim.reached else 'MISSED '}  {aim.experiment}, {labels[aim.variant]}: "
        f"{aim.text}"
        for aim in [*found.aims, *pose_aims(file, found)]
    ]


def trouble_text(file: StudyFile, found: Findings) -> list[str]:
    """What was held, unstable or given up, and why."""
    labels = {variant.variant: variant.label for variant in file.study.variants}
    lines = []
    for one in found.summaries:
        remarks = [one.trouble()] if one.trouble() else []
        if one.causes:
            remarks.append(f"causes: {', '.join(one.causes)}")
        if one.plant_failures:
            remarks.append(f"the body found no equilibrium {one.plant_failures} times")
        remarks += one.failures
        if remarks:
            lines.append(f"{one.experiment}, {labels[one.variant]}: {'; '.join(remarks)}")
    return lines


def _names(file: StudyFile, table: StudyTable) -> list[str]:
    return [name for name, row in file.rows.items() if row in table.rows]


def _published_row(source: str, published: Published, count: int) -> list[str]:
    def cell(values: Sequence[float | None], cycle: int) -> float | None:
        return values[cycle] if cycle < len(values) else None

    means = [
        f"{number(cell(published.mean_mm, cycle))} ({number(cell(published.std_mm, cycle))})"
        for cycle in range(count)
    ]
    most = [number(cell(published.max_mm, cycle)) for cycle in range(count)]
    return [source, *means, *most, ""]


def _own_row(label: str, mine: Summary, count: int) -> list[str]:
    padding = [""] * (count - len(mine.cycles))
    means = [
        f"{median_of(cycle.mean_mm)} ({median_of(cycle.std_mm)}) [{range_of(cycle.mean_mm)}]"
        for cycle in mine.cycles
    ]
    most = [median_of(cycle.max_mm) for cycle in mine.cycles]
    return [label, *means, *padding, *most, *padding, _runs(mine)]


def _more_cells(mine: Summary) -> list[str]:
    return [
        _by_cycle([cycle.true_mean_mm for cycle in mine.cycles]),
        _by_cycle([_percent(cycle.drift) for cycle in mine.cycles], 1),
        _settled(mine),
        median_of(mine.refusals, 0),
        _step(mine),
        f"{median_of(mine.noise_mm)} ({median_of(mine.reading_noise_mm)})",
        median_of(mine.distortion_mm),
        _foretold(mine),
    ]


def _comparison_cells(mine: Summary, count: int) -> list[str]:
    cycles = [_whole(cycle) for cycle in mine.cycles]
    return [
        *cycles,
        *[""] * (count - len(cycles)),
        median_of(mine.cycles[-1].true_mean_mm),
        _by_cycle([_percent(cycle.drift) for cycle in mine.cycles], 1),
        _settled(mine),
        median_of(mine.refusals, 0),
        _step(mine),
        _foretold(mine),
        _runs(mine),
    ]


def _whole(cycle: CycleSummary) -> str:
    mean, std, most = (median_of(one) for one in (cycle.mean_mm, cycle.std_mm, cycle.max_mm))
    return f"{mean} ({std}) {most}"


def _by_cycle(values: Sequence[Spread | None], digits: int = 2) -> str:
    return " / ".join(median_of(value, digits) for value in values)


def _percent(value: Spread) -> Spread:
    return Spread(
        median=100 * value.median,
        low=100 * value.low,
        first_quartile=100 * value.first_quartile,
        third_quartile=100 * value.third_quartile,
        high=100 * value.high,
    )


def _foretold(mine: Summary) -> str:
    if mine.fit_r2 is None:
        return "–"
    return (
        f"{median_of(mine.fit_r2)} ({median_of(mine.fit_field_r2)}) [{median_of(mine.fit_rmse_mm)}]"
    )


def _settled(mine: Summary) -> str:
    if not mine.converged:
        return "never"
    return f"{median_of(mine.converged_s, 0)} ({mine.converged} of {mine.runs})"


def _step(mine: Summary) -> str:
    return f"{median_of(mine.step_median_ms)} ({median_of(mine.step_p99_ms)})"


def _runs(mine: Summary) -> str:
    trouble = mine.trouble()
    return f"{mine.runs}: {trouble}" if trouble else str(mine.runs)
