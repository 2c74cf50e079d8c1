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

    def behind(self, place: int, target_counts: int, t_ns: int) -> bool:
        """Whether the axis at `place` has been too far from its targets for too long."""
        channel = self._channels[place]
        far = abs(target_counts - channel.position_counts) > self._allowed[place]
        if not (far and channel.following):
            self._since_ns[place] = None
            return False
        since_ns = self._since_ns[place]
        if since_ns is None:
            since_ns = self._since_ns[place] = t_ns
        return t_ns - since_ns > self._allowed_ns[place]
