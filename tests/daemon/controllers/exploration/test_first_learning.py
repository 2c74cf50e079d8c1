"""What first motions tell of a body that nobody knows."""

import numpy as np
import pytest

from config.loader import load_robot
from config.tasks.controllers import RewardWeighted
from daemon.control.controller import Observation
from daemon.controllers.exploration.first_learning import FirstLearning
from daemon.learning.samples.motion import MotionSample
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector
from tests import SHIPPED_ROBOTS
from tests.daemon.control.closed_loop import DT_S

AXES = AxisRanges.of(load_robot(SHIPPED_ROBOTS / "three_tendon_arm.yaml").robot)
THIRDS = 2.0 * np.pi * np.arange(3) / 3.0
BENDS: Vector = 9.0 * np.array([np.cos(THIRDS), np.sin(THIRDS), np.zeros(3)])
"""(3, 3) mm per mm of three straight tendons."""


def test_what_all_tendons_do_together_is_not_learnt_from_the_little_of_it_that_was_done() -> None:
    random = np.random.default_rng(3)
    first = FirstLearning(RewardWeighted(kind="reward_weighted"), AXES, 1, 0.1)
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


FOUR = AxisRanges.of(load_robot(SHIPPED_ROBOTS / "tendon_arm.yaml").robot)
ACROSS = np.array([1.0, -1.0, 1.0, -1.0]) / 2.0
STIFFNESS = 1.0 * np.eye(4) + 6.0 * np.outer(ACROSS, ACROSS)
"""N/mm of four tendons round an arm: what pulls two of them that are opposite strains them all."""
STRUNG_N = 3.0


def lowest_tension_n(seed: int, known: bool = True) -> float:
    """Of all first motions, as steps are let through."""
    options = RewardWeighted(kind="reward_weighted", lag_s=0.1)
    first, targets, lowest_n = FirstLearning(options, FOUR, seed, 0.1), np.zeros(4), STRUNG_N
    first.begin(enough=False)
    tip, still = np.array([0.0, 0.0, 195.0]), np.zeros(3)
    while not first.over:
        tensions_n = STRUNG_N + STIFFNESS @ targets
        lowest_n = min(lowest_n, float(tensions_n.min()))
        told = tensions_n if known else None
        seen = Observation(0, DT_S, targets, targets, tip, still, tip, still, tensions_n=told)
        targets = targets + first.propose(seen).delta_u
    return lowest_n


@pytest.mark.parametrize("seed", range(4))
def test_first_motions_become_calmer_before_a_tendon_goes_slack(seed: int) -> None:
    assert lowest_tension_n(seed, known=False) < 0.0
    assert lowest_tension_n(seed) > 0.1 * STRUNG_N


def places(speed_mm_s: float) -> Vector:
    """(n, m) where the axes were told to be, while the filter has a tip at rest go so fast."""
    options = RewardWeighted(kind="reward_weighted", lag_s=0.1)
    first, targets, told = FirstLearning(options, AXES, 1, 0.1), np.zeros(3), []
    first.begin(enough=False)
    tip, fast, still = np.array([0.0, 0.0, 290.0]), np.array([speed_mm_s, 0.0, 0.0]), np.zeros(3)
    while not first.over:
        seen = Observation(0, DT_S, targets, targets, tip, fast, tip, still)
        targets = targets + first.propose(seen).delta_u
        told.append(targets)
    return np.array(told)


def test_a_tip_that_only_noise_moves_fast_calms_no_motions() -> None:
    np.testing.assert_array_equal(places(140.0), places(0.0))


def test_motions_that_are_gone_on_with_stay_round_the_place_where_they_began() -> None:
    options = RewardWeighted(kind="reward_weighted", lag_s=0.1)
    first, targets, farthest = FirstLearning(options, AXES, 0, 0.1), np.zeros(3), np.zeros(3)
    tip, still = np.array([0.0, 0.0, 290.0]), np.zeros(3)
    first.begin(enough=False)
    for _ in range(4):
        while not first.over:
            seen = Observation(0, DT_S, targets, targets, tip, still, tip, still)
            targets = targets + first.propose(seen).delta_u
            farthest = np.maximum(farthest, np.abs(targets))
        first.go_on()
    reach = options.babbling.reach_share + options.babbling.dither_share
    assert (farthest <= reach * AXES.scale).all()


@pytest.mark.parametrize(("noise_mm", "wider"), [(0.02, False), (0.4, True)])
def test_motions_that_are_seen_in_much_noise_go_on_wider_although_there_are_samples(
    noise_mm: float, wider: bool
) -> None:
    random = np.random.default_rng(2)
    first = FirstLearning(RewardWeighted(kind="reward_weighted"), AXES, 1, 0.1)
    first.begin(enough=False)
    jacobian = 0.1 * BENDS
    targets, farthest, still = np.zeros(3), np.zeros(3), np.zeros(3)
    for frame in range(600):
        tip = np.array([0.0, 0.0, 290.0]) + jacobian @ targets + noise_mm * random.normal(size=3)
        seen = Observation(frame * 25_000_000, DT_S, targets, targets, tip, still, tip, still)
        first.see(seen)
        if frame % 4 == 0:
            first.samples.append(MotionSample(tip, targets, still, still))
        targets = targets + first.propose(seen).delta_u
        farthest = np.maximum(farthest, np.abs(targets))
    babbling = RewardWeighted(kind="reward_weighted").babbling
    usual = (babbling.reach_share + babbling.dither_share) * AXES.scale
    assert (farthest > usual).any() == wider
