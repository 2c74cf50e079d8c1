"""What the axes of a bus are sent for the next SYNC: the permitted step, all on one line of it.

Axes that went on without the others would move apart. So a step is followed by all or by none, one
that comes between two cycles is sent at once where there is time for all of it, and where time was
lost all go the same share of their ways.
"""

from collections.abc import Sequence
from typing import Final

from config.bus import Bus
from drivers.can.frame import worst_case_bits
from drivers.cia402.axis_channel import AxisChannel
from drivers.cia402.objects import CYCLIC_MODES
from drivers.cia402.pdo_plan import RPDO_LAYOUT, TPDO_LAYOUT, sends_steps_at_once
from safety.permit import PermittedStep

_LATE: Final = 1.5  # periods since the last cycle


class CycleTargets:
    """Of one bus; told of each cycle, and of each step."""

    def __init__(self, bus: Bus, channels: Sequence[AxisChannel]) -> None:
        self.enabled_together: Sequence[AxisChannel] = channels
        """None of ours is enabled before all of these can be. Of all buses, where there are more.
        """
        self.next_sync_ns = 0
        self._channels = channels
        self._step: PermittedStep | None = None
        self._alone = False
        """Whether an axis is to be enabled that cannot be yet."""
        self._period_ns = round(bus.cycle_period_s * 1e9)
        self._began_ns = 0
        """The last cycle."""
        self._catches_up = False
        """A cycle came late, or a step was taken away: targets are further away than axes go in
        one."""
        self._goes_on_s = bus.cycle_period_s
        """For how long axes have gone on since the last cycle, which is a period at the most."""
        self._for_ns = 0
        """Which moment of a step is sent."""
        self._is_slow = sends_steps_at_once(bus)
        self._sends_steps_at_once = self._is_slow and all(
            channel.axis.drive.mode in CYCLIC_MODES for channel in channels
        )
        # Their states, which go before them after a SYNC, and their targets.
        bits = len(channels) * sum(map(worst_case_bits, (TPDO_LAYOUT.size, RPDO_LAYOUT.size)))
        self._all_sent_within_ns = bits * 1_000_000_000 // bus.bitrate_bit_s

    @property
    def following(self) -> bool:
        """Whether every axis is enabled and moves when its target moves."""
        return all(channel.following for channel in self._channels)

    def begin_cycle(self, t_ns: int) -> None:
        """SYNC goes out now."""
        since_ns = t_ns - self._began_ns
        self._catches_up |= since_ns > _LATE * self._period_ns
        # A late cycle is followed by one in time: sooner than a period.
        self._goes_on_s = min(since_ns, self._period_ns) * 1e-9
        self._began_ns = t_ns
        self.next_sync_ns = t_ns + self._period_ns
        # Drives take what they are sent now with the next SYNC, which it is meant for where a step
        # that comes until then is sent at once. Elsewhere it would not begin with what they took.
        self._for_ns = self.next_sync_ns if self._is_slow else t_ns

    def drop(self) -> None:
        """No step is followed any more."""
        self._step = None

    def take(self, step: PermittedStep, now_ns: int) -> bool:
        """Follow `step` from the next SYNC on. Whether it shall be sent at once."""
        self._step = step
        # Axes that turn together start with one SYNC: it must not come between their targets.
        in_time = now_ns + self._all_sent_within_ns <= self.next_sync_ns
        return self._sends_steps_at_once and in_time and not self._catches_up

    def frames(self) -> list[tuple[int, bytes]]:
        """What all axes are sent for the next SYNC."""
        return self._frames_of(self._current_step())

    def frames_at_rest(self) -> list[tuple[int, bytes]]:
        """The same without a step."""
        return self._frames_of(None)

    def frames_at_once(self) -> list[tuple[int, bytes]]:
        """The same of a step that has just been taken."""
        return self._frames_of(self._step)

    def _frames_of(self, step: PermittedStep | None) -> list[tuple[int, bytes]]:
        frames: list[tuple[int, bytes]] = []
        at_ns = self._for_ns
        share = self._share(step) if self._catches_up else 1.0
        for channel in self._channels:
            output = channel.output(at_ns, step, share)
            if output is not None:
                frames.append((channel.rpdo_id, output))
        return frames

    def _share(self, step: PermittedStep | None) -> float:
        """Of the ways to their targets, what all axes go, on their line: none faster than it may,
        whatever time was lost."""
        if step is None:
            return 1.0
        at_ns, goes_on_s = self._for_ns, self._goes_on_s
        share = min([one.share_in_a_cycle(at_ns, step, goes_on_s) for one in self._channels])
        self._catches_up = share < 1.0
        return share

    def _current_step(self) -> PermittedStep | None:
        """The step, unless an axis has stopped following: none may move on without the others."""
        alone = False
        if not self.following:
            self._catches_up |= self._step is not None
            self._step = None
            alone = any(channel.keeps_others_waiting for channel in self.enabled_together)
        if alone is not self._alone:
            self._alone = alone
            for channel in self._channels:
                channel.waits_for_others = alone
        return self._step
