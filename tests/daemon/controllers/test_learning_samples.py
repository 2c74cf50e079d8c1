"""Which frames a controller learns from while it works: those in between that nobody believes."""

import numpy as np
import pytest

from daemon.control.controller import Observation
from daemon.controllers.learning_samples import LearningSamples
from daemon.controllers.learnt_jacobian import LearntJacobian
from daemon.learning.samples.motion import MotionSample
from daemon.learning.samples.motion_samples import SamplingSettings
from drivers.pose import Vector
from tests.daemon.control.closed_loop import ROBOT, made_learner

DT_S = 0.01
"""Of a fast tracker."""
TRAVEL = np.full(6, 50.0)
SPEED = np.array([3.0, -2.0, 1.0, 2.0, -1.0, 3.0])
"""mm/s of the axes."""
TIP_MM_S = np.array([8.0, 4.0, -6.0])


def learning_samples() -> LearningSamples:
    options = made_learner("forward_jacobian")._options
    assert len(TRAVEL) == len(ROBOT.axes)
    sampling = SamplingSettings(tip_mm=1.0, travel_share=0.1, longest_s=4.0)
    return LearningSamples(sampling, TRAVEL, 0.3, LearntJacobian(options, TRAVEL))


def seen(k: int, believed: bool = True, off_mm: Vector | float = 0.0) -> Observation:
    """The k-th frame of an even motion. off_mm: (3,) that the tip is elsewhere."""
    t_s, still = k * DT_S, np.zeros(3)
    u, tip_mm = 20.0 + SPEED * t_s, TIP_MM_S * t_s + off_mm
    t_ns = round(t_s * 1e9)
    return Observation(t_ns, DT_S, u, u, tip_mm, TIP_MM_S, tip_mm, still, believed)


def samples_of(frames: list[Observation]) -> list[MotionSample]:
    samples = learning_samples()
    return [one for one in map(samples.add, frames) if one is not None]


@pytest.mark.parametrize("every", [33, 10, 3])
def test_frames_that_are_not_believed_cost_no_motions_but_their_own(every: int) -> None:
    """A tip that nobody sees for a frame goes on, and is where it was to be by then."""
    believed = samples_of([seen(k) for k in range(500)])
    some = samples_of([seen(k, k % every != every - 1) for k in range(500)])
    assert len(believed) > 30
    assert len(some) > 0.8 * len(believed)
    for sample in some:
        share = (sample.delta_u / SPEED).mean() / DT_S
        np.testing.assert_allclose(sample.delta_tip_mm, TIP_MM_S * share * DT_S, atol=1e-9)


@pytest.mark.parametrize("unseen", [1, 4])
def test_a_tip_that_is_elsewhere_when_it_is_believed_again_takes_what_came_shortly_before(
    unseen: int,
) -> None:
    """Something pushed it: nobody knows since when."""
    off_mm = np.array([1.5, 0.0, 0.0])
    before = [seen(k, k < 200) for k in range(200 + unseen)]
    after = [seen(k, off_mm=off_mm) for k in range(200 + unseen, 500)]
    samples = samples_of(before + after)
    began_s = np.array([sample.tip_mm[1] / TIP_MM_S[1] for sample in samples])
    given_s = began_s[began_s < 2.0]
    assert given_s.max() < 2.0 - 0.3
    for sample in samples:
        share = (sample.delta_u / SPEED).mean()
        np.testing.assert_allclose(sample.delta_tip_mm, TIP_MM_S * share, atol=1e-9)


def test_a_tip_that_is_not_seen_for_long_is_none_that_goes_on() -> None:
    frames = [seen(k, not 200 <= k < 215) for k in range(500)]
    ends = [(one.tip_mm + one.delta_tip_mm)[0] / TIP_MM_S[0] for one in samples_of(frames)]
    assert not any(1.7 < end < 2.15 for end in ends)
