"""A tracker on a slow line brings nine frames in a second, and the robot goes on all the same."""

from pathlib import Path

import numpy as np

from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from tests import SHIPPED_ROBOTS

EXPERIMENT = """experiment: slow_line
robot: robot.yaml
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 25, cycle_s: 7.9, cycles: 3}
controller: {kind: broyden, lead: true, gain_per_s: 6.0, max_tip_speed_mm_s: 80.0}
blend_speed_mm_s: 20.0
risk: false
"""


def on_a_slow_line() -> str:
    """The soft arm's file, with what its operator has to say of frames that are so far apart."""
    text = (SHIPPED_ROBOTS / "soft_arm.yaml").read_text()
    for old, new in (
        ("baud_rate: 115200", "baud_rate: 9600"),
        ("port: lab:aurora  ", "port: lab:aurora\n  silent_after_s: 0.4"),
        ("tracker_hold_after_s: 0.15", "tracker_quality: 0.15\n  tracker_hold_after_s: 0.5"),
    ):
        assert old in text
        text = text.replace(old, new)
    return text + "\npose_filter: {predict_for_s: 0.4}\n"


def test_a_circle_is_followed_with_nine_frames_in_a_second(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text(on_a_slow_line())
    path = tmp_path / "experiment.yaml"
    path.write_text(EXPERIMENT)
    (tmp_path / "run").mkdir()
    result = carry_out_in_virtual_time(load_experiment(path), 1, tmp_path / "run", lambda _: None)
    assert result.holds == 0
    steps = np.load(tmp_path / "run" / "steps.npz")["clock_s"]
    assert 0.09 < float(np.median(np.diff(steps))) < 0.14
    # What is learnt of axes at the wrong time makes the tip swing from the third cycle on.
    assert max(cycle.mean_mm for cycle in result.cycles) < 1.3
