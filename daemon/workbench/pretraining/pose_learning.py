"""Learns a robot's pose model from its exact statics, and says how well it knows the rest.

As Fagogenis, Bergeles and Dupont (IROS 2016) have it: a grid over the configurations, a share of it
kept back at random. Fields are as wide along each direction as the pose is straight there: off by
½ xᵀ H x, a linear model wants a metric like the root of the mean of H².
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from daemon.learning.forward.pose_kinematics import BodyCoordinates
from daemon.learning.forward.pose_model import (
    PoseModel,
    as_rows,
    lattice,
    lattice_counts,
    pose_settings,
    sized_metric,
)
from daemon.learning.lwpr.model import FloatArray, Lwpr
from sim_backends.plants.concentric.relative import Poses, RelativeTubes

_LEAST_CURVED = 1e-3
"""Of the most curved direction: no field is a slab without an end."""


class PoseLearningError(ValueError):
    """Nothing can be learnt from this grid. The text says why."""


@dataclass(frozen=True)
class PoseLearningSettings:
    """How a pose model is learnt."""

    points: int = 80
    """Along each number of a configuration."""
    fields: int = 600
    """At most."""
    epochs: int = 1
    test_share: float = 0.15
    seed: int = 1
    """Of what is kept back, and of the order."""

    def __post_init__(self) -> None:
        if self.points < 4 or self.fields < 1 or self.epochs < 1 or self.seed < 0:
            raise ValueError(
                "points are 4 or more, fields and epochs 1 or more, the seed 0 or more"
            )
        if not 0.0 < self.test_share < 1.0:
            raise ValueError(f"no {self.test_share:g} of the grid can be kept back")


class PoseErrors(NamedTuple):
    """Root mean squares over what was kept back, as they are and by the range of each, in %.

    position_mm: (3,). The angle is that between directions; its range is 180°.
    """

    position_mm: FloatArray
    angle_rad: float
    position_percent: FloatArray
    angle_percent: float


@dataclass(frozen=True)
class LearntPose:
    """A model, and what it does not know."""

    model: PoseModel
    errors: PoseErrors
    learnt: int
    kept_back: int
    unsolved: int
    """Places of the grid without a stable shape: left out."""


def learn_pose(
    tubes: RelativeTubes,
    settings: PoseLearningSettings,
    about: Mapping[str, Any],
    tell: Callable[[str], None] = lambda _: None,
) -> LearntPose:
    """about: goes into the model's file. Raises PoseLearningError and RelativeRangeError."""
    tell(f"statics at {settings.points}^{tubes.count} configurations")
    poses = tubes.poses(settings.points)
    configuration, rows, test, unsolved = _split(poses, settings)
    scale = np.maximum(np.abs(tubes.lowest), np.abs(tubes.highest))
    scale[tubes.angles :] = (tubes.highest - tubes.lowest)[tubes.angles :]
    shape = curvature_metric(poses, settings.points, scale)
    learnt = np.flatnonzero(~test)
    periods = np.array([period or 0.0 for period in tubes.periods]) / scale
    order = learnt[np.random.default_rng(settings.seed).permutation(len(learnt))]
    counts = lattice_counts(
        shape, tubes.lowest / scale, tubes.highest / scale, periods, settings.fields
    )
    centres = lattice(counts, tubes.lowest, tubes.highest)
    order = _first(order, _nearest(configuration[order] / scale, centres / scale, shape))
    metric = sized_metric(shape, configuration[order] / scale, periods, settings.fields)
    lwpr = Lwpr(pose_settings(scale, tubes.periods, metric))
    tell(f"{len(order)} samples")
    for epoch in range(settings.epochs):
        chance = np.random.default_rng([settings.seed, epoch])
        for i in order if epoch == 0 else chance.permutation(order):
            lwpr.update(configuration[i], rows[i])
    coordinates = BodyCoordinates(*tubes.axes_map())
    model = PoseModel(lwpr, {**about, "coordinates": coordinates.to_dict()})
    errors = errors_of(model, configuration[test], rows[test])
    return LearntPose(model, errors, len(order), int(test.sum()), unsolved)


