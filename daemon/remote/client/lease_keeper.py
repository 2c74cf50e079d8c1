"""Keeps a lease by renewing it several times before it runs out."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Final

from daemon.messages import Answer
from daemon.remote.client.client_errors import (
    ClientError,
    DisconnectedError,
    LeaseLostError,
    RefusedError,
    TimedOutError,
)

_PER_LEASE: Final = 5
_SHORTEST_S: Final = 0.02

Renew = Callable[[str, float], Awaitable[Answer]]
"""Asks for the lease with this token, waiting so many seconds at most. Raises ClientError."""


class LeaseKeeper:
    """The lease of one client, from `acquire` to `stop`."""

    def __init__(self, renew: Renew, on_lost: Callable[[LeaseLostError], None]) -> None:
        """on_lost: called once, when the lease is lost. A lease that was lost is not taken again:
        whoever commands must know that for a while nobody did."""
        self._renew = renew
        self._on_lost = on_lost
        self._keeping: asyncio.Task[None] | None = None
        self.token = ""
        """Empty: there is no lease."""

    async def acquire(self, within_s: float) -> Answer:
        """Take the lease and keep it. Raises ClientError."""
        answer = await self._renew(self.token, within_s)
        self.token = answer.token
        # Begun anew: what became of renewals before says nothing of this lease.
        if self._keeping is not None:
            self._keeping.cancel()
        self._keeping = asyncio.create_task(self._keep(answer.expires_in_s or 0.0))
        return answer

    async def stop(self) -> str:
        """Renew no more. Returns the token, to give the lease back with."""
        token, self.token = self.token, ""
        keeping, self._keeping = self._keeping, None
        if keeping is not None:
            keeping.cancel()
            await asyncio.gather(keeping, return_exceptions=True)
        return token

    async def _keep(self, lasts_s: float) -> None:
        loop = asyncio.get_running_loop()
        every_s = max(lasts_s / _PER_LEASE, _SHORTEST_S)
        ends_s = loop.time() + lasts_s
        why: ClientError | None = None
        while True:
            await asyncio.sleep(every_s)
            if loop.time() >= ends_s and why is not None:
                self._lost(f"it could not be renewed: {why}")
                return
            sent_s = loop.time()
            try:
                answer = await self._renew(self.token, lasts_s)
            except (TimedOutError, DisconnectedError) as error:
                why = error
                continue
            except RefusedError as error:
                self._lost(error.refusal.text)
                return
            except ClientError as error:
                self._lost(str(error))
                return
            if answer.token != self.token:
                # It had run out and was free, so a new one was given: it is not ours to use.
                self.token = answer.token
                self._lost("it ran out before it was renewed")
                return
            ends_s, why = sent_s + lasts_s, None

    def _lost(self, why: str) -> None:
        self._on_lost(LeaseLostError(f"the lease is lost: {why}"))
