"""Which page is in control, and until when: nothing is kept alive but by a browser's own heartbeat.

The lease is renewed only when the page that has control has just been heard. A hung tab, a laptop
asleep or a frozen server renew nothing, and the daemon does what it does without an operator.
"""

from typing import Final

HEARD_WITHIN_S: Final = 0.4
"""An older heartbeat renews nothing."""


class PageControl:
    """Of one robot. Times are seconds of one clock."""

    def __init__(self) -> None:
        self.page = ""
        """Which is in control; empty: none."""
        self._heard_s = 0.0

    def take(self, page: str, now_s: float) -> str:
        """Returns the page that had it before; empty where there was none, or it is the same."""
        before = self.page if self.page != page else ""
        self.page, self._heard_s = page, now_s
        return before

    def give(self, page: str) -> bool:
        """Returns whether it had it."""
        if not page or page != self.page:
            return False
        self.page = ""
        return True

    def heard(self, page: str, now_s: float) -> bool:
        """A page's heartbeat. Returns whether the lease may be renewed."""
        if not page or page != self.page:
            return False
        self._heard_s = now_s
        return True

    def alive(self, now_s: float) -> bool:
        """Whether the page in control was heard so lately that it counts as an operator."""
        return bool(self.page) and now_s - self._heard_s <= HEARD_WITHIN_S