def evaluate_pose(
    model: PoseModel, tubes: RelativeTubes, settings: PoseLearningSettings
) -> LearntPose:
    """A model that is there already, on what would have been kept back. Raises as `learn_pose`."""
    configuration, rows, test, unsolved = _split(tubes.poses(settings.points), settings)
    errors = errors_of(model, configuration[test], rows[test])
    return LearntPose(model, errors, int((~test).sum()), int(test.sum()), unsolved)


def errors_of(model: PoseModel, configuration: FloatArray, rows: FloatArray) -> PoseErrors:
    """At (k, q) configurations with (k, 6) true positions and directions."""
    said = [model.predict(one) for one in configuration]
    position_mm = np.array([pose.position_mm for pose in said])
    direction = np.array([pose.direction for pose in said])
    off_mm = np.sqrt(((position_mm - rows[:, :3]) ** 2).mean(axis=0))
    across = np.linalg.norm(np.cross(direction, rows[:, 3:]), axis=1)
    angles = np.arctan2(across, (direction * rows[:, 3:]).sum(axis=1))
    off_rad = float(np.sqrt((angles**2).mean()))
    ranges = np.ptp(rows[:, :3], axis=0)
    return PoseErrors(off_mm, off_rad, 100.0 * off_mm / ranges, 100.0 * off_rad / np.pi)


def _nearest(places: FloatArray, centres: FloatArray, metric: FloatArray) -> NDArray[np.int64]:
    """(c,) which of (k, q) places is nearest to each of (c, q) centres, each once."""
    root = np.linalg.cholesky(metric)
    tree = KDTree(places @ root)
    return np.unique(tree.query(centres @ root)[1])


def _first(order: NDArray[np.int64], chosen: NDArray[np.int64]) -> NDArray[np.int64]:
    """The order, with those at the `chosen` places of it in front: fields come where they are."""
    return np.concatenate([order[chosen], np.delete(order, chosen)])


def curvature_metric(poses: Poses, points: int, scale: FloatArray) -> FloatArray:
    """(q, q) root of the mean of H² of the tip's place, over configurations divided by `scale`."""
    q = poses.configuration.shape[1]
    order = np.lexsort(poses.configuration.T)
    tips = poses.tip_mm[order].reshape(*[points] * q, 3)  # the last number is the slowest
    first, last = poses.configuration.min(axis=0), poses.configuration.max(axis=0)
    steps = (last - first) / scale / (points - 1)
    inside = tuple(slice(2, -2) for _ in range(q))
    hessian = np.empty((*tips[inside].shape, q, q)) if points > 4 else None
    if hessian is None or hessian.size == 0:
        raise PoseLearningError(f"{points} points along a number do not show how it bends")
    for i in range(q):
        slope = np.gradient(tips, steps[i], axis=q - 1 - i)
        for j in range(i, q):
            bend = np.gradient(slope, steps[j], axis=q - 1 - j)[inside]
            hessian[..., i, j] = hessian[..., j, i] = bend
    known = hessian.reshape(-1, q, q)
    known = known[np.isfinite(known).all(axis=(1, 2))]
    if len(known) == 0:
        raise PoseLearningError("the grid has nothing but holes")
    values, vectors = np.linalg.eigh(np.einsum("nij,njk->ik", known, known) / len(known))
    roots = np.sqrt(np.maximum(values, _LEAST_CURVED**2 * values[-1]))
    metric = (vectors * roots) @ vectors.T
    return np.asarray(0.5 * (metric + metric.T) / np.trace(metric) * q)


def _split(
    poses: Poses, settings: PoseLearningSettings
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_], int]:
    """Configurations (k, q) and rows (k, 6) that are known, which are for the test, and how many
    are not known. What is kept back does not depend on anything but the seed and their number."""
    rows = as_rows(poses.tip_mm, poses.direction)
    known = np.isfinite(rows).all(axis=1)
    count = int(known.sum())
    test = np.zeros(count, dtype=np.bool_)
    kept = round(settings.test_share * count)
    if not 0 < kept < count:
        raise PoseLearningError(f"of {count} places none can be kept back, or learnt from")
    test[np.random.default_rng(settings.seed).permutation(count)[:kept]] = True
    return poses.configuration[known], rows[known], test, len(rows) - count
