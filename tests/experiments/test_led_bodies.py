"""What `python -m tests.experiments.led_bodies` asks, and how it judges what comes of it."""

from daemon.workbench.experiments.experiment_file import load_experiment
from tests.experiments.led_bodies import CIRCLE, case_of, figures_of


def test_cases_are_sound_experiments_that_repeat_themselves_and_differ() -> None:
    cases = [case_of(number) for number in range(40)]
    assert cases == [case_of(number) for number in range(40)]
    assert len({str(case) for case in cases}) == len(cases)
    for case in cases[:10]:
        experiment = load_experiment(CIRCLE, case).experiment
        assert experiment.happenings
        assert experiment.trajectory.kind == "circle"
    kinds = {(case["controller"]["kind"], case["controller"]["learning"]) for case in cases}
    assert len(kinds) == 4


def test_what_swings_or_fails_is_named_and_what_was_held_is_counted() -> None:
    lines = [
        {"case": 0, "verdict": "followed", "holds": 0, "faults": [], "mean_mm": [1.0, 0.3]},
        {"case": 1, "verdict": "held", "holds": 2, "faults": ["a", "a"], "mean_mm": [1.0, 0.5]},
        {"case": 2, "verdict": "unstable", "holds": 1, "faults": ["b"], "mean_mm": [9.0, 30.0]},
        {"case": 3, "verdict": "refused"},
        {"case": 4, "verdict": "failed"},
    ]
    figures = figures_of(lines)
    assert figures["unstable"] == [2]
    assert figures["failed"] == [4]
    assert figures["holds"] == 3
    assert figures["held_by"] == {"a": 2, "b": 1}
    assert figures["verdicts"]["refused"] == 1
