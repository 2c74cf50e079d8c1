"""Where the axes were a moment ago: a tracker frame is older than the drives' newest answers."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

_KEPT: Final = 64


class ActuationHistory:
    """The last measured actuations u, by time."""

    def __init__(self, axes: int) -> None:
        self._times_ns = np.zeros(_KEPT, np.int64)
        self._u = np.zeros((_KEPT, axes))
        self._count = 0

    @property
    def known(self) -> bool:
        """Whether the axes have told where they are."""
        return self._count > 0

    def add(self, t_ns: int, u: Sequence[float]) -> None:
        """The axes were at `u`, in their own units, at `t_ns`. Times must rise."""
        place = self._count % _KEPT
        self._times_ns[place] = t_ns
        self._u[place] = u
        self._count += 1

    def at(self, t_ns: int) -> NDArray[np.float64]:
        """(m,) u at `t_ns`, between the two nearest samples; outside them, the nearest one.

        Raises LookupError where nothing is known.
        """
        if not self._count:
            raise LookupError("no axis has told its position yet")
        later = None
        for back in range(min(self._count, _KEPT)):
            place = (self._count - 1 - back) % _KEPT
            if self._times_ns[place] <= t_ns:
                return self._between(place, later, t_ns)
            later = place
        assert later is not None
        return np.array(self._u[later])

    def _between(self, place: int, later: int | None, t_ns: int) -> NDArray[np.float64]:
        if later is None:
            return np.array(self._u[place])
        begins, ends = int(self._times_ns[place]), int(self._times_ns[later])
        share = (t_ns - begins) / (ends - begins)
        between: NDArray[np.float64] = self._u[place] + share * (self._u[later] - self._u[place])
        return between
