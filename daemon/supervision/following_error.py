"""Whether an axis stays behind its target, seen from here.

The gate lets no target run further ahead of an axis than the drive's own window, so a jammed axis
would make the gate hold back for ever and the drive would never complain.
"""

from collections.abc import Sequence
from typing import Final

from drivers.axis_scale import count_limits
from drivers.cia402.axis_channel import AxisChannel

_SHARE_OF_WINDOW: Final = 0.8


class FollowingError:
    """Watches all axes."""

    def __init__(self, channels: Sequence[AxisChannel]) -> None:
        self._channels = channels
        self._allowed = [_SHARE_OF_WINDOW * count_limits(c.axis).max_lag for c in channels]
        self._allowed_ns = [round(c.axis.following_error_time_s * 1e9) for c in channels]
        self._since_ns: list[int | None] = [None] * len(channels)

    def behind(self, targets: Sequence[int], t_ns: int) -> set[int]:
        """The places of axes that have been too far from their targets, in counts, for too long."""
        behind, since_ns = set(), self._since_ns
        for place, channel in enumerate(self._channels):
            far = abs(targets[place] - channel.position_counts) > self._allowed[place]
            if far and channel.following:
                began_ns = since_ns[place]
                if began_ns is None:
                    began_ns = since_ns[place] = t_ns
                if t_ns - began_ns > self._allowed_ns[place]:
                    behind.add(place)
            else:
                since_ns[place] = None
        return behind
