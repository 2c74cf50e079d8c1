"""What many runs of one experiment with one controller come to: medians, and how far they spread.

A run that was given up has no error in the cycles that it did not finish. There it counts as
infinite: it makes a median worse, and is never left out.
"""

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import TypeVar

import msgspec
import numpy as np

from daemon.recording.result import CycleError, Result
from daemon.workbench.studies.run import Outcome, Verdict

T = TypeVar("T")


class Spread(msgspec.Struct, frozen=True, kw_only=True):
    """One figure of many runs. Infinite (null in JSON) where a run did not come so far."""

    median: float
    low: float
    first_quartile: float
    third_quartile: float
    high: float


class CycleSummary(msgspec.Struct, frozen=True, kw_only=True):
    """One cycle, over all runs. Errors in mm."""

    cycle: int
    """From 0."""
    mean_mm: Spread
    """Of the filtered tip, as all that has no other name."""
    std_mm: Spread
    max_mm: Spread
    reading_mean_mm: Spread
    true_mean_mm: Spread | None
    true_max_mm: Spread | None
    drift: Spread
    """Shares of the axes' travel."""


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """One experiment with one controller."""

    experiment: str
    variant: str
    runs: int
    """That were carried out."""
    verdicts: dict[Verdict, int]
    failures: list[str]
    """Why runs were given up; each reason once."""
    causes: list[str]
    """What held runs; each cause once."""
    cycles: list[CycleSummary]
    converged: int
    """Runs whose error settled below 1 mm: of one that was given up nobody knows."""
    converged_s: Spread | None
    """Of those."""
    refusals: Spread | None
    holds: Spread | None
    step_median_ms: Spread | None
    step_p99_ms: Spread | None
    idle_mean_ms: Spread | None
    noise_mm: Spread | None
    reading_noise_mm: Spread | None
    distortion_mm: Spread | None
    plant_failures: int
    """Of all runs together."""
    fit_r2: Spread | None = None
    """R² of the forward models that the controllers began with, over all motions."""
    fit_rmse_mm: Spread | None = None
    fit_field_r2: Spread | None = None
    """Of each model the median over its fields."""

    def trouble(self) -> str:
        """What did not go well, in few words; empty: nothing."""
        other = [f"{count} {name}" for name, count in self.verdicts.items() if name != "finished"]
        return ", ".join(other)


def summary(outcomes: Sequence[Outcome], cycles: int, unstable_above_mm: float) -> Summary:
    """outcomes: one or more of one experiment and one variant. cycles: of its trajectory."""
    results = [outcome.result for outcome in outcomes if outcome.result is not None]
    timed = [result.computing for result in results if result.computing is not None]
    limits = [result.limits for result in results if result.limits is not None]
    fits = [outcome.fit for outcome in outcomes if outcome.fit is not None]
    settled = [
        outcome.result.converged_s
        for outcome in outcomes
        if outcome.result is not None and not outcome.failure
    ]
    verdicts: dict[Verdict, int] = {}
    for verdict in sorted(outcome.verdict(unstable_above_mm) for outcome in outcomes):
        verdicts[verdict] = verdicts.get(verdict, 0) + 1
    return Summary(
        experiment=outcomes[0].experiment,
        variant=outcomes[0].variant,
        runs=len(outcomes),
        verdicts=verdicts,
        failures=sorted({outcome.failure for outcome in outcomes if outcome.failure}),
        causes=sorted({cause for result in results for cause in result.faults}),
        cycles=[_cycle(outcomes, number) for number in range(cycles)],
        converged=sum(at_s is not None for at_s in settled),
        converged_s=_spread_of(settled, lambda at_s: at_s),
        refusals=_spread_of(results, lambda result: result.refusals),
        holds=_spread_of(results, lambda result: result.holds),
        step_median_ms=_spread_of(timed, lambda one: one.median_ms),
        step_p99_ms=_spread_of(timed, lambda one: one.p99_ms),
        idle_mean_ms=_spread_of(timed, lambda one: one.idle_mean_ms),
        noise_mm=_spread_of(limits, lambda one: one.noise_mm),
        reading_noise_mm=_spread_of(limits, lambda one: one.reading_noise_mm),
        distortion_mm=_spread_of(limits, lambda one: one.distortion_mm),
        plant_failures=sum(result.plant_failures for result in results),
        fit_r2=_spread_of(fits, lambda fit: fit.r2),
        fit_rmse_mm=_spread_of(fits, lambda fit: fit.rmse_mm),
        fit_field_r2=_spread_of(fits, lambda fit: fit.field_r2[1] if fit.field_r2 else None),
    )


def spread(values: Sequence[float]) -> Spread:
    """Of one value or more; they may be infinite."""
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    quartiles = (_quantile(ordered, share) for share in (0.25, 0.5, 0.75))
    first, median, third = quartiles
    return Spread(
        median=median,
        low=float(ordered[0]),
        first_quartile=first,
        third_quartile=third,
        high=float(ordered[-1]),
    )


def cycle_mean_mm(outcome: Outcome, cycle: int) -> float:
    """The mean error of a cycle; infinite where the run did not finish it."""
    return _of_cycle(outcome, cycle, lambda result: result.cycles, lambda row: row.mean_mm)


def _cycle(outcomes: Sequence[Outcome], number: int) -> CycleSummary:
    def of(rows: Callable[[Result], Sequence[CycleError]], what: str) -> Spread:
        return spread(
            [_of_cycle(one, number, rows, lambda row: getattr(row, what)) for one in outcomes]
        )

    known = any(outcome.result and outcome.result.true_cycles for outcome in outcomes)
    return CycleSummary(
        cycle=number,
        mean_mm=of(lambda result: result.cycles, "mean_mm"),
        std_mm=of(lambda result: result.cycles, "std_mm"),
        max_mm=of(lambda result: result.cycles, "max_mm"),
        reading_mean_mm=of(lambda result: result.reading_cycles, "mean_mm"),
        true_mean_mm=of(lambda result: result.true_cycles, "mean_mm") if known else None,
        true_max_mm=of(lambda result: result.true_cycles, "max_mm") if known else None,
        drift=spread([_drift(outcome, number) for outcome in outcomes]),
    )


def _of_cycle(
    outcome: Outcome,
    number: int,
    rows: Callable[[Result], Sequence[CycleError]],
    value: Callable[[CycleError], float],
) -> float:
    result = outcome.result
    if result is None or _given_up_in(outcome, number):
        return inf
    found = [value(row) for row in rows(result) if row.cycle == number]
    return found[0] if found else inf


def _drift(outcome: Outcome, number: int) -> float:
    result = outcome.result
    if result is None or _given_up_in(outcome, number) or number >= len(result.drifts):
        return inf
    return result.drifts[number]


def _given_up_in(outcome: Outcome, number: int) -> bool:
    """Whether a run failed in this cycle: half a cycle is none."""
    assert outcome.result is not None
    begun = [row.cycle for row in outcome.result.cycles]
    return bool(outcome.failure) and bool(begun) and number >= max(begun)


def _quantile(ordered: "np.ndarray[tuple[int], np.dtype[np.float64]]", share: float) -> float:
    """Between the two nearest values; infinite from where one of them is."""
    place = share * (len(ordered) - 1)
    below = int(place)
    low, rest = float(ordered[below]), place - below
    if not rest or low == inf:
        return low
    high = float(ordered[below + 1])
    return inf if high == inf else low + rest * (high - low)


def _spread_of(measured: Iterable[T], of: Callable[[T], float | None]) -> Spread | None:
    values = [value for value in map(of, measured) if value is not None]
    return spread(values) if values else None
