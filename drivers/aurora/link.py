"""Requests and replies over a byte stream: one at a time, each with its own time limit."""

import asyncio
from collections.abc import Callable
from typing import Literal, TypeVar

from drivers.aurora.codec.commands import encode_command
from drivers.aurora.codec.errors import CodecError, error_meaning
from drivers.aurora.codec.replies import (
    OKAY,
    RESET,
    BinaryReply,
    CodedReply,
    DamagedReply,
    Reply,
    TextReply,
    coded_reply,
)
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.aurora.codec.versions import ApiRevision
from drivers.aurora.health import Counters
from drivers.byte_stream import ByteStream, StreamOpener
from drivers.clock import Clock

# A time limit that is set anew for every reply and hardly ever exceeded.


class TimeLimit:
    """Calls back once when a limit is exceeded that was not called off in time.

    One timer of the loop serves many limits: when it ends, it is set to what is left of the limit
    that holds then. A timer for each would cost more than all the rest of waiting for a reply.
    """

    def __init__(self, on_exceeded: Callable[[], None]) -> None:
        self._on_exceeded = on_exceeded
        self._ends_s: float | None = None
        """Loop time at which the limit ends; None: none is set."""
        self._timer: asyncio.TimerHandle | None = None

    def set(self, limit_s: float) -> None:
        """From now on. The limit before it holds no longer."""
        loop = asyncio.get_running_loop()
        self._ends_s = ends_s = loop.time() + limit_s
        if self._timer is None:
            self._timer = loop.call_at(ends_s, self._look)
        elif ends_s < self._timer.when():
            self._timer.cancel()
            self._timer = loop.call_at(ends_s, self._look)

    def call_off(self) -> None:
        """Until it is set again there is no limit."""
        self._ends_s = None

    def _look(self) -> None:
        assert self._timer is not None
        ended_s, self._timer = self._timer.when(), None
        if self._ends_s is None:
            return
        if self._ends_s <= ended_s:
            self._ends_s = None
            self._on_exceeded()
        else:
            self._timer = asyncio.get_running_loop().call_at(self._ends_s, self._look)


Direction = Literal["to_device", "from_device"]
TrafficListener = Callable[[Direction, bytes, int], None]
"""Called with every piece of bytes as it goes over the line, and its host time in ns."""

T = TypeVar("T")

POWER_UP_BAUD_RATE = 9600
RESET_TIMEOUT_S = 13.0
"""A reset takes up to 12 s, the first time with a new field generator."""

_TIMEOUT_S = 3.0
_TIMEOUTS_S = {"PINIT": 6.0, "TSTART": 6.0}
_LONGEST_TIMEOUT_S = 12.0
_MARGIN_S = 0.5
_RESYNC_TIMEOUT_S = 0.3
_ATTEMPTS = 3
_QUIET_S = 0.05
_LONGEST_SETTLING = 20
_COMMAND_CRC_WRONG = 0x04


class AuroraError(Exception):
    """The device cannot be used as wanted; the subclass says why."""


class LinkLostError(AuroraError):
    """The byte stream is gone."""


class NoReplyError(AuroraError):
    """No reply came in time."""


class DamagedReplyError(AuroraError):
    """A reply came, but cannot be believed or understood."""


class DeviceRestartedError(AuroraError):
    """The device has announced that it has restarted: nothing set before holds any longer."""


class DeviceRefusedError(AuroraError):
    """The device answered a command with an error code."""

    def __init__(self, word: str, code: int) -> None:
        meaning = error_meaning(code)
        super().__init__(f"{word}: error {code:02X}, {meaning.text}; {meaning.remedy}")
        self.code = code


