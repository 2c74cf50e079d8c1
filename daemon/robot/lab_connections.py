"""Devices in the same process, for virtual time: the same bytes, passed as calls."""

from collections.abc import Callable

from config.robot import Robot
from config.tracker import Tracker
from daemon.host.periodic_timer import LoopTimer, PeriodicTimer, Tick
from drivers.byte_stream import StreamOpener
from drivers.can.link import CanLink, FrameReceiver
from drivers.cia402.drive_bus import LinkOpener
from drivers.clock import Clock
from sim_backends.devices.aurora.in_process import aurora_stream_opener
from sim_backends.devices.can.in_process import InProcessLink
from sim_backends.lab.lab import Lab


class LabConnections:
    """Connections to the devices of a `Lab` that was started in this process."""

    listens_first_s = 0.0
    """Nobody else can be there."""

    def __init__(self, lab: Lab, clock: Clock) -> None:
        self._lab = lab
        self._clock = clock

    def tracker(self, config: Tracker) -> StreamOpener:
        del config
        return aurora_stream_opener(self._lab.tracker, self._clock)

    def bus(self, name: str, robot: Robot) -> LinkOpener:
        queue_frames = robot.buses[name].tx_queue_frames

        async def open_bus(receiver: FrameReceiver) -> CanLink:
            bus, pump = self._lab.buses[name], self._lab.pumps[name]
            return InProcessLink(bus, pump, self._clock, receiver, queue_frames=queue_frames)

        return open_bus

    def timer(
        self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]
    ) -> PeriodicTimer:
        return LoopTimer(first_ns, period_ns, on_tick)
