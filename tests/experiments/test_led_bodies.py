"""What the experiments that lead random bodies ask, and how they judge it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from daemon.workbench.experiments.experiment_file import load_experiment
from tests.experiments import (
    led_designs,
    led_hard_designs,
    led_paths,
    led_tendon_designs,
    led_tendons,
    led_tube_designs,
    led_tubes,
)
from tests.experiments.led_bodies import (
    CIRCLE,
    LASTS_S,
    case_of,
    errors_mm,
    figures_of,
    worst_at_the_end_mm,
)


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


def _line(case: int, verdict: str, faults: list[str], end: float, mean: list[float]) -> Any:
    figures = {"holds": len(faults), "faults": faults, "end_mm": end, "mean_mm": mean}
    return {"case": case, "verdict": verdict, **figures}


def test_what_swings_or_fails_is_named_and_what_was_held_is_counted() -> None:
    lines = [
        _line(0, "followed", [], 0.4, [1.0, 0.3]),
        _line(1, "held", ["a", "a"], 0.8, [1.0, 0.5]),
        _line(2, "unstable", ["b"], 31.0, [9.0, 30.0]),
        {"case": 3, "verdict": "refused"},
        {"case": 4, "verdict": "failed"},
    ]
    figures = figures_of(lines)
    assert figures["unstable"] == [2]
    assert figures["failed"] == [4]
    assert figures["holds"] == 3
    assert figures["held_by"] == {"a": 2, "b": 1}
    assert figures["verdicts"]["refused"] == 1


def test_a_load_that_falls_late_is_none_that_swings_and_the_end_is_judged() -> None:
    t_s = np.arange(0.0, 12.0, 0.025)
    loaded = np.where(t_s < 5.6, 0.4, 22.0 * np.exp(-2.0 * (t_s - 5.6)))
    swings = np.where(t_s < 5.6, 0.4, 9.0 + 3.0 * np.sin(t_s))
    assert worst_at_the_end_mm(np.column_stack([t_s, loaded])) < 1.0
    assert worst_at_the_end_mm(np.column_stack([t_s, swings])) > 10.0
    assert worst_at_the_end_mm(np.zeros((0, 2))) == np.inf


def test_every_path_goes_on_long_enough_after_its_load_to_be_judged() -> None:
    for case in map(case_of, range(1000)):
        path, plant = case["trajectory"], case["plant"]
        left_s = path["cycles"] * path["cycle_s"] - 0.4 * LASTS_S
        assert left_s - 3.0 > plant["dead_time_s"] + 2.0 * plant["pneumatic_lag_s"] + 0.4 - 0.05


def test_what_is_judged_is_the_path_and_not_the_way_to_it() -> None:
    way = {"t_ns": 0, "state": "running", "cycle": -1, "error_mm": 40.0}
    held = {"t_ns": 1, "state": "hold", "cycle": 0, "error_mm": 30.0}
    path = {"t_ns": 2_000_000_000, "state": "running", "cycle": 0, "error_mm": 0.5}
    assert errors_mm([way, held, path]).tolist() == [[2.0, 0.5]]


@pytest.mark.parametrize(
    ("case_of", "experiment"),
    [
        (led_paths.case_of, led_paths.SOFT_ARM),
        (led_tendons.case_of, led_tendons.TENDON_ARM),
        (led_tubes.case_of, led_tubes.CTR_CIRCLE),
    ],
    ids=["soft arms", "tendon arms", "tubes"],
)
def test_paths_are_sound_experiments_of_every_kind_that_repeat_themselves(
    case_of: Callable[[int], dict[str, Any]], experiment: Path
) -> None:
    cases = [case_of(number) for number in range(60)]
    assert cases == [case_of(number) for number in range(60)]
    kinds = {load_experiment(experiment, case).experiment.trajectory.kind for case in cases}
    assert kinds == {"circle", "rectangle", "star", "lissajous", "helix", "random_smooth"}
    assert all(case["trajectory"]["cycles"] >= 2 for case in cases)


def test_designs_are_sound_robots_with_a_drive_for_every_chamber(tmp_path: Path) -> None:
    counts = set()
    for number in range(12):
        robot, case = led_designs.case_of(number)
        assert (robot, case) == led_designs.case_of(number)
        path = tmp_path / f"{number}.yaml"
        path.write_text(yaml.safe_dump(robot, sort_keys=False))
        file = load_experiment(led_paths.SOFT_ARM, {"robot": str(path)} | case)
        segments = robot["emulation"]["plant"]["segments"]
        assert len(file.robot.axes) == sum(one["chambers"] for one in segments)
        counts.add(len(segments))
    assert counts == {1, 2, 3}


def test_hard_designs_are_late_loaded_bodies_of_designs_that_are_not() -> None:
    robot, case = led_hard_designs.case_of(2)
    assert (robot, case) == led_hard_designs.case_of(2)
    easy, path = led_designs.case_of(102)
    assert (robot, case["trajectory"]) == (easy, path["trajectory"])
    assert len(case["plant"]["chamber_area_ratios"]) == len(robot["axes"])
    assert 6.0 <= case["happenings"][0]["at_s"] <= 10.0


def test_designs_of_other_kinds_are_sound_robots_on_paths_that_their_bodies_reach(
    tmp_path: Path,
) -> None:
    _, tendons, pulled = led_tendon_designs.case_of(4)
    tubes, turned, _ = led_tube_designs.case_of(4)
    for experiment, robot, case in (
        (led_tendons.TENDON_ARM, tendons, pulled),
        (led_tubes.CTR_CIRCLE, tubes, turned),
    ):
        path = tmp_path / f"{experiment.stem}.yaml"
        path.write_text(yaml.safe_dump(robot, sort_keys=False))
        file = load_experiment(experiment, {"robot": str(path)} | case)
        points = getattr(file.experiment.trajectory, "points", None)
        assert points is not None and points[0][1:] == points[-1][1:]
    assert len(tendons["emulation"]["plant"]["tendons"]) == 8
