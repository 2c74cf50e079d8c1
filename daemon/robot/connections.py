"""Real ports: a serial line for the tracker, python-can for the buses, timerfd for the rhythm."""

from collections.abc import Callable

from config.robot import Robot
from config.tracker import Tracker
from daemon.host.periodic_timer import PeriodicTimer, Tick, TimerFd
from drivers.byte_stream import StreamOpener
from drivers.can.link import CanLink, FrameReceiver
from drivers.can.open_link import open_link
from drivers.cia402.drive_bus import LinkOpener
from drivers.clock import Clock
from drivers.serial_port import serial_port_opener


class RealConnections:
    """Connections of a process to devices outside it."""

    listens_first_s = 0.25
    """Any master's SYNC comes every 0.1 s at the latest, and so do the heartbeats of most."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock

    def tracker(self, config: Tracker) -> StreamOpener:
        return serial_port_opener(config.port, self._clock, config.hardware_handshake)

    def bus(self, name: str, robot: Robot) -> LinkOpener:
        bus = robot.buses[name]

        async def open_bus(receiver: FrameReceiver) -> CanLink:
            return await open_link(bus, receiver, self._clock)

        return open_bus

    def timer(
        self, first_ns: int, period_ns: int, on_tick: Callable[[Tick], None]
    ) -> PeriodicTimer:
        return TimerFd(first_ns, period_ns, on_tick)
