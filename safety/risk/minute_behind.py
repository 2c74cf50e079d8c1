"""The risk of the minute behind: how likely the body has touched anything in it.

The shapes are drawn with the same draws at every step, so each draw is one body. It counts as
having touched from the step at which it is not proved to be clear until a minute later, however
often it does so in between: steps that are risky for the same bodies do not add up, and those that
are risky for others do. A product over the steps, as if each met another body, would be 1 soon.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from safety.risk.contact_figures import upper_limit

MINUTE_NS: Final = 60_000_000_000
_NEVER_NS: Final = np.iinfo(np.int64).min


class MinuteBehind:
    """Of one body's draws."""

    def __init__(self, samples: int) -> None:
        self._touched_ns = np.full(samples, _NEVER_NS, np.int64)

    def add(self, touching: NDArray[np.bool_], t_ns: int) -> None:
        """A way is gone. touching: (S,) which draws are not proved to be clear on it."""
        self._touched_ns[touching] = t_ns

    def risk(self, t_ns: int) -> float:
        """Upper limit, with the confidence of a step's, of having touched since a minute before."""
        count = int(np.count_nonzero(self._touched_ns > t_ns - MINUTE_NS))
        return upper_limit(count, self._touched_ns.size)
