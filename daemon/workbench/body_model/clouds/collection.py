"""Collects clouds of an emulated body as Thompson et al. did of theirs.

Configurations that fill what the body can hold; to each from several random others, on a straight
line at the axes' own speed, so that what slips and creeps on the way shows in the shape; a cloud at
arrival. As on a rig nobody knows where the body is but from the cloud: its centreline is fitted to
that (`fitted_at`), once it is known from all clouds how the cameras stand to the base. The true one
is kept only to judge the fit by.

Each configuration begins with a body at rest and has random numbers of its own: what is seen does
not depend on who sees it, nor on whether it was interrupted.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from config.robot import Robot
from daemon.workbench.body_model.clouds.centreline_fit import (
    LEAST_POINTS,
    VisibleSurface,
    fit_centreline,
)
from daemon.workbench.body_model.clouds.configurations import Candidates
from daemon.workbench.body_model.clouds.emulated_body import Bodies
from safety.risk.model.mixture import FloatArray, IndexArray
from sim_backends.devices.body_surface import BodySurface
from sim_backends.devices.depth_cameras import DepthCameras
from sim_backends.plants.shooting import warm_up

_CAMERAS, _STARTS, _NOISE, _SPLIT, _BODIES = range(5)
"""Of the seeds."""
_BLOCK: Final = (0.35, 0.65)
"""Quantiles of the first two parameters, between which configurations can be kept back as a whole:
about a twelfth of all, in one place."""

FITTED: Final = "fitted to the clouds"
"""Where the centrelines of a data set come from."""

Arrays = dict[str, NDArray[Any]]
SingleArray = NDArray[np.float32]


class CollectionError(RuntimeError):
    """There are no clouds as they are wanted. Says where, or why."""


@dataclass(frozen=True)
class CollectionSettings:
    """As the paper has it; it does not say how many starts."""

    training: int = 2277
    test: int = 253
    starts: int = 12
    points: int = 256
    """Kept of each cloud, by chance."""
    seed: int = 1
    bodies: int = 0
    """Of the same design, one by chance for each start; 0: the robot file's own alone."""

    def __post_init__(self) -> None:
        if self.bodies < 0:
            raise ValueError("there are not fewer than no other bodies")
        if self.training < 2 or self.test < 1 or self.starts < 1:
            raise ValueError("there must be 2 configurations, and one to test, of 1 start or more")
        if self.points < LEAST_POINTS:
            raise ValueError(f"of a cloud, {LEAST_POINTS} points are kept, or more")
        if self.starts > self.training + self.test - 1:
            raise ValueError("there are not so many other configurations to start from")
        if self.seed < 0:
            raise ValueError("a seed is not below 0")

    @property
    def configurations(self) -> int:
        return self.training + self.test


def possible_ones(robot: Robot, seed: int, begin: int, count: int) -> FloatArray:
    """(k, q) parameters that the body can hold, of `count` candidates from number `begin` on."""
    warm_up()
    candidates = Candidates(robot, seed)
    parameters = candidates.parameters(begin, count)
    held = [candidates.possible(u) for u in candidates.actuation(parameters)]
    return np.asarray(parameters[np.array(held, np.bool_)])


def planned(robot: Robot, settings: CollectionSettings, parameters: FloatArray) -> Arrays:
    """Configurations and starts of (n, q) parameters; which are for tests, which are the block."""
    n = len(parameters)
    u = Candidates(robot, settings.seed).actuation(parameters)
    split = np.random.default_rng([settings.seed, _SPLIT])
    test = np.zeros(n, np.bool_)
    test[split.permutation(n)[: settings.test]] = True
    starts = np.empty((n, settings.starts, u.shape[1]))
    for i in range(n):
        random = np.random.default_rng([settings.seed, _STARTS, i])
        starts[i] = others_of(u, i, settings.starts, random)
    return {"configurations": u, "starts": starts, "test": test, "block": block_of(parameters)}


def block_of(parameters: FloatArray) -> NDArray[np.bool_]:
    """(n,) which of (n, q) lie in the middle of the first two."""
    block = np.ones(len(parameters), np.bool_)
    for values in parameters.T[:2]:
        low, high = np.quantile(values, _BLOCK)
        block &= (values >= low) & (values < high)
    return block


