"""What a run was like: its figures by cycle, and the words that explain a failing assertion."""

from pathlib import Path

import pytest

from daemon.recording.result import CycleError, Result
from daemon.testing.tracking_result import TrackingResult


def error(cycle: int, mean_mm: float, samples: int = 100) -> CycleError:
    return CycleError(
        cycle=cycle, samples=samples, mean_mm=mean_mm, std_mm=0.1, max_mm=3.0 * mean_mm
    )


def tracked(problem: str = "") -> TrackingResult:
    result = Result(
        robot="soft_arm",
        simulated=True,
        trajectory="rectangle",
        controller="broyden",
        seed=7,
        duration_s=120.0,
        cycles=[error(0, 0.5), error(1, 0.2, samples=300)],
        steps=400,
        holds=1,
        refusals=0,
        final_state="armed",
        faults=["tracker_quality"],
        true_cycles=[error(0, 0.4)],
    )
    return TrackingResult("run-0", Path("kept"), 7, 2, result, problem)


def test_cycles_are_counted_from_one_and_explain_themselves() -> None:
    run = tracked()
    assert run.cycle(2).mean_mm == 0.2
    assert run.true_cycle(1).max_mm == pytest.approx(1.2)
    said = "cycle 2 of run-0: mean 0.200 mm, std 0.100 mm, max 0.600 mm"
    assert repr(run.cycle(2)) == said
    for missing in (0, 3):
        with pytest.raises(LookupError, match=f"no figures of a cycle {missing}"):
            run.cycle(missing)
    with pytest.raises(LookupError):
        run.true_cycle(2)


def test_over_all_cycles_each_sample_counts_the_same() -> None:
    assert tracked().mean_mm == pytest.approx((100 * 0.5 + 300 * 0.2) / 400)
    assert tracked().max_mm == 1.5


def test_the_explanation_has_every_cycle_what_held_it_and_how_it_ended() -> None:
    told = tracked().explanation().splitlines()
    assert told[0] == "run-0: rectangle, broyden"
    assert told[1] == "  seed 7, body 2, recorded in kept"
    assert told[3].split() == ["1", "0.500", "0.100", "1.500"]
    assert told[-1] == "  held 1 times by: tracker_quality; ended in armed"
    assert tracked("no way on").explanation().endswith("; no way on")


def test_a_report_gets_the_figures_by_name() -> None:
    rows = dict(tracked().properties())
    assert rows["cycle_2.mean_mm"] == 0.2
    assert (rows["seed"], rows["plant"], rows["holds"]) == (7, 2, 1)
