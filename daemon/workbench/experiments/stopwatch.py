"""What a controller's steps cost in computing time, whatever time the robot lives in."""

from array import array
from pathlib import Path

import numpy as np

from daemon.control.axis_speeds import Foresight, HasForesight
from daemon.control.controller import Controller, Observation, Proposal
from daemon.host.clock import ThreadTimeClock
from daemon.recording.result import ComputingTime
from daemon.service.following import PostureDrawn
from drivers.pose import Vector


class Stopwatch:
    """Collects what each step took."""

    def __init__(self) -> None:
        self.clock = ThreadTimeClock()
        self._steps_ns = array("q")
        self._learning_ns = 0

    def step(self, took_ns: int) -> None:
        """A step that followed the reference took so long."""
        self._steps_ns.append(took_ns)

    def learnt(self, took_ns: int) -> None:
        """Work that could wait took so long."""
        self._learning_ns += took_ns

    def computing_time(self) -> ComputingTime | None:
        """Of all steps so far; None: there was none."""
        if not self._steps_ns:
            return None
        steps_ms = np.array(self._steps_ns) * 1e-6
        median, high = np.percentile(steps_ms, (50.0, 99.0))
        return ComputingTime(
            steps=len(steps_ms),
            median_ms=float(median),
            p99_ms=float(high),
            max_ms=float(steps_ms.max()),
            idle_mean_ms=self._learning_ns * 1e-6 / len(steps_ms),
        )


class TimedController:
    """A `Controller` that is another one, with a stopwatch beside it.

    The clock is real even in virtual time: what it says goes into the result and nowhere else.
    """

    def __init__(self, controller: Controller, stopwatch: Stopwatch) -> None:
        self._controller = controller
        self._stopwatch = stopwatch
        self._now_ns = stopwatch.clock.now_ns
        self._observed_ns = 0
        """What observing took in this step."""

    @property
    def name(self) -> str:
        return self._controller.name

    @property
    def ready(self) -> bool:
        return self._controller.ready

    @property
    def foresight(self) -> Foresight | None:
        """The other one's, if it has any."""
        controller = self._controller
        return controller.foresight if isinstance(controller, HasForesight) else None

    def draw_to(self, posture: Vector) -> None:
        """As the other one does, if it does."""
        if isinstance(self._controller, PostureDrawn):
            self._controller.draw_to(posture)

    def reset(self, observation: Observation) -> None:
        self._controller.reset(observation)

    def observe(self, observation: Observation) -> None:
        began_ns = self._now_ns()
        self._controller.observe(observation)
        self._observed_ns = self._now_ns() - began_ns

    def propose(self, observation: Observation) -> Proposal:
        began_ns = self._now_ns()
        proposal = self._controller.propose(observation)
        if self._controller.ready:
            self._stopwatch.step(self._now_ns() - began_ns + self._observed_ns)
        return proposal

    def learn(self) -> None:
        began_ns = self._now_ns()
        self._controller.learn()
        self._stopwatch.learnt(self._now_ns() - began_ns)

    def save(self, path: Path) -> None:
        self._controller.save(path)

    def load(self, path: Path) -> None:
        self._controller.load(path)
