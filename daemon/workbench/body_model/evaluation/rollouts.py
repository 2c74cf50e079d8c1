"""Where an emulated body really is at a configuration, depending on where it came from.

As in a collection of clouds, but the body itself: to each configuration from many others, and the
centreline at arrival. The configurations are of another sequence than any collection's.
"""

from collections.abc import Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from config.robot import Robot
from daemon.host.progress import Progress
from daemon.workbench.body_model.clouds.collection import CollectionError, others_of
from daemon.workbench.body_model.clouds.configurations import Candidates
from daemon.workbench.body_model.clouds.emulated_body import Bodies
from daemon.workbench.body_model.clouds.parallel_collection import first_possible
from safety.risk.model.mixture import FloatArray
from sim_backends.plants.shooting import warm_up

_OTHER_SEQUENCE: Final = 1_000_003
"""Added to the seed."""
_PART: Final = 5
"""Configurations: some seconds of work."""


@dataclass(frozen=True, eq=False)
class Rollouts:
    """r shapes at each of k configurations."""

    u: FloatArray
    """(k, m)."""
    centrelines_mm: NDArray[np.float32]
    """(k, r, n, 3) from base to tip."""
    radius_mm: float


def roll_out(
    robot: Robot,
    configurations: int,
    starts: int,
    seed: int,
    workers: Executor,
    progress: Progress,
    bodies: int = 0,
) -> Rollouts:
    """The first configurations that the body can hold, each come to from `starts` of the others.

    workers: such as `worker_processes` gives. bodies: of the same design, one by chance for each
    start, and none that a collection has; 0: the robot file's own alone. Raises CollectionError,
    UnreachableError, LabError.
    """
    if robot.emulation is None:
        raise CollectionError("there is no 'emulation' in this robot file")
    if not 1 <= starts < configurations:
        raise CollectionError(
            f"{configurations} configurations are too few to come to each from {starts} others: "
            "take more of them, or fewer rollouts (at least one)"
        )
    warm_up()  # here, once, and not in each process
    other = seed + _OTHER_SEQUENCE
    parameters = first_possible(robot, configurations, other, workers, progress)
    u = Candidates(robot, other).actuation(parameters)
    begins = range(0, configurations, _PART)
    progress.begin("rollouts", configurations * starts, 0)
    tasks = [
        workers.submit(
            arrived, robot, u, range(begin, min(begin + _PART, configurations)), starts, bodies
        )
        for begin in begins
    ]
    parts = []
    for task in tasks:
        parts.append(task.result())
        progress.advance(len(parts[-1][0]) * starts)
    return Rollouts(u, np.concatenate([lines for lines, _ in parts]), parts[0][1])


def arrived(
    robot: Robot, u: FloatArray, which: Sequence[int], starts: int, bodies: int = 0
) -> tuple[NDArray[np.float32], float]:
    """(k, starts, n, 3) centrelines at those of (all, m) u that are asked for, and the radius."""
    warm_up()
    made = Bodies(robot, bodies, _OTHER_SEQUENCE)
    found: list[list[NDArray[Any]]] = []
    for i in which:
        random = np.random.default_rng([_OTHER_SEQUENCE, i])
        body = made.rested(random)
        found.append([])
        for number, start in enumerate(others_of(u, i, starts, random)):
            if number and bodies:
                body = made.rested(random)
            body.go(start)
            state = body.go(u[i])
            found[-1].append(state.centreline_mm.astype(np.float32))
    return np.array(found), state.radius_mm
