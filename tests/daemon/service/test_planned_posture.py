"""A planned path leads the tip, and draws the axes of controllers that have a posture."""

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import Broyden
from config.tasks.planned_path import PlannedPath
from config.tasks.trajectory import Planned
from daemon.controllers.broyden import BroydenController
from daemon.reference.trajectories import Trajectory, make_trajectory
from daemon.service.following import PostureDrawn, PostureReference
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS

TENDONS = SHIPPED_ROBOTS / "tendon_arm.yaml"


def trajectory() -> Trajectory:
    path = PlannedPath(
        tentacled_path=1,
        robot="tendon_arm",
        axes=("straight_1", "straight_2", "straight_3", "helical"),
        model_sha256="0" * 64,
        surroundings_sha256="0" * 64,
        t_s=(0.0, 1.0, 3.0),
        u=((0.0, 0.0, 0.0, 0.0), (2.0, -1.0, -1.0, 0.0), (2.0, -1.0, -1.0, 4.0)),
        tip_mm=((0.0, 0.0, 198.0), (10.0, 0.0, 197.0), (10.0, 4.0, 197.0)),
    )
    return make_trajectory(Planned(kind="planned", path=path), TENDONS.parent)


class Drawn:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.postures: list[Vector] = []

    def draw_to(self, posture: Vector) -> None:
        self.postures.append(posture)


def test_tip_and_posture_are_those_of_the_path_at_the_same_time() -> None:
    found = trajectory()
    assert found.duration_s == 3.0
    assert found.at(0.5)[0] == pytest.approx([5.0, 0.0, 197.5])
    assert found.posture_at(0.5) == pytest.approx([1.0, -0.5, -0.5, 0.0])
    assert found.posture_at(2.0) == pytest.approx([2.0, -1.0, -1.0, 2.0])
    assert found.posture_at(9.0) == pytest.approx([2.0, -1.0, -1.0, 4.0])


def test_with_every_step_the_controller_is_drawn_on() -> None:
    drawn = Drawn()
    reference = PostureReference(trajectory(), 5.0, drawn)
    reference.begin(np.array([0.0, 0.0, 198.0]))
    for _ in range(20):
        reference.advance(0, 0.1)
    assert drawn.postures[0] == pytest.approx(np.zeros(4), abs=0.3)
    assert drawn.postures[-1][3] > 1.0
    assert len(drawn.postures) >= 15


def test_a_controller_takes_the_posture() -> None:
    controller = BroydenController(Broyden(kind="broyden"), load_robot(TENDONS).robot)
    assert isinstance(controller, PostureDrawn)
    controller.draw_to(np.array([1.0, -0.5, -0.5, 2.0]))
    assert controller._follower.posture == pytest.approx([1.0, -0.5, -0.5, 2.0])


def test_a_path_is_gone_once() -> None:
    path = trajectory().path
    with pytest.raises(ValueError, match="gone once"):
        make_trajectory(Planned(kind="planned", path=path), TENDONS.parent, 2)
