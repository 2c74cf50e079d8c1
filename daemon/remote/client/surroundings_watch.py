"""What is round the body, asked for again where others have taken its place."""

import asyncio
from collections.abc import Callable
from typing import Final

from daemon.messages import Message, Status, Surroundings
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError

_TRY_AGAIN_S: Final = 1.0


class SurroundingsWatch:
    """For as long as a connection lasts. A mesh comes in many parts: telemetry goes on."""

    def __init__(
        self,
        client: RobotClient,
        there: Surroundings,
        changed: Callable[[Surroundings, bytes], object],
    ) -> None:
        """there: those that are known. changed: hears of others, with their mesh."""
        self._client = client
        self._known = there.counts_sha256
        self._changed = changed
        self._looking: asyncio.Task[None] | None = None

    def heard(self, message: Message) -> None:
        """Of all that the robot tells."""
        if not isinstance(message, Status) or message.risk.surroundings_sha256 == self._known:
            return
        if self._looking is None or self._looking.done():
            self._looking = asyncio.create_task(self._look(message.risk.surroundings_sha256))

    def close(self) -> None:
        """Nobody wants to hear of them any more."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look(self, told: str) -> None:
        """One look at a time: what is exchanged meanwhile is told by a later status."""
        try:
            found = await self._client.surroundings()
        except ClientError:
            await asyncio.sleep(_TRY_AGAIN_S)
            return
        self._known = told
        self._changed(*found)
