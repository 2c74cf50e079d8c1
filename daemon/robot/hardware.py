"""The robot's devices behind their drivers: one tracker, one master per bus, and the bus cycles."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from config.loader import RobotFile
from config.paths import eds_path
from config.robot import Robot
from config.tracker import Tracker
from daemon.host.periodic_timer import PeriodicTimer, Tick
from drivers.aurora.frame import TrackerFrame
from drivers.aurora.tracker import AuroraTracker
from drivers.bounded import end_tasks
from drivers.byte_stream import StreamOpener
from drivers.can.link import TrafficTap
from drivers.canopen.object_dictionary import ObjectDictionary
from drivers.cia402.drive_bus import DriveBus, LinkOpener
from drivers.clock import Clock
from drivers.conditions import ConditionChange

_TEARDOWN_S = 2.0


class Connections(Protocol):
    """How devices are reached: over real ports, or within this process in virtual time."""

    listens_first_s: float
    """How long another master on a bus is listened for, before a word is said."""

    def tracker(self, config: Tracker) -> StreamOpener:
        """Opens the tracker's line."""
        ...

    def bus(self, name: str, robot: Robot) -> LinkOpener:
        """Opens bus `name`."""
        ...

    def timer(
        self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]
    ) -> PeriodicTimer:
        """Starts a bus cycle's rhythm."""
        ...


@dataclass
class Listeners:
    """Who hears of what the devices do. All are called from the event loop and must be quick."""

    on_frame: Callable[[TrackerFrame], None]
    on_condition: Callable[[ConditionChange], None]
    on_tracker_traffic: Callable[[str, bytes, int], None] | None = None
    can_taps: dict[str, TrafficTap] = field(default_factory=dict)
    """By bus."""
    on_cycle: Callable[[DriveBus, Tick], None] | None = None
    """Carries out a bus cycle; None: nothing but the bus' own `tick`."""


class Hardware:
    """All devices of a robot. Nothing is energised here."""

    def __init__(
        self, file: RobotFile, robot: Robot, connections: Connections, clock: Clock, to: Listeners
    ) -> None:
        """robot: the file's, with its ports as they are to be opened. Raises EdsError."""
        self.tracker = AuroraTracker(
            robot.tracker,
            connections.tracker(robot.tracker),
            clock,
            to.on_frame,
            to.on_condition,
            to.on_tracker_traffic,
        )
        self.buses = [
            DriveBus(
                name,
                bus,
                [(index, axis) for index, axis in enumerate(robot.axes) if axis.drive.bus == name],
                {
                    axis.drive.node: ObjectDictionary(eds_path(axis.drive.eds, file.path))
                    for axis in robot.axes
                    if axis.drive.bus == name
                },
                connections.bus(name, robot),
                clock,
                on_change=to.on_condition,
                tap=to.can_taps.get(name),
                listens_first_s=connections.listens_first_s,
            )
            for name, bus in robot.buses.items()
        ]
        channels = [channel for bus in self.buses for channel in bus.channels]
        for bus in self.buses:
            bus.targets.enabled_together = channels
        self._connections = connections
        self._clock = clock
        self._on_cycle = to.on_cycle or self._plain_cycle

    async def run(self) -> None:
        """Keep all devices connected until cancelled; then leave them at rest, in bounded time."""
        timers = [self._start_cycle(bus) for bus in self.buses]
        tasks = [asyncio.create_task(bus.run()) for bus in self.buses]
        tasks.append(asyncio.create_task(self.tracker.run()))
        try:
            # Unlike gather, wait leaves the tasks alone when it is cancelled: drives are stopped
            # by the running bus, not by a dead one.
            ended, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                task.result()
        finally:
            try:
                await self._close_buses()
            finally:
                # What does not end by now is left behind: the drives' own watchdogs are next.
                await end_tasks(tasks, _TEARDOWN_S)
                for timer in timers:
                    timer.stop()

    async def _close_buses(self) -> None:
        closing = [asyncio.create_task(bus.close()) for bus in self.buses]
        await asyncio.wait(closing, timeout=_TEARDOWN_S)
        await end_tasks(closing, _TEARDOWN_S)

    def _start_cycle(self, bus: DriveBus) -> PeriodicTimer:
        period_ns = round(bus.bus.cycle_period_s * 1e9)

        def on_tick(tick: Tick) -> None:
            self._on_cycle(bus, tick)

        return self._connections.timer(self._clock.now_ns() + period_ns, period_ns, on_tick)

    def _plain_cycle(self, bus: DriveBus, tick: Tick) -> None:
        del tick
        bus.tick(self._clock.now_ns())
