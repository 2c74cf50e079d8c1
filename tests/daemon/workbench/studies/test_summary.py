"""Medians and spreads over runs; what went wrong is counted, and makes no figure better."""

from math import inf, isinf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.recording.result import Result
from daemon.workbench.studies.run import Outcome
from daemon.workbench.studies.summary import cycle_mean_mm, spread, summary
from tests.daemon.workbench.studies.made_up import outcome

UNSTABLE_MM = 20.0


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=40))
def test_a_spread_says_what_the_plain_quantiles_say(values: list[float]) -> None:
    found = spread(values)
    told = [found.low, found.first_quartile, found.median, found.third_quartile, found.high]
    np.testing.assert_allclose(told, np.quantile(values, [0, 0.25, 0.5, 0.75, 1]), atol=1e-9)


@given(st.lists(st.floats(0, 10), min_size=1, max_size=10), st.integers(0, 10))
def test_runs_that_did_not_come_so_far_are_the_worst(values: list[float], lost: int) -> None:
    found = spread([*values, *[inf] * lost])
    assert isinf(found.high) == (lost > 0)
    assert isinf(found.median) == (lost >= len(values))
    assert found.median >= spread(values).median


def test_each_cycle_has_its_median_over_the_runs() -> None:
    found = summary([outcome([m, m / 2], seed) for seed, m in enumerate((2, 8, 3))], 2, 99.0)
    assert [cycle.mean_mm.median for cycle in found.cycles] == [3.0, 1.5]
    assert (found.cycles[0].mean_mm.low, found.cycles[0].mean_mm.high) == (2.0, 8.0)
    assert found.cycles[0].max_mm.median == 9.0
    assert found.cycles[0].reading_mean_mm.median == 3.2
    assert found.cycles[1].true_mean_mm is not None
    assert found.cycles[1].true_mean_mm.median == 1.6
    assert found.cycles[1].drift.median == pytest.approx(0.02)
    assert (found.runs, found.verdicts, found.trouble()) == (3, {"finished": 3}, "")


def test_a_run_that_was_given_up_has_no_figure_from_its_last_cycle_on() -> None:
    lost = outcome([1.0, 0.1], failure="the robot is fault: node_lost")
    assert [cycle_mean_mm(lost, cycle) for cycle in range(3)] == [1.0, inf, inf]
    found = summary([lost, outcome([2.0, 2.0, 2.0], 2), outcome([3.0, 3.0, 3.0], 3)], 3, 99.0)
    assert [cycle.mean_mm.median for cycle in found.cycles] == [2.0, 3.0, 3.0]
    assert isinf(found.cycles[2].drift.high)
    assert found.failures == ["the robot is fault: node_lost"]
    assert found.trouble() == "1 failed"


def test_a_run_that_never_began_counts_too() -> None:
    nothing = Outcome(
        experiment="loaded",
        variant="broyden",
        plant=1,
        seed=9,
        fingerprint="",
        failure="the robot did not get ready",
    )
    found = summary([nothing, outcome([1.0])], 1, 99.0)
    assert isinf(found.cycles[0].mean_mm.median)
    assert found.verdicts == {"failed": 1, "finished": 1}


@pytest.mark.parametrize(
    ("one", "verdict"),
    [
        (outcome([1.0, 2.0]), "finished"),
        (outcome([1.0, 2.0], holds=2), "held"),
        (outcome([1.0, 7.0], holds=2), "unstable"),
        (outcome([1.0, 7.0], failure="given up"), "failed"),
    ],
)
def test_the_worst_is_said_of_a_run(one: Outcome, verdict: str) -> None:
    assert one.verdict(UNSTABLE_MM) == verdict
    told = summary([one], 2, UNSTABLE_MM)
    assert told.trouble() == ("" if verdict == "finished" else f"1 {verdict}")


def test_what_held_runs_is_named() -> None:
    assert summary([outcome([1.0], holds=1)], 1, 99.0).causes == ["tracker_late"]


def test_only_runs_that_settled_say_when() -> None:
    found = summary([outcome([1.0], settled_s=40.0), outcome([1.0])], 1, 99.0)
    assert found.converged == 1
    assert found.converged_s is not None
    assert found.converged_s.median == 40.0
    assert summary([outcome([1.0])], 1, 99.0).converged_s is None


def test_a_run_that_was_given_up_has_not_settled() -> None:
    """However small its error was until then."""
    lost = outcome([0.5], settled_s=0.0, failure="the robot is fault: node_lost")
    found = summary([lost, outcome([1.0], settled_s=40.0)], 2, 99.0)
    assert found.converged == 1
    assert found.converged_s is not None
    assert (found.converged_s.low, found.converged_s.high) == (40.0, 40.0)


def test_results_of_before_have_no_such_figures() -> None:
    bare = Result(
        robot="soft_arm",
        simulated=True,
        trajectory="circle",
        controller="broyden",
        seed=1,
        duration_s=1.0,
        cycles=[],
        steps=0,
        holds=0,
        refusals=0,
    )
    old = Outcome(experiment="a", variant="b", plant=0, seed=1, fingerprint="", result=bare)
    found = summary([old], 1, 99.0)
    assert found.noise_mm is None
    assert found.step_median_ms is None
    assert found.cycles[0].true_mean_mm is None
