"""The same client for programs without an event loop: each call returns when it is done."""

import asyncio
import threading
from collections.abc import Coroutine, Iterator, Sequence
from types import TracebackType
from typing import Any, TypeVar

from daemon.messages import Answer, Message, Status, WhoAmI
from daemon.remote.client.address import Address
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ANSWERS_WITHIN_S, HOMES_WITHIN_S
from daemon.remote.client.subscription import DEPTH

T = TypeVar("T")


class BlockingRobotClient:
    """RobotClient on an event loop in a thread of its own. All methods raise ClientError.

    The lease is renewed by that thread: it is kept as long as the interpreter runs, even while the
    program itself hangs. For teleoperation it is the set-points that show that it does not.
    """

    def __init__(self, address: Address, *, wait_s: float = 0.0) -> None:
        """Connects. wait_s: for a daemon that is still starting."""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._loop.run_forever, name="robot client", daemon=True
        )
        self._thread.start()
        try:
            self._client = self._do(RobotClient.connect(address, wait_s=wait_s))
        except BaseException:
            self._end()
            raise

    def __enter__(self) -> "BlockingRobotClient":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let the lease run out, and hang up. May be repeated."""
        if not self._loop.is_closed():
            self._do(self._client.close())
            self._end()

    @property
    def me(self) -> WhoAmI:
        return self._client.me

    @property
    def connected(self) -> bool:
        return self._client.connected

    def status(self) -> Status:
        return self._do(self._client.status())

    def messages(self, names: Sequence[str], depth: int = DEPTH) -> Iterator[Message]:
        """What is published under these names, for ever. Raises DisconnectedError at its end."""

        async def subscribe() -> Any:
            return self._client.subscribe(names, depth)

        subscription = self._do(subscribe())
        try:
            while True:
                yield self._do(anext(subscription))
        finally:
            if not self._loop.is_closed():
                self._loop.call_soon_threadsafe(subscription.close)

    def acquire(self) -> Answer:
        return self._do(self._client.acquire())

    def release(self) -> Answer:
        return self._do(self._client.release())

    def arm(self, *, despite_contact: bool = False) -> Answer:
        """despite_contact: of a body that touches something, to lead it out."""
        return self._do(self._client.arm(despite_contact=despite_contact))

    def home(self, axes: Sequence[str] = (), within_s: float = HOMES_WITHIN_S) -> Answer:
        """Let axes look for their zeros; empty: all that do not know theirs."""
        return self._do(self._client.home(axes, within_s))

    def disarm(self) -> Answer:
        return self._do(self._client.disarm())

    def load(
        self,
        trajectory: dict[str, Any],
        controller: dict[str, Any] | None = None,
        cycles: int | None = None,
    ) -> Answer:
        return self._do(self._client.load(trajectory, controller, cycles))

    def plan(self, to_mm: Sequence[float], via_mm: Sequence[Sequence[float]] = ()) -> Answer:
        """A path from where the robot stands, among what is round it."""
        return self._do(self._client.plan(to_mm, via_mm))

    def start(self) -> Answer:
        return self._do(self._client.start())

    def teleoperate(self, controller: dict[str, Any] | None = None) -> Answer:
        return self._do(self._client.teleoperate(controller))

    def hold(self) -> Answer:
        return self._do(self._client.hold())

    def resume(self) -> Answer:
        return self._do(self._client.resume())

    def clear(self) -> Answer:
        return self._do(self._client.clear())

    def upload(self, name: str, content: bytes) -> str:
        """Send a mesh's file. Returns what `surround` takes for it."""
        return self._do(self._client.upload(name, content))

    def surround(self, surface: dict[str, Any] | None = None, *, add: bool = False) -> Answer:
        """Replace what is round the body, or add to it; the robot must not move."""
        return self._do(self._client.surround(surface, add=add))

    def inject(self, fault: str) -> Answer:
        return self._do(self._client.inject(fault))

    def stop(self, within_s: float = ANSWERS_WITHIN_S) -> Answer:
        """Quick stop, then power off. Look at `confirmed` in the answer."""
        return self._do(self._client.stop(within_s))

    def send_setpoint(
        self,
        position_mm: Sequence[float],
        valid_s: float = 0.2,
        velocity_mm_s: Sequence[float] | None = None,
    ) -> None:
        async def send() -> None:
            self._client.send_setpoint(position_mm, valid_s, velocity_mm_s)

        self._do(send())

    def _do(self, what: Coroutine[Any, Any, T]) -> T:
        return asyncio.run_coroutine_threadsafe(what, self._loop).result()

    def _end(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
