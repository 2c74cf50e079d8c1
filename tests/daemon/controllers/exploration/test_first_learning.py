"""What first motions tell of a body that nobody knows."""

import numpy as np

from config.loader import load_robot
from config.tasks.controllers import RewardWeighted
from daemon.controllers.exploration.first_learning import FirstLearning
from daemon.learning.samples.motion import MotionSample
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS

AXES = AxisRanges.of(load_robot(SHIPPED_ROBOTS / "three_tendon_arm.yaml").robot)
THIRDS = 2.0 * np.pi * np.arange(3) / 3.0
BENDS: Vector = 9.0 * np.array([np.cos(THIRDS), np.sin(THIRDS), np.zeros(3)])
"""(3, 3) mm per mm of three straight tendons."""


def test_what_all_tendons_do_together_is_not_learnt_from_the_little_of_it_that_was_done() -> None:
    random, first = (
        np.random.default_rng(3),
        FirstLearning(RewardWeighted(kind="reward_weighted"), AXES, 1, 0.1),
    )
    for swing in random.normal(scale=0.3, size=(40, 3)):
        delta_u = AXES.less_together(swing, 0.05)
        rubs_mm = 2.0 * np.sign(swing[0]) * np.array([1.0, 0.0, 0.0])
        first.samples.append(
            MotionSample(np.zeros(3), np.zeros(3), delta_u, BENDS @ delta_u + rubs_mm)
        )
    jacobian = first.jacobian()
    assert jacobian is not None
    np.testing.assert_allclose(jacobian.sum(axis=1), 0.0, atol=0.1)
    np.testing.assert_allclose(jacobian[1:], BENDS[1:], atol=1.0)
    assert (np.sign(jacobian[0]) == np.sign(BENDS[0])).all()
