"""Where an emulated body really is at a configuration, depending on where it came from.

As in a collection of clouds, but the body itself: to each configuration from many others, and the
centreline at arrival. The configurations are of another sequence than any collection's.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from itertools import count
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.risk.collection import possible_ones
from daemon.risk.configurations import Candidates
from daemon.risk.emulated_body import EmulatedBody
from daemon.risk.parallel_collection import Progress
from safety.risk.mixture import FloatArray
from sim_backends.plants.shooting import warm_up

_OTHER_SEQUENCE: Final = 1_000_003
"""Added to the seed."""
_PART: Final = 5
"""Configurations: some seconds of work."""
_AT_ONCE: Final = 200
_MOST_CANDIDATES: Final = 200
"""Times as many as are wanted: then the body can hold next to nothing."""


class RolloutError(ValueError):
    """There are no such rollouts. Says why."""


@dataclass(frozen=True, eq=False)
class Rollouts:
    """r shapes at each of k configurations."""

    u: FloatArray
    """(k, m)."""
    centrelines_mm: NDArray[np.float32]
    """(k, r, n, 3) from base to tip."""
    radius_mm: float


def roll_out(
    robot: Robot, configurations: int, starts: int, seed: int, workers: Executor, progress: Progress
) -> Rollouts:
    """The first configurations that the body can hold, each come to from `starts` of the others.

    workers: such as `worker_processes` gives. Raises RolloutError, UnreachableError, LabError.
    """
    if robot.emulation is None:
        raise RolloutError("there is no 'emulation' in this robot file")
    if not 1 <= starts < configurations:
        raise RolloutError(
            f"{configurations} configurations are too few to come to each from {starts} others"
        )
    u = _held(robot, configurations, seed + _OTHER_SEQUENCE, workers, progress)
    begins = range(0, configurations, _PART)
    progress.begin("rollouts", configurations * starts, 0)
    tasks = [
        workers.submit(arrived, robot, u, range(begin, min(begin + _PART, configurations)), starts)
        for begin in begins
    ]
    parts = []
    for task in tasks:
        parts.append(task.result())
        progress.advance(len(parts[-1][0]) * starts)
    return Rollouts(u, np.concatenate([lines for lines, _ in parts]), parts[0][1])


def arrived(
    robot: Robot, u: FloatArray, which: Sequence[int], starts: int
) -> tuple[NDArray[np.float32], float]:
    """(k, starts, n, 3) centrelines at those of (all, m) u that are asked for, and the radius."""
    warm_up()
    body = EmulatedBody(robot)
    found: list[list[NDArray[Any]]] = []
    for i in which:
        random = np.random.default_rng([_OTHER_SEQUENCE, i])
        others = random.permutation(len(u) - 1)[:starts]
        body.rest()
        found.append([])
        for start in u[others + (others >= i)]:
            body.go(start)
            state = body.go(u[i])
            found[-1].append(state.centreline_mm.astype(np.float32))
    return np.array(found), state.radius_mm


def _held(
    robot: Robot, wanted: int, seed: int, workers: Executor, progress: Progress
) -> FloatArray:
    """(wanted, m) first configurations of the seed's sequence that the body can hold."""
    progress.begin("what it can hold", wanted, 0)
    found: list[FloatArray] = []
    for turn in count():
        if turn * _AT_ONCE > _MOST_CANDIDATES * wanted:
            raise RolloutError(
                f"of {turn * _AT_ONCE} configurations the body can hold {sum(map(len, found))}, "
                f"and {wanted} are wanted: look at the axes' limits and at the workspace"
            )
        half = _AT_ONCE // 2
        tasks = [
            workers.submit(possible_ones, robot, seed, turn * _AT_ONCE + begin, half)
            for begin in (0, half)
        ]
        for task in tasks:  # in their order: it decides which are the first
            there = sum(map(len, found))
            found.append(task.result())
            progress.advance(min(len(found[-1]), max(0, wanted - there)))
        if sum(map(len, found)) >= wanted:
            break
    parameters = np.concatenate([part for part in found if len(part)])[:wanted]
    return Candidates(robot, seed).actuation(parameters)