def others_of(u: FloatArray, i: int, count: int, random: Generator) -> FloatArray:
    """(count, m) of the (n, m) configurations, by chance: not number i, and none twice."""
    others = random.permutation(len(u) - 1)[:count]
    return np.asarray(u[others + (others >= i)])


def seen_at(
    robot: Robot,
    settings: CollectionSettings,
    indices: IndexArray,
    u: FloatArray,
    starts: FloatArray,
) -> Arrays:
    """Clouds, true centrelines, and forces at (k, m) u, come to from (k, s, m) starts.

    indices: (k,) numbers of these configurations. Raises CollectionError, UnreachableError.
    """
    warm_up()
    rig = _Rig(robot, settings)
    clouds, lines, forces = [], [], []
    for index, target, origins in zip(indices.tolist(), u, starts, strict=True):
        random = np.random.default_rng([settings.seed, _NOISE, index])
        made = np.random.default_rng([settings.seed, _BODIES, index])
        body = rig.bodies.rested(made)
        for number, start in enumerate(origins):
            if number and settings.bodies:
                body = rig.bodies.rested(made)
            body.go(start)
            state = body.go(target)
            line_mm = state.centreline_mm.astype(np.float32)
            clouds.append(rig.cloud(line_mm, target, random))
            lines.append(line_mm)
            forces.append(state.actuator_forces.astype(np.float32))
    shape = starts.shape[:2]
    return {
        "clouds_mm": np.reshape(clouds, (*shape, settings.points, 3)),
        "true_centrelines_mm": np.reshape(lines, (*shape, *lines[0].shape)),
        "forces": np.reshape(forces, (*shape, forces[0].size)),
        "radius_mm": np.array(state.radius_mm),
    }


def fitted_at(
    robot: Robot, u: FloatArray, clouds_mm: SingleArray, nodes: int, shift_mm: FloatArray
) -> Arrays:
    """Clouds moved by what the cameras are off, and the centrelines that are fitted to them.

    Of (k, s, p, 3) clouds at (k, m) u. Raises CollectionError.
    """
    assert robot.emulation is not None
    plant = robot.emulation.plant
    moved = (clouds_mm + shift_mm).astype(np.float32)
    lines = np.empty((*moved.shape[:2], nodes, 3), np.float32)
    for place, clouds, mine in zip(u, moved, lines, strict=True):
        fit, surface = None, VisibleSurface.of(plant, place)
        for i, cloud in enumerate(clouds):
            fit = fit_centreline(cloud, surface, nodes, begun=fit)
            if fit.doubt:
                raise CollectionError(
                    f"no body lies in the cloud with the axes at {place.round(2)}: {fit.doubt}. "
                    "Keep more points of each cloud"
                )
            mine[i] = fit.nodes_mm
    return {"clouds_mm": moved, "centrelines_mm": lines}


class _Rig:
    """A body in front of its cameras."""

    def __init__(self, robot: Robot, settings: CollectionSettings) -> None:
        assert robot.emulation is not None
        self.bodies = Bodies(robot, settings.bodies)
        self._settings = settings
        plant = robot.emulation.plant
        rig_seed = int(np.random.default_rng([settings.seed, _CAMERAS]).integers(2**31))
        self._cameras = DepthCameras(BodySurface.of(plant), plant.length_mm, rig_seed)

    def cloud(self, centreline_mm: SingleArray, at: FloatArray, random: Generator) -> SingleArray:
        """(p, 3) of what the cameras see. Of what is kept of the body: it could be seen again.

        at: (m,) where the axes are.
        """
        cloud = self._cameras.cloud(centreline_mm.astype(np.float64), random)
        wanted = self._settings.points
        if len(cloud) < wanted:
            raise CollectionError(
                f"the cameras see {len(cloud)} points with the axes at {at.round(2)}: "
                f"{wanted} are wanted"
            )
        return cloud[random.choice(len(cloud), wanted, replace=False)].astype(np.float32)
