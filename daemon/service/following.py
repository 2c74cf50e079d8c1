"""What is loaded, and what is followed: reference and controller, how far they are, how old."""

from functools import partial
from typing import Final, NamedTuple, Protocol, runtime_checkable

from config.control import Workspace
from config.tasks.planned_path import PlannedPath
from daemon.control.axis_speeds import HasForesight, unhurried_s
from daemon.control.controller import Controller, steers_direction
from daemon.loop.control_step import ControlLoop
from daemon.messages import ReferenceStatus, Setpoint
from daemon.reference.reference import Aim, Blend, TrajectoryReference, Unhurried
from daemon.reference.trajectories import Trajectory
from daemon.risk.path_ahead import PathAhead
from daemon.robot.axes import AxisRanges
from daemon.service.setpoints import Setpoints
from drivers.pose import Vector
from safety.risk.body_risk import BodyRisk

_AXES_TO_POINT: Final = 5
"""Three degrees of freedom of a place, two of a direction."""
_NOT_TELEOPERATED: Final = "the robot is not teleoperated: ask for `teleoperate` first"


@runtime_checkable
class PostureDrawn(Protocol):
    """A controller whose axes can be drawn somewhere while the tip follows: quickly, since it is
    told with every step."""

    def draw_to(self, posture: Vector) -> None:
        """(m,) where the axes should be, as far as the tip lets them."""
        ...


class PostureReference(TrajectoryReference):
    """A planned path: the tip's reference, and for the controller where the axes should be."""

    def __init__(
        self,
        trajectory: Trajectory,
        blend_speed_mm_s: float,
        controller: PostureDrawn,
        unhurried: Unhurried | None = None,
    ) -> None:
        super().__init__(trajectory, blend_speed_mm_s, unhurried)
        self._controller = controller

    def advance(self, t_ns: int, dt_s: float) -> Aim:
        aim = super().advance(t_ns, dt_s)
        posture = self.trajectory.posture_at(self.elapsed_s)
        if posture is not None:
            self._controller.draw_to(posture)
        return aim


class Loaded(NamedTuple):
    """What `start` will follow."""

    trajectory: Trajectory
    controller: Controller
    ahead: PathAhead | None = None
    """The risk of a planned path; None: it is no path, or nobody knows."""


class Following:
    """Gives the loop its reference and its controller, and knows them afterwards."""

    def __init__(self, loop: ControlLoop, axes: AxisRanges, workspace: Workspace | None) -> None:
        """workspace: where set-points may be; None: anywhere."""
        self.loaded: Loaded | None = None
        self._loop = loop
        self._axes = axes
        self._workspace = workspace
        self._trajectory: TrajectoryReference | None = None
        self._setpoints: Setpoints | None = None
        self._ahead: PathAhead | None = None

    def follow_loaded(self, blend_speed_mm_s: float) -> None:
        """The trajectory that is loaded, from its beginning on."""
        assert self.loaded is not None
        trajectory, controller, self._ahead = self.loaded
        unhurried = partial(self._unhurried_s, controller)
        if trajectory.path is not None and isinstance(controller, PostureDrawn):
            self._trajectory = PostureReference(trajectory, blend_speed_mm_s, controller, unhurried)
        else:
            self._trajectory = TrajectoryReference(trajectory, blend_speed_mm_s, unhurried)
        self._setpoints = None
        self._loop.reference = self._trajectory
        self._loop.controller = self.loaded.controller

    def _unhurried_s(self, controller: Controller, way: Blend) -> float:
        foresight = controller.foresight if isinstance(controller, HasForesight) else None
        if foresight is None:
            return way.duration_s
        return unhurried_s(way.at, way.duration_s, foresight, self._axes)

    def follow_setpoints(self, controller: Controller, t_ns: int) -> None:
        """The set-points that come from now on."""
        enough = len(self._loop.channels) >= _AXES_TO_POINT
        self._setpoints = Setpoints(
            self._workspace, t_ns, pointing=enough and steers_direction(controller)
        )
        self._trajectory = None
        self._loop.reference = self._setpoints.reference
        self._loop.controller = controller

    def take(self, setpoint: Setpoint, t_ns: int) -> str:
        """Follow a set-point that came at `t_ns`. Returns why not; empty if it is followed."""
        setpoints = self._followed_setpoints
        return _NOT_TELEOPERATED if setpoints is None else setpoints.take(setpoint, t_ns)

    @property
    def loaded_anew(self) -> bool:
        """Whether something is loaded that is not what is followed, or was before a hold."""
        followed = self._trajectory
        return self.loaded is not None and (
            followed is None or followed.trajectory is not self.loaded.trajectory
        )

    @property
    def followed_path(self) -> PlannedPath | None:
        """The planned path that is being followed, or was when the motion was held."""
        followed = self._trajectory
        if followed is None or self._loop.reference is not followed:
            return None
        return followed.trajectory.path

    def look_ahead(self, seeing: BodyRisk) -> float | None:
        """At a piece of the planned path that is followed; the risk of what is left of it. None:
        there is none, or nobody knows. seeing: whom the gate asks, who has seen the tip."""
        if self._ahead is None or self.followed_path is None or self.finished:
            return None
        self._ahead.look(seeing)
        return self._ahead.left(self.elapsed_s)

    @property
    def can_go_on(self) -> bool:
        """Whether there is a reference that is not at its end."""
        return self._loop.reference is not None and not self._loop.reference.finished

    @property
    def finished(self) -> bool:
        """Whether there is a reference, and it is at its end."""
        return self._loop.reference is not None and self._loop.reference.finished

    @property
    def elapsed_s(self) -> float:
        """Along the trajectory that is being followed; 0 without one."""
        return 0.0 if self._trajectory is None else self._trajectory.elapsed_s

    def setpoint_age_s(self, t_ns: int) -> float | None:
        """Of the newest set-point; None: no set-points are being followed."""
        setpoints = self._followed_setpoints
        return None if setpoints is None else setpoints.reference.age_s(t_ns)

    def status(self) -> ReferenceStatus | None:
        """What is being followed; None: nothing."""
        loop = self._loop
        name = "" if loop.controller is None else loop.controller.name
        followed = self._trajectory
        if followed is not None and loop.reference is followed:
            return ReferenceStatus(
                trajectory=followed.trajectory.kind,
                controller=name,
                elapsed_s=followed.elapsed_s,
                duration_s=followed.trajectory.duration_s,
                cycle=-1 if loop.aim is None else loop.aim.cycle,
                cycles=followed.trajectory.cycles,
                note=loop.note,
                part=loop.part,
                pace=1.0 if loop.aim is None else loop.aim.pace,
            )
        if self._setpoints is None:
            return None
        return ReferenceStatus(
            trajectory="set-points",
            controller=name,
            elapsed_s=0.0,
            duration_s=None,
            cycle=-1,
            cycles=None,
            note=loop.note,
            part=loop.part,
        )

    @property
    def _followed_setpoints(self) -> Setpoints | None:
        setpoints = self._setpoints
        followed = setpoints is not None and setpoints.reference is self._loop.reference
        return setpoints if followed else None
