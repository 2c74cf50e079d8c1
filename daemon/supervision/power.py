"""The power of all drives, as one: on together, and off by a quick stop first."""

from collections.abc import Sequence
from enum import Enum
from typing import Final

from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.power_state import PowerGoal

_STOPS_WITHIN_NS: Final = 1_500_000_000
"""A quick stop from full speed takes the shipped robots 0.05 s; then torque is taken anyway."""
_OFF_WITHIN_NS: Final = 1_000_000_000
"""A brake takes 0.05 s, a large one ten times that; drives that take longer have not confirmed."""


class PowerPhase(Enum):
    """What the drives are being led to."""

    LEFT_ALONE = "left alone"
    ENABLING = "enabling"
    ENABLED = "enabled"
    HOMING = "homing"
    STOPPING = "stopping"
    SWITCHING_OFF = "switching off"


class Power:
    """Leads the drives of all buses through their power states, a cycle at a time."""

    def __init__(self, buses: Sequence[DriveBus]) -> None:
        self.phase = PowerPhase.LEFT_ALONE
        self.confirmed = True
        """Whether the drives said that they did what the last stop asked."""
        self._buses = buses
        self._since_ns = 0

    def enable(self, t_ns: int) -> None:
        """Energise all drives where they stand."""
        self._enter(PowerPhase.ENABLING, t_ns)
        for bus in self._buses:
            bus.set_goal(PowerGoal.ENABLED)

    def home(self, t_ns: int) -> None:
        """Leave the drives to whoever homes them, until `stop`."""
        self._enter(PowerPhase.HOMING, t_ns)

    def stop(self, t_ns: int) -> None:
        """Quick stop on the bus at once, then power off. While that goes on, this does nothing."""
        if self.phase in (PowerPhase.STOPPING, PowerPhase.SWITCHING_OFF):
            return
        self.confirmed = False
        self._enter(PowerPhase.STOPPING, t_ns)
        for bus in self._buses:
            bus.stop_now()

    def cycle(self, t_ns: int) -> None:
        """Go on, if the drives have done what they were told, or had time enough for it."""
        if self.phase is PowerPhase.ENABLING and all(bus.following for bus in self._buses):
            self._enter(PowerPhase.ENABLED, t_ns)
        elif self.phase is PowerPhase.STOPPING and self._done(t_ns, _STOPS_WITHIN_NS):
            self._switch_off(t_ns)
        elif self.phase is PowerPhase.SWITCHING_OFF and self._done(t_ns, _OFF_WITHIN_NS):
            self.confirmed = all(bus.connected and bus.known_unpowered for bus in self._buses)
            self._enter(PowerPhase.LEFT_ALONE, t_ns)
            for bus in self._buses:
                bus.set_goal(None)
        elif self.phase is PowerPhase.LEFT_ALONE and any(bus.leads_torque for bus in self._buses):
            # A drive that was lost when the others were switched off, or left by another master.
            self._switch_off(t_ns)

    def since_s(self, t_ns: int) -> float:
        """How long the present phase has lasted."""
        return (t_ns - self._since_ns) * 1e-9

    @property
    def wanted(self) -> bool:
        """Whether the drives are, or are to be, energised."""
        return self.phase in (PowerPhase.ENABLING, PowerPhase.ENABLED, PowerPhase.HOMING)

    @property
    def at_rest(self) -> bool:
        """Whether nothing is asked of the drives."""
        return self.phase is PowerPhase.LEFT_ALONE

    @property
    def _reached(self) -> bool:
        return all(bus.connected and bus.goal_reached for bus in self._buses)

    def _done(self, t_ns: int, within_ns: int) -> bool:
        return self._reached or t_ns - self._since_ns > within_ns

    def _switch_off(self, t_ns: int) -> None:
        self._enter(PowerPhase.SWITCHING_OFF, t_ns)
        for bus in self._buses:
            bus.set_goal(PowerGoal.OFF)

    def _enter(self, phase: PowerPhase, t_ns: int) -> None:
        self.phase, self._since_ns = phase, t_ns
