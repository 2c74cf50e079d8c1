"""The lease: exactly one client may command, and only while it keeps saying so."""

import hmac
import math
import secrets
from collections.abc import Callable


def secret_token() -> str:
    """A token that nobody can guess."""
    return secrets.token_urlsafe(16)


class Lease:
    """Exclusive and expiring. Belongs to a token, not to a user: one user may have two windows."""

    def __init__(self, duration_s: float, new_token: Callable[[], str] = secret_token) -> None:
        """duration_s: how long it lasts without renewal. new_token: must never repeat itself."""
        if not (math.isfinite(duration_s) and duration_s > 0):
            raise ValueError("a lease lasts for a positive time")
        self._duration_ns = round(duration_s * 1e9)
        self._new_token = new_token
        self._user = self._token = ""
        self._ends_ns: int | None = None
        """When it ends or ended; None: nobody has ever had it."""

    def acquire(self, user: str, token: str, t_ns: int) -> str | None:
        """Take the lease, or renew it with its token. Its token, or None: somebody else has it.

        A renewal that comes too late gets a new token: meanwhile anybody could have had it.
        """
        if not self.holds(token, user, t_ns):
            if self.holder(t_ns) is not None:
                return None
            self._user, self._token = user, self._new_token()
        self._ends_ns = t_ns + self._duration_ns
        return self._token

    def release(self, token: str, user: str, t_ns: int) -> bool:
        """Give it back. False: it was not held with this token."""
        if not self.holds(token, user, t_ns):
            return False
        self._user = self._token = ""
        self._ends_ns = t_ns
        return True

    def holds(self, token: str, user: str, t_ns: int) -> bool:
        """Whether `user` has it now, with this token."""
        if not token or self.holder(t_ns) != user:
            return False
        return hmac.compare_digest(token.encode(), self._token.encode())

    def holder(self, t_ns: int) -> str | None:
        """Who has it now."""
        if self._ends_ns is None or t_ns >= self._ends_ns:
            return None
        return self._user

    def expires_in_s(self, t_ns: int) -> float | None:
        """How long it still lasts; None: nobody has it."""
        if self._ends_ns is None or t_ns >= self._ends_ns:
            return None
        return (self._ends_ns - t_ns) * 1e-9

    def unheld_s(self, t_ns: int) -> float:
        """For how long nobody has had it: 0 while it is held, infinite if it never was."""
        if self._ends_ns is None:
            return math.inf
        return max(0, t_ns - self._ends_ns) * 1e-9
