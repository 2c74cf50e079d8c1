"""The shipped path as by teleoperation is what the scripted hand makes."""

from importlib.resources import files
from pathlib import Path

import numpy as np

from daemon.reference.waypoints import read_waypoints
from tests.experiments.scripted_reaches import scripted_path


def test_the_soft_arms_teleoperated_path_is_the_scripted_hands() -> None:
    shipped = Path(str(files("config") / "experiments" / "soft_arm_teleoperated.csv"))
    times, points = read_waypoints(shipped, closed=False)
    np.testing.assert_allclose(np.column_stack([times, points]), scripted_path(), atol=6e-4)
