"""Whether a trajectory can be followed at all, asked before anything moves."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from config.control import Workspace
from daemon.control.axis_speeds import Foresight, speed_looks
from daemon.reference.trajectories import Trajectory
from daemon.robot.axes import AxisRanges
from drivers.pose import Vector

MODEL_SAMPLES = 240
"""Places along one cycle at which the model is asked."""
BOX_SAMPLES = 2000
"""Places at which workspace and speed are looked at, besides all corners."""
_SAMPLES_AT_ONCE = 200


class KinematicModel(Protocol):
    """A model of the robot that knows how far its axes go."""

    @property
    def tolerance_mm(self) -> float:
        """A miss that may be the model's own error."""
        ...

    def reach(self, position_mm: Vector, near_u: Vector | None) -> tuple[Vector, float]:
        """(m,) axes that bring the tip nearest, searched from `near_u`, and the miss in mm."""
        ...


@runtime_checkable
class HasKinematics(Protocol):
    """A controller that has such a model."""

    @property
    def kinematics(self) -> KinematicModel: ...


@dataclass(frozen=True)
class Bounds:
    """What a trajectory must keep to, as far as it is known."""

    workspace: Workspace | None = None
    model: KinematicModel | None = None
    tip_speed_mm_s: float | None = None
    """The fastest that the controller asks of the tip."""
    axes: AxisRanges | None = None
    """Where the axes may be together, and how fast they go."""
    foresight: Foresight | None = None
    """What is known of how the axes would go; None: nothing."""
    position_only: str = ""
    """Kind of the controller, if it leads the tip by its position alone."""


def unreachable(trajectory: Trajectory, bounds: Bounds) -> str | None:
    """The first place where the trajectory leaves what can be reached, as a sentence, or None."""
    return next((found for found in looks(trajectory, bounds) if found), None)


def looks(trajectory: Trajectory, bounds: Bounds) -> Iterator[str | None]:
    """The same in pieces of a few milliseconds, for who has something else to do in between.

    The first that is not None is the answer; without one everything can be reached.
    """
    yield _not_pointed(trajectory, bounds)
    times = np.union1d(np.linspace(0.0, trajectory.cycle_s, BOX_SAMPLES + 1), trajectory.corners_s)
    for first in range(0, len(times), _SAMPLES_AT_ONCE):
        yield _out_of_bounds(trajectory, times[first : first + _SAMPLES_AT_ONCE], bounds)
    if bounds.model is not None:
        yield from _looks_of_model(trajectory, bounds.model, bounds.axes)


def too_fast(trajectory: Trajectory, bounds: Bounds) -> Iterator[str | None]:
    """Why the axes are too slow for the trajectory, in pieces as `looks` is."""
    if bounds.foresight is None or bounds.axes is None:
        return
    yield from speed_looks(trajectory, bounds.foresight, bounds.axes)


def _not_pointed(trajectory: Trajectory, bounds: Bounds) -> str | None:
    """Where a planned path points follows from where it leads the axes: nobody has asked for it."""
    if not bounds.position_only or not trajectory.points or trajectory.path is not None:
        return None
    return (
        f"{bounds.position_only} leads the tip by its position alone, and the {trajectory.kind} "
        "trajectory says where to point: leave that out, or take a controller that points, such as "
        "broyden or gaussian_process"
    )


def _looks_of_model(
    trajectory: Trajectory, model: KinematicModel, axes: AxisRanges | None
) -> Iterator[str | None]:
    before: Vector | None = None
    for t_s in np.linspace(0.0, trajectory.cycle_s, MODEL_SAMPLES + 1):
        point = trajectory.in_cycle(t_s)[0]
        u, miss_mm = model.reach(point, before)
        where = _where(trajectory, t_s, point)
        if miss_mm > model.tolerance_mm:
            yield (
                f"{where}, and the axes' travel ends {miss_mm:.1f} mm "
                f"before it, by the controller's model"
            )
        elif axes is not None and (broken := axes.coupled.first_broken(u)) is not None:
            yield (
                f"{where}, where by the controller's model the axes would have to be beyond the "
                f"coupled limit {broken.name}: {broken.reason}"
            )
        else:
            yield None
        before = u


def _out_of_bounds(trajectory: Trajectory, times: Vector, bounds: Bounds) -> str | None:
    motions = [trajectory.in_cycle(t_s) for t_s in times]
    points = np.array([point for point, _ in motions])
    with np.errstate(over="ignore"):
        speeds = np.linalg.norm([velocity for _, velocity in motions], axis=1)
    if bounds.workspace is not None:
        outside = _outside(trajectory, times, points, bounds.workspace)
        if outside:
            return outside
    most = np.inf if bounds.tip_speed_mm_s is None else bounds.tip_speed_mm_s * (1.0 + 1e-6)
    fast = np.flatnonzero(~(speeds <= most))
    if not fast.size:
        return None
    first = int(fast[0])
    return (
        f"{_where(trajectory, times[first], points[first])}, at {speeds[first]:.1f} mm/s, and the "
        f"tip may go {most:.4g} mm/s: go slower, or raise the controller's max_tip_speed_mm_s"
    )


def _outside(
    trajectory: Trajectory, times: Vector, points: Vector, workspace: Workspace
) -> str | None:
    box = {"x_mm": workspace.x_mm, "y_mm": workspace.y_mm, "z_mm": workspace.z_mm}
    lowest, highest = np.array(list(box.values())).T
    beyond = np.maximum(lowest - points, points - highest)
    bad = np.flatnonzero(~(beyond <= 0.0).all(axis=1))
    if not bad.size:
        return None
    first = int(bad[0])
    axis = int(np.argmax(beyond[first]))
    return (
        f"{_where(trajectory, times[first], points[first])}, {beyond[first, axis]:.1f} mm beyond "
        f"the workspace's {list(box)[axis]} [{lowest[axis]:g}, {highest[axis]:g}]"
    )


def _where(trajectory: Trajectory, t_s: float, point: Vector) -> str:
    place = ", ".join(f"{value:.0f}" for value in point)
    return f"at {t_s:.1f} s the {trajectory.kind} trajectory is at ({place}) mm"
