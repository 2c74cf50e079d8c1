"""The tip goes with the axes that moved it, and what that tells is learnt.

A learner that is paired wrongly, or that has fallen silent, still follows a slow path: feedback
makes up for what it believes. So what it learns from is looked at here, and not how well it does.
The body is a linear one without noise, of which a motion that is paired rightly says Δp = J Δu to a
few per cent.
"""

from collections.abc import Callable
from math import pi

import numpy as np
import pytest

from daemon.control.controller import Observation, Proposal
from daemon.control.lag.body_lag import parts
from daemon.controllers.learning_controller import LearningController
from daemon.learning.samples.motion import MotionSample
from drivers.pose import Vector
from tests.daemon.control.closed_loop import DT_S, made_learner

KINDS = pytest.mark.parametrize("kind", ["reward_weighted", "forward_jacobian"])
LATE_S = 0.3
BEGIN_MM = np.array([0.0, 0.0, 190.0])
RADIUS_MM, CYCLE_S = 8.0, 4.0
TURNED = np.array([[0.9, -0.4359, 0.0], [0.4359, 0.9, 0.0], [0.0, 0.0, 1.0]])
"""By 26°: what has come loose at its base. No gain along an axis of space makes up for that."""


class LedBody:
    """A body whose tip is led round a circle, and goes after its axes as late as is known."""

    def __init__(self, learner: LearningController) -> None:
        self.learner = learner
        self.jacobian = 1.5 * np.random.default_rng(3).normal(size=(3, 6))
        self.shown = np.full(6, 20.0)
        self.told = [self.shown]
        dead_s, self.first_order_s = parts(LATE_S)
        self.dead_frames = round(dead_s / DT_S)
        self.tip_mm = BEGIN_MM
        self.seen: Callable[[Observation], Observation] = lambda observation: observation
        """What becomes of an observation on its way to the learner."""
        self.samples: list[MotionSample] = []
        work_in = learner._work_in

        def noted(sample: MotionSample, gains: Vector) -> None:
            self.samples.append(sample._replace(delta_tip_mm=sample.delta_tip_mm * gains))
            work_in(sample, gains)

        learner._work_in = noted  # type: ignore[method-assign]

    def step(self, aim_mm: Vector, velocity_mm_s: Vector, *, begins: bool = False) -> None:
        """One frame."""
        due = self.told[max(len(self.told) - 1 - self.dead_frames, 0)]
        before, tip_before = self.shown, self.tip_mm
        self.shown = before - np.expm1(-DT_S / self.first_order_s) * (due - before)
        self.tip_mm = tip_before + self.jacobian @ (self.shown - before)
        u, velocity = self.told[-1], (self.tip_mm - tip_before) / DT_S
        t_ns = round(len(self.told) * DT_S * 1e9)
        observation = self.seen(
            Observation(t_ns, DT_S, u, u, self.tip_mm, velocity, aim_mm, velocity_mm_s)
        )
        if begins:
            self.learner.reset(observation)
        self.learner.observe(observation)
        self.told.append(u + self.learner.propose(observation).delta_u)
        for _ in range(2):
            self.learner.learn()

    def explore(self) -> None:
        still = np.zeros(3)
        self.step(self.tip_mm, still, begins=True)
        while not self.learner.ready:
            self.step(self.tip_mm, still)
        self.samples.clear()

    def lead(self, duration_s: float) -> None:
        """Round the circle, from where the tip is."""
        centre_mm = self.tip_mm - np.array([RADIUS_MM, 0.0, 0.0])
        for frame in range(round(duration_s / DT_S)):
            angle, speed = 2.0 * pi * frame * DT_S / CYCLE_S, 2.0 * pi * RADIUS_MM / CYCLE_S
            out = np.array([np.cos(angle), np.sin(angle), 0.3 * np.sin(2.0 * angle)])
            on = np.array([-np.sin(angle), np.cos(angle), 0.6 * np.cos(2.0 * angle)])
            self.step(centre_mm + RADIUS_MM * out, speed * on)

    @property
    def off(self) -> float:
        """Of motions learnt from: the share that their axes do not explain, in the median."""
        unexplained = [
            np.linalg.norm(one.delta_tip_mm - self.jacobian @ one.delta_u)
            / np.linalg.norm(one.delta_tip_mm)
            for one in self.samples
        ]
        return float(np.median(unexplained))

    def believed_off(self) -> float:
        """How far off what the learner expects of motions like those it has seen is."""
        believed = self.learner._jacobian.at(self.tip_mm, self.told[-1])
        moves = np.array([one.delta_u for one in self.samples]).T
        expected, true = believed @ moves, self.jacobian @ moves
        return float(np.linalg.norm(expected - true) / np.linalg.norm(true))


def led(kind: str) -> LedBody:
    body = LedBody(made_learner(kind, lag_s=LATE_S, lead=True))
    body.explore()
    body.lead(8.0)
    return body


@KINDS
def test_motions_are_learnt_with_the_axes_that_made_them(kind: str) -> None:
    body = led(kind)
    assert len(body.samples) > 20
    assert body.off < 0.04


def test_axes_of_the_next_frame_would_show() -> None:
    """So that the test above shows something."""
    body = LedBody(made_learner("forward_jacobian", lag_s=LATE_S, lead=True))
    body.explore()
    last = [body.told[-1]]

    def of_the_frame_before(observation: Observation) -> Observation:
        last.append(observation.u)
        return observation._replace(u=last.pop(0))

    body.seen = of_the_frame_before
    body.lead(8.0)
    assert body.off > 0.05


@KINDS
def test_how_a_led_tip_answers_is_asked_where_the_axes_were_told_to_go(kind: str) -> None:
    """That is where the tip will be: from where they are measured it is of a moment ago."""
    body, behind, asked = led(kind), np.full(6, 0.3), list[Vector]()
    answer = body.learner._follow

    def follow(observation: Observation) -> Proposal:
        asked.append(observation.u)
        return answer(observation)

    body.learner._follow = follow  # type: ignore[method-assign]
    body.seen = lambda observation: observation._replace(u=observation.u - behind)
    told = len(body.told)
    body.lead(0.5)
    np.testing.assert_allclose(asked, body.told[told - 1 : -1], atol=1e-9)


@KINDS
def test_what_has_become_of_the_body_is_learnt_while_it_is_led(kind: str) -> None:
    body = led(kind)
    body.jacobian = TURNED @ body.jacobian
    before = body.believed_off()
    body.samples.clear()
    body.lead(16.0)
    assert before > 0.2
    assert body.believed_off() < 0.25 * before
    assert body.off < 0.05
