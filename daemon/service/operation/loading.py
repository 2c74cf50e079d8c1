"""Making ready what `start` follows: read, and looked at along all of its way before it is gone.

That takes a while, in which the bus cycle goes on and anything may happen: what must still hold
then is asked again.
"""

import asyncio
from collections.abc import Callable
from typing import Any

from config.tasks.controllers import ControllerOptions
from config.tasks.planned_path import PlannedPath
from daemon.control.controller import Controller
from daemon.control.reachability import Bounds, looks, too_fast
from daemon.messages import Load
from daemon.reference.planned_path import misfit
from daemon.reference.trajectories import Trajectory
from daemon.risk.body_risk_source import BodyRiskSource, identity_of
from daemon.risk.path_ahead import PathAhead
from daemon.service.following import Loaded
from daemon.service.motion_loader import CommandRefusedError, MotionLoader
from daemon.service.robot_service import RobotService


class Loading:
    """Of one robot; one `load` after the other."""

    def __init__(self, service: RobotService, loader: MotionLoader) -> None:
        self.loader = loader
        """What makes trajectories and controllers of messages."""
        self._service = service
        self._busy = False
        """A `load` is under way: what comes meanwhile could overtake it."""

    def check_not_busy(self) -> None:
        """Raises CommandRefusedError."""
        if self._busy:
            raise CommandRefusedError("busy", "something is being loaded: wait for its answer")

    async def carry_out(self, command: Load, still_allowed: Callable[[], None]) -> Trajectory:
        """What was loaded. Raises CommandRefusedError.

        still_allowed: raises CommandRefusedError once the command would be refused.
        """
        if self._service.supervisor.running:
            raise CommandRefusedError("wrong_state", "the robot is moving: hold or stop it first")
        self.check_not_busy()
        self._busy = True
        try:
            trajectory, controller, bounds = await self.loader.to_follow(command)
            await self._load_checked(trajectory, controller, bounds, still_allowed)
        finally:
            self._busy = False
        return trajectory

    async def load(self, trajectory: Trajectory, options: ControllerOptions) -> None:
        """What no message asks for. Raises CommandRefusedError."""
        controller = self.loader.make_controller(options)
        bounds = self.loader.bounds(options, controller)
        await self._load_checked(trajectory, controller, bounds, lambda: None)

    async def controller(self, mapping: dict[str, Any] | None) -> Controller:
        """The controller that a message asks for. Raises CommandRefusedError."""
        return await self.loader.controller(mapping)

    def check_path(self, path: PlannedPath | None) -> None:
        """A planned path is gone only as it was planned. Raises CommandRefusedError."""
        if path is None:
            return
        identity = identity_of(self._service.dependencies.risk)
        wrong = misfit(path, self._service.robot, *(identity or (None, None)))
        if wrong is not None:
            raise CommandRefusedError(*wrong)

    async def _load_checked(
        self,
        trajectory: Trajectory,
        controller: Controller,
        bounds: Bounds,
        still_allowed: Callable[[], None],
    ) -> None:
        self.check_path(trajectory.path)
        asked = (("unreachable", looks), ("axis_too_slow", too_fast))
        for refusal, look in asked:
            for why in look(trajectory, bounds):
                if why is not None:
                    raise CommandRefusedError(refusal, why)
                await asyncio.sleep(0)  # the bus cycle goes on in between
        ahead = await self._look_ahead(trajectory.path)
        # Who has the lease by now must not start what somebody else has asked for before.
        still_allowed()
        if self._service.supervisor.running:
            raise CommandRefusedError("wrong_state", "the robot was started meanwhile")
        self.check_path(trajectory.path)  # the surroundings may have changed meanwhile
        self._service.following.loaded = Loaded(trajectory, controller, ahead)

    async def _look_ahead(self, path: PlannedPath | None) -> PathAhead | None:
        """Along all of a planned path, before it is gone. Raises CommandRefusedError."""
        source = self._service.dependencies.risk
        if path is None or not isinstance(source, BodyRiskSource):
            return None
        ahead = source.path_ahead(path.t_s, path.u)
        for _ in range(ahead.pieces):
            ahead.look()
            await asyncio.sleep(0)  # the bus cycle goes on in between
        most, risk = self._service.robot.risk.most_on_path, ahead.left(0.0)
        if most is not None and risk > most:
            raise CommandRefusedError(
                "path_risk",
                f"the risk of touching something on the path is {risk:.3g}, and {most:g} is "
                f"allowed (risk.most_on_path): {ahead.worst()}",
            )
        return ahead
