"""One probing: the hardware with an observer, from connecting to letting go."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

from daemon.commands.terminal.probe_observer import Observer
from daemon.commands.terminal.probe_snapshot import Json, conditions_of, event, snapshot
from daemon.robot.capture import CanCapture
from daemon.robot.checked_robot import CheckedRobot
from daemon.robot.connections import RealConnections
from daemon.robot.hardware import Hardware, Listeners
from daemon.robot.runtime_directory import with_lab_ports
from drivers.aurora.tracker import TrackerState
from drivers.bounded import end_tasks
from drivers.clock import WallClock
from drivers.conditions import ConditionChange

_ENDS_WITHIN_S: Final = 8.0
"""Longer than hardware takes at the most."""


class ProbeSession:
    """The devices of a robot while they are probed."""

    def __init__(
        self,
        checked: CheckedRobot,
        lab: Path,
        clock: WallClock,
        on_event: Callable[[Json], None],
        capture: CanCapture | None,
    ) -> None:
        """on_event: hears at once of every condition that comes or goes. Raises EdsError."""
        robot = with_lab_ports(checked.file.robot, lab)
        self._robot = robot.robot
        self._clock = clock
        self._started_ns = clock.now_ns()
        self._on_event = on_event
        self._observer = Observer(clock)
        taps = {} if capture is None else {next(iter(robot.buses)): capture}
        listeners = Listeners(self._observer.on_frame, self._changed, can_taps=dict(taps))
        self._hardware = Hardware(checked.file, robot, RealConnections(clock), clock, listeners)

    @asynccontextmanager
    async def running(self) -> AsyncIterator[None]:
        """Connected while the context lasts."""
        task = asyncio.create_task(self._hardware.run())
        try:
            yield
        finally:
            await end_tasks([task], _ENDS_WITHIN_S)

    def snapshot(self) -> Json:
        """Everything as it is now."""
        return snapshot(self._robot, self._hardware, self._observer, self._since(None))

    @property
    def healthy(self) -> bool:
        """Whether everything is there and well."""
        tracking = self._hardware.tracker.status.state is TrackerState.TRACKING
        operational = all(bus.operational for bus in self._hardware.buses)
        return tracking and operational and not conditions_of(self._hardware)

    def _changed(self, change: ConditionChange) -> None:
        self._on_event(event(change, self._since(change.t_ns)))

    def _since(self, t_ns: int | None) -> float:
        return ((self._clock.now_ns() if t_ns is None else t_ns) - self._started_ns) * 1e-9
