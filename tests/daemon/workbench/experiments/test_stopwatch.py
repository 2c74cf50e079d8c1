"""A timed controller is the same controller, and its stopwatch counts what it does."""

from pathlib import Path

import numpy as np
import pytest

from daemon.control.controller import ControllerError, Observation, Proposal
from daemon.workbench.experiments.stopwatch import Stopwatch, TimedController

NS_PER_MS = 1_000_000


class Clock:
    """Time passes when somebody works."""

    def __init__(self) -> None:
        self.t_ns = 0

    def now_ns(self) -> int:
        return self.t_ns


class Worker:
    """Takes 1 ms to observe, 2 ms to propose, 5 ms to learn."""

    name = "worker"

    def __init__(self, clock: Clock) -> None:
        self.ready = False
        self.heard: list[str] = []
        self._clock = clock

    def _work(self, what: str, ms: int) -> None:
        self.heard.append(what)
        self._clock.t_ns += ms * NS_PER_MS

    def reset(self, observation: Observation) -> None:
        self._work("reset", 100)

    def observe(self, observation: Observation) -> None:
        self._work("observe", 1)

    def propose(self, observation: Observation) -> Proposal:
        if len(self.heard) > 50:
            raise ControllerError("tired")
        self._work("propose", 2)
        return Proposal(np.ones(3), "busy")

    def learn(self) -> None:
        self._work("learn", 5)

    def save(self, path: Path) -> None:
        self._work(f"save {path}", 0)

    def load(self, path: Path) -> None:
        self._work(f"load {path}", 0)


NOWHERE = np.zeros(3)
OBSERVATION = Observation(0, 0.025, NOWHERE, NOWHERE, NOWHERE, NOWHERE, NOWHERE, NOWHERE)


@pytest.fixture
def made() -> tuple[Worker, Stopwatch, TimedController]:
    clock, stopwatch = Clock(), Stopwatch()
    stopwatch.clock = clock  # type: ignore[assignment]
    worker = Worker(clock)
    return worker, stopwatch, TimedController(worker, stopwatch)


def test_everything_reaches_the_controller(
    made: tuple[Worker, Stopwatch, TimedController],
) -> None:
    worker, _, timed = made
    timed.reset(OBSERVATION)
    timed.observe(OBSERVATION)
    assert timed.propose(OBSERVATION).note == "busy"
    timed.learn()
    timed.save(Path("a"))
    timed.load(Path("b"))
    assert worker.heard == ["reset", "observe", "propose", "learn", "save a", "load b"]
    assert (timed.name, timed.ready) == ("worker", False)


def test_a_step_is_observing_and_proposing_and_learning_is_apart(
    made: tuple[Worker, Stopwatch, TimedController],
) -> None:
    worker, stopwatch, timed = made
    worker.ready = True
    for _ in range(4):
        timed.observe(OBSERVATION)
        timed.observe(OBSERVATION)  # while it stood still
        timed.propose(OBSERVATION)
        timed.learn()
    told = stopwatch.computing_time()
    assert told is not None
    assert (told.steps, told.median_ms, told.max_ms, told.idle_mean_ms) == (4, 3.0, 3.0, 5.0)


def test_motions_of_its_own_do_not_count(
    made: tuple[Worker, Stopwatch, TimedController],
) -> None:
    _, stopwatch, timed = made
    timed.observe(OBSERVATION)
    timed.propose(OBSERVATION)
    assert stopwatch.computing_time() is None


def test_its_errors_come_through(made: tuple[Worker, Stopwatch, TimedController]) -> None:
    worker, _, timed = made
    worker.heard += ["..."] * 51
    with pytest.raises(ControllerError, match="tired"):
        timed.propose(OBSERVATION)