class Link:
    """The line to the device, from opening to loss. Every method raises LinkLostError after that,
    and DeviceRestartedError once the device has said that it restarted, until `forget_restart`.
    """

    def __init__(
        self,
        clock: Clock,
        counters: Counters,
        on_lost: Callable[[OSError], None],
        on_traffic: TrafficListener | None = None,
        on_warning: Callable[[str, int], None] | None = None,
    ) -> None:
        self._clock = clock
        self._counters = counters
        self._on_lost = on_lost
        self._on_traffic = on_traffic
        self._on_warning = on_warning
        self._reader = ReplyReader()
        self._stream: ByteStream | None = None
        self._answer: asyncio.Future[tuple[Reply, int]] | None = None
        self._limit = TimeLimit(self._time_out)
        self._limit_s = 0.0
        self._word = ""
        self._wanted: type[TextReply] | type[BinaryReply] | None = None
        self._settled = True
        """Nothing is on the line but what is waited for."""
        self._unanswered = False
        """A command had no reply in time: it may come yet, and be taken for the next one's."""
        self._restarted = False
        self._received_bytes = 0
        self.baud_rate = POWER_UP_BAUD_RATE
        self.timeouts_s: dict[str, float] = {}
        """Time that the device itself says a command may take, by its word."""

    async def open(self, open_stream: StreamOpener) -> None:
        """Open the line, at 9600 baud. Raises StreamError."""
        self._stream = await open_stream(self)

    def close(self) -> None:
        """Let go of the line."""
        if self._stream is not None:
            self._stream.close()
            self._stream = None

    def set_baud_rate(self, baud_rate: int) -> None:
        """Change the host's rate, after everything written has left."""
        self._open_stream().set_baud_rate(baud_rate)
        self.baud_rate = baud_rate

    def wire_ns(self, count: int) -> int:
        """Time that `count` bytes take on the line: 10 bits each."""
        return count * 10_000_000_000 // self.baud_rate

    def forget_restart(self) -> None:
        """Whoever calls this sets up everything anew."""
        self._restarted = False

    async def restart_by_break(self) -> bool:
        """Make the device restart whatever state it is in; False: it does not say that it did."""
        self.set_baud_rate(POWER_UP_BAUD_RATE)
        self._open_stream().discard_input()
        self._reader.clear()
        self._wanted = None
        await self._open_stream().send_break()
        try:
            if not self._restarted:
                await self._answer_within(RESET_TIMEOUT_S)
        except NoReplyError:
            return False
        except DeviceRestartedError:
            pass
        self.forget_restart()
        self._settled, self._unanswered = True, False
        return True

    async def command(
        self, word: str, arguments: str = "", attempts: int = _ATTEMPTS, timeout_s: float = 0.0
    ) -> None:
        """Have something done. Raises DeviceRefusedError, NoReplyError, DamagedReplyError."""
        await self.query(word, arguments, _okay, attempts, timeout_s)

    async def query(
        self,
        word: str,
        arguments: str,
        decode: Callable[[str], T],
        attempts: int = _ATTEMPTS,
        timeout_s: float = 0.0,
    ) -> T:
        """Ask for something, again where the reply is damaged or does not come.

        Raises DeviceRefusedError, NoReplyError, DamagedReplyError.
        """
        limit_s = timeout_s or self._timeout_s(word)
        for left in reversed(range(attempts)):
            try:
                reply, _ = await self.exchange(word, arguments, TextReply, limit_s)
                assert isinstance(reply, TextReply)
                return decode(reply.text)
            except CodecError as error:
                if not left:
                    raise DamagedReplyError(f"{word}: {error}") from None
            except (DamagedReplyError, NoReplyError):
                if not left:
                    raise
            self._counters.retries += 1
            self._settled = False
        raise AssertionError("no attempts")

    async def exchange(
        self,
        word: str,
        arguments: str,
        wanted: type[TextReply] | type[BinaryReply],
        timeout_s: float,
    ) -> tuple[Reply, int]:
        """Send one command and wait for its reply, and the time at which that was complete.

        Raises DeviceRefusedError, NoReplyError, DamagedReplyError.
        """
        if not self._settled:
            await self._settle()
        if self._restarted:
            raise DeviceRestartedError("the device has restarted")
        self._settled = False
        self._word, self._wanted = word, wanted
        data = encode_command(word, arguments)
        if self._on_traffic is not None:
            self._on_traffic("to_device", data, self._clock.now_ns())
        return await self._answer_within(timeout_s, data)

    async def resynchronise(self) -> None:
        """After a reply that did not come: is the device still there? Raises NoReplyError."""
        await self.query("APIREV", "", ApiRevision.decode, timeout_s=_RESYNC_TIMEOUT_S)

    def bytes_received(self, data: bytes, t_ns: int) -> None:
        """ByteReceiver."""
        self._received_bytes += len(data)
        if self._on_traffic is not None:
            self._on_traffic("from_device", data, t_ns)
        for reply in self._reader.feed(data):
            self._take(reply, t_ns)
        if self._reader.noise_bytes:
            self._counters.noise_bytes += self._reader.noise_bytes
            self._reader.noise_bytes = 0

    def stream_lost(self, error: OSError) -> None:
        """ByteReceiver."""
        self._stream = None
        self._fail(LinkLostError(str(error)))
        self._on_lost(error)

    def _take(self, reply: Reply, t_ns: int) -> None:
        waiting = self._answer is not None and not self._answer.done() and self._wanted is not None
        coded = coded_reply(reply.text) if isinstance(reply, TextReply) else None
        if isinstance(reply, TextReply) and reply.text == RESET:
            self._restarted = True
            self._fail(DeviceRestartedError("the device has restarted"))
        elif isinstance(reply, DamagedReply):
            self._counters.crc_errors += 1
            if waiting:
                self._damaged(reply.reason)
        elif not waiting:
            self._counters.strays += 1
        elif coded is not None and not coded.is_warning:
            self._refused(coded.code)
        elif self._wanted is not None and not isinstance(reply, self._wanted):
            self._counters.strays += 1
        else:
            self._accept(reply, coded, t_ns)

    def _accept(self, reply: Reply, coded: CodedReply | None, t_ns: int) -> None:
        if coded is not None and self._on_warning is not None:
            self._on_warning(self._word, coded.code)
        if self._answer is not None:
            self._replied()
            self._answer.set_result((reply, t_ns))

    def _damaged(self, reason: str) -> None:
        self._replied()
        self._fail(DamagedReplyError(f"{self._word}: {reason}"))

    def _refused(self, code: int) -> None:
        if code == _COMMAND_CRC_WRONG:
            self._counters.crc_errors += 1
            self._damaged("the command arrived with a wrong checksum")
        else:
            self._replied()
            self._fail(DeviceRefusedError(self._word, code))

    def _replied(self) -> None:
        """Of two commands, the first without a reply in time, this may be the first one's: then
        that of the second follows, and must not be taken for the reply to a third."""
        self._settled, self._unanswered = not self._unanswered, False

    def _fail(self, error: AuroraError) -> None:
        if self._answer is not None and not self._answer.done():
            self._answer.set_exception(error)

    async def _answer_within(self, timeout_s: float, request: bytes = b"") -> tuple[Reply, int]:
        loop, stream = asyncio.get_running_loop(), self._open_stream()
        answer: asyncio.Future[tuple[Reply, int]] = loop.create_future()
        self._answer = answer
        self._limit_s = timeout_s
        self._limit.set(timeout_s)
        try:
            if request:
                stream.write(request)
            return await answer
        finally:
            self._limit.call_off()
            self._answer = None
            if answer.done() and not answer.cancelled():
                answer.exception()  # looked at, even where the waiting task was cancelled

    def _time_out(self) -> None:
        if self._answer is not None and not self._answer.done():
            self._counters.timeouts += 1
            self._unanswered = True
            self._fail(NoReplyError(f"{self._word}: no reply within {self._limit_s:g} s"))

    async def _settle(self) -> None:
        """Wait until a reply that nobody waits for any longer has passed."""
        for _ in range(_LONGEST_SETTLING):
            before = self._received_bytes
            await asyncio.sleep(_QUIET_S)
            if self._received_bytes == before:
                break
        self._reader.clear()
        self._settled = True

    def _timeout_s(self, word: str) -> float:
        own_s = self.timeouts_s.get(word, 0.0) + _MARGIN_S
        return min(max(own_s, _TIMEOUTS_S.get(word, _TIMEOUT_S)), _LONGEST_TIMEOUT_S)

    def _open_stream(self) -> ByteStream:
        if self._stream is None:
            raise LinkLostError("the line is closed")
        return self._stream


def _okay(text: str) -> None:
    if text != OKAY and coded_reply(text) is None:
        raise CodecError(f"'{text[:20]}' instead of OKAY")
