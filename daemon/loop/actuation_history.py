"""Where the axes were a moment ago: a tracker frame is older than the drives' newest answers."""

from collections import deque
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

_KEPT: Final = 64
_FRAMES: Final = 32
_ABOUT_NS: Final = 13_000_000
"""Half of a frame's time, and a little."""


class ActuationHistory:
    """The last measured actuations u, by time."""

    def __init__(self, axes: int) -> None:
        self._axes = axes
        # The newest first: that is where what is asked for lies.
        self._kept: deque[tuple[int, Sequence[float]]] = deque(maxlen=_KEPT)
        self._frames: deque[tuple[int, NDArray[np.float64]]] = deque(maxlen=_FRAMES)

    @property
    def known(self) -> bool:
        """Whether the axes have told where they are."""
        return bool(self._kept)

    def add(self, t_ns: int, u: Sequence[float]) -> None:
        """The axes were at `u`, in their own units, at `t_ns`. Times must rise."""
        if len(u) != self._axes:
            raise ValueError(f"{len(u)} positions for {self._axes} axes")
        self._kept.appendleft((t_ns, u))

    def at(self, t_ns: int) -> NDArray[np.float64]:
        """(m,) u at `t_ns`, between the two nearest samples; outside them, the nearest one.

        Raises LookupError where nothing is known.
        """
        if not self._kept:
            raise LookupError("no axis has told its position yet")
        ends_ns, after = self._kept[0]
        for begins_ns, before in self._kept:
            if begins_ns <= t_ns:
                if begins_ns == ends_ns:
                    return np.array(before)
                share = (t_ns - begins_ns) / (ends_ns - begins_ns)
                return np.array([a + share * (b - a) for a, b in zip(before, after, strict=True)])
            ends_ns, after = begins_ns, before
        return np.array(after)

    def at_frame(self, t_ns: int) -> NDArray[np.float64]:
        """The same at the time of a frame, which is remembered."""
        u = self.at(t_ns)
        self._frames.appendleft((t_ns, u))
        return u

    def about(self, t_ns: int) -> NDArray[np.float64]:
        """(m,) u at the time of the frame that is nearest to `t_ns`, the very one that was told for
        it: whoever has worked something out for it need not do so again. At `t_ns` itself where no
        frame is near."""
        nearest, least_ns = None, _ABOUT_NS + 1
        for at_ns, u in self._frames:
            away_ns = abs(at_ns - t_ns)
            if away_ns < least_ns:
                nearest, least_ns = u, away_ns
            elif at_ns < t_ns:  # those after it are older still
                break
        return self.at(t_ns) if nearest is None else nearest
