"""Whether a trajectory can be followed at all, asked before anything moves."""

from collections.abc import Iterator
from typing import Protocol, runtime_checkable

import numpy as np

from config.control import Workspace
from daemon.control.trajectories import Trajectory
from drivers.pose import Vector

MODEL_SAMPLES = 240
"""Places along one cycle at which the model is asked."""
BOX_SAMPLES = 2000
"""Places at which the workspace is, besides all corners."""


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


def unreachable(
    trajectory: Trajectory, workspace: Workspace | None, model: KinematicModel | None
) -> str | None:
    """The first place where the trajectory leaves what can be reached, as a sentence, or None."""
    return next((found for found in looks(trajectory, workspace, model) if found), None)


def looks(
    trajectory: Trajectory, workspace: Workspace | None, model: KinematicModel | None
) -> Iterator[str | None]:
    """The same in pieces of a few milliseconds, for who has something else to do in between.

    The first that is not None is the answer; without one everything can be reached.
    """
    if workspace is not None:
        yield _outside(trajectory, workspace)
    if model is None:
        return
    u: Vector | None = None
    for t_s in np.linspace(0.0, trajectory.cycle_s, MODEL_SAMPLES + 1):
        point = trajectory.in_cycle(t_s)[0]
        u, miss_mm = model.reach(point, u)
        yield (
            None
            if miss_mm <= model.tolerance_mm
            else (
                f"{_where(trajectory, t_s, point)}, and the axes' travel ends {miss_mm:.1f} mm "
                f"before it, by the controller's model"
            )
        )


def _outside(trajectory: Trajectory, workspace: Workspace) -> str | None:
    even = np.linspace(0.0, trajectory.cycle_s, BOX_SAMPLES + 1)
    times = np.union1d(even, trajectory.corners_s)
    points = np.array([trajectory.in_cycle(t_s)[0] for t_s in times])
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
