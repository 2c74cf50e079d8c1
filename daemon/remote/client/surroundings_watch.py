"""What is round the body, asked for again where others have taken its place."""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from daemon.messages import Message, Status, Surroundings
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError


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
        self._asked = there.counts_sha256
        self._changed = changed
        self._looking: asyncio.Task[None] | None = None

    def heard(self, message: Message) -> None:
        """Of all that the robot tells."""
        if isinstance(message, Status) and message.risk.surroundings_sha256 != self._asked:
            self._asked = message.risk.surroundings_sha256
            self._looking = asyncio.create_task(self._look_round())

    def close(self) -> None:
        """Nobody wants to hear of them any more."""
        if self._looking is not None:
            self._looking.cancel()

    async def _look_round(self) -> None:
        with suppress(ClientError):
            self._changed(*await self._client.surroundings())
