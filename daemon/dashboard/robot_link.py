"""One robot as the page's server knows it: heard while its daemon runs, picked up again after.

Its lease is renewed only when the page that has control has just been heard. A hung tab, a laptop
asleep or a frozen server renew nothing, and the daemon does what it does without an operator.
"""

import asyncio
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from daemon.dashboard.stop_lines import STOPS_WITHIN_S
from daemon.messages import (
    Acquire,
    Answer,
    Event,
    Hold,
    Message,
    Release,
    Resume,
    Status,
    Surroundings,
    Tip,
    tag,
)
from daemon.recording.result import CycleError, ErrorTable
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, DaemonNotRunningError
from daemon.remote.client.surroundings_watch import SurroundingsWatch
from daemon.remote.keys import TELEMETRY_KEYS

_TRY_AGAIN_S: Final = 0.5
_EVENTS_KEPT: Final = 1000
_CYCLES_TOLD: Final = 12
"""As many as a page shows: of a night there are thousands, all told anew with every one."""
_RENEW_EACH_S: Final = 0.2
_DEPTH: Final = 512
HEARD_WITHIN_S: Final = 0.4
"""An older heartbeat renews nothing."""
OLDEST_PICTURE_S: Final = 0.3
"""Whoever leads the tip must see it: what was made from an older picture is not sent."""
_VALID_S: Final = 0.2
"""Of a set-point: a hand that says nothing more for so long has let go."""


class PageControl:
    """Which page is in control of one robot, and until when: nothing keeps that alive but the
    browser's own heartbeat. Times are seconds of one clock."""

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


class RobotLink:
    """`run` until cancelled. What it has heard is kept when the daemon goes."""

    def __init__(
        self, name: str, folder: Path, on_event: Callable[[Event], None] | None = None
    ) -> None:
        """folder: the daemon's runtime folder. on_event: gets each event while it is heard."""
        self.name = name
        self._on_event = on_event
        self.control = PageControl()
        self.newest: dict[str, Message] = {}
        """By kind of message, without its version."""
        self.counts: dict[str, int] = {}
        """Of each of them, how many have come."""
        self.events: deque[Event] = deque(maxlen=_EVENTS_KEPT)
        self.events_heard = 0
        self.heard_s = 0.0
        """When the newest message came, on the event loop's clock."""
        self.surroundings: tuple[Surroundings, bytes] = (Surroundings(), b"")
        self.surroundings_heard = 0
        """How often they have come; 0: none have."""
        self.cycles_counted = 0
        """Changes with every cycle that ends, and where they begin anew."""
        self.hand_refused = ""
        """Why the motion did not go on when the hand took hold again; empty: it did."""
        self.problem = "looking for the daemon"
        """Why it is not connected; empty: it is."""
        self.folder = folder
        """Of its daemon, at run time."""
        self._client: RobotClient | None = None
        self._renewing: asyncio.Task[None] | None = None
        self._renewed_s = 0.0
        self._tip_came = asyncio.Event()
        self._errors = ErrorTable()
        self._cycle = -1
        self._holding: asyncio.Task[None] | None = None
        self._grabbed = False
        """The hand has taken hold, and nothing that it says has been sent yet."""
        self._handing_over = asyncio.Lock()
        """A page that leaves and one that comes: what the first gives back is not the second's."""

    @property
    def cycles(self) -> list[CycleError]:
        """The tip's error since the last start that was heard, cycle by cycle: of the last ones."""
        return self._errors.rows()[-_CYCLES_TOLD:]

    @property
    def status(self) -> Status | None:
        """The newest; None: the daemon is not heard."""
        newest = self.newest.get("status")
        return newest if isinstance(newest, Status) and not self.problem else None

    async def tip_comes(self, within_s: float) -> None:
        """Returns with the next tip, or when it has not come in time."""
        with suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._tip_came.wait()

    async def run(self) -> None:
        """Connect, listen, and begin again."""
        while True:
            try:
                async with await RobotClient.connect(self._address()) as client:
                    await self._listen(client)
            except (ClientError, OSError, ValueError) as error:
                self.problem = str(error)
            finally:
                self._client = None
                self.control.give(self.control.page)
            await asyncio.sleep(_TRY_AGAIN_S)

    def _address(self) -> LocalAddress:
        """Raises DaemonNotRunningError."""
        address = LocalAddress.in_folder(self.folder)
        if address.robot != self.name:
            text = (
                f"no daemon of {self.name} is running: in {self.folder} is that of {address.robot}"
            )
            raise DaemonNotRunningError(text)
        return address

    async def _listen(self, client: RobotClient) -> None:
        subscription = client.subscribe(list(TELEMETRY_KEYS), _DEPTH)
        self._surrounded(*await client.surroundings())
        self.events = deque(await client.events(), maxlen=_EVENTS_KEPT)
        self.events_heard += len(self.events)
        self._take(await client.status())
        self._client, self.problem = client, ""
        watch = SurroundingsWatch(client, self.surroundings[0], self._surrounded)
        try:
            async for message in subscription:
                self._take(message)
                watch.heard(message)
        finally:
            watch.close()

    def _surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        """What is round the body from now on."""
        self.surroundings = surroundings, mesh
        self.surroundings_heard += 1

    def _take(self, message: Message) -> None:
        if isinstance(message, Event):
            if self.events and message.sequence <= self.events[-1].sequence:
                return
            self.events.append(message)
            self.events_heard += 1
            if self._on_event is not None:
                self._on_event(message)
            if (message.kind, message.name) == ("command", "start"):
                self._errors, self._cycle = ErrorTable(), -1
                self.cycles_counted += 1
        if isinstance(message, Tip):
            self._errors.add(message)
            if message.cycle not in (-1, self._cycle):
                self._cycle = message.cycle
                self.cycles_counted += 1
        kind = tag(type(message)).split("/")[0]
        self.newest[kind] = message
        self.counts[kind] = self.counts.get(kind, 0) + 1
        self.heard_s = asyncio.get_running_loop().time()
        if isinstance(message, Tip):
            self._tip_came.set()
            self._tip_came = asyncio.Event()

    # Control.

    async def take_control(self, page: str) -> str:
        """Returns why not; empty: the page is in control. Whoever had it is held first."""
        async with self._handing_over:
            return await self._take_control(page)

    async def _take_control(self, page: str) -> str:
        client = self._client
        if client is None:
            return self.problem
        now_s = asyncio.get_running_loop().time()
        if self.control.page and self.control.page != page and client.token:
            with suppress(ClientError):  # it may not be moving
                await client.send(Hold())
        try:
            answer = await client.send(Acquire())
        except ClientError as error:
            return str(error)
        client.token = answer.token
        self.control.take(page, now_s)
        self._renewed_s = now_s
        return ""

    async def give_control(self, page: str) -> None:
        """The page lets go. Drives that are on are held by the daemon, when the lease has ended."""
        async with self._handing_over:
            client = self._client
            if self.control.give(page) and client is not None:
                with suppress(ClientError):
                    await client.send(Release())
                client.token = ""

    def heard(self, page: str) -> None:
        """A page's heartbeat: the only thing that renews the lease."""
        now_s = asyncio.get_running_loop().time()
        if not self.control.heard(page, now_s) or now_s - self._renewed_s < _RENEW_EACH_S:
            return
        if self._renewing is None or self._renewing.done():
            self._renewed_s = now_s
            self._renewing = asyncio.create_task(self._renew(page))

    async def _renew(self, page: str) -> None:
        client = self._client
        if client is None or not self.control.alive(asyncio.get_running_loop().time()):
            return
        token = client.token
        try:
            answer = await client.send(Acquire())
        except ClientError:
            self.control.give(page)
            client.token = ""
            return
        if answer.token != token:  # it had run out: for a while nobody was in control
            client.token = answer.token
            await self.give_control(page)

    async def do(self, page: str, ask: Callable[[RobotClient], Any]) -> Answer:
        """Have the page's command carried out. Raises ClientError, PermissionError."""
        client = self._client
        if client is None:
            raise PermissionError(self.problem)
        if page != self.control.page or not page:
            raise PermissionError("this page is not in control: take control first")
        answer: Answer = await ask(client)
        return answer

    # Leading the tip by hand.

    def lead(self, page: str, position_mm: Sequence[float], picture_s: float, grab: bool) -> str:
        """A set-point of the page's hand. Returns why it is not sent; empty: it is.

        picture_s: age of the picture that it was made from. grab: the hand has just taken hold;
        what was held because it had let go goes on.
        """
        client = self._client
        if client is None:
            return self.problem
        if page != self.control.page or not self.control.alive(asyncio.get_running_loop().time()):
            return "this page is not in control"
        self._grabbed = self._grabbed or grab
        if not picture_s <= OLDEST_PICTURE_S:
            return "the picture that it was made from is too old"
        try:
            client.send_setpoint(position_mm, _VALID_S)
        except ClientError as error:
            return str(error)
        if self._grabbed:
            self._grabbed = False
            self._after_holding(Resume())
        return ""

    def let_go(self, page: str) -> None:
        """The page's hand has let go: hold now, without waiting for the set-points to grow old."""
        if page and page == self.control.page:
            self._grabbed = False
            self._after_holding(Hold())

    def _after_holding(self, command: Hold | Resume) -> None:
        """In the order in which the hand let go and took hold."""
        before = self._holding

        async def ask() -> None:
            if before is not None:
                await asyncio.wait((before,))
            client, self.hand_refused = self._client, ""
            if client is None:
                return
            try:
                await client.send(command)
            except ClientError as error:
                running = self.status is not None and self.status.state == "running"
                if isinstance(command, Resume) and not running:
                    self.hand_refused = str(error)

        self._holding = asyncio.create_task(ask())

    async def stop(self) -> Answer:
        """STOP by the daemon's own way for it, in control or not. Raises ClientError."""
        if self._client is not None:
            return await self._client.stop(STOPS_WITHIN_S)
        return await LocalAddress.in_folder(self.folder).stop("page", STOPS_WITHIN_S)
