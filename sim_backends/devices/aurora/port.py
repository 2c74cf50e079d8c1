"""The serial side of the emulated tracker: commands come in and replies go out in wire time."""

import heapq
from collections import deque
from collections.abc import Callable
from functools import partial
from itertools import count, cycle

import numpy as np

from drivers.aurora.codec.commands import CommandReader, LineSettings
from drivers.aurora.codec.replies import BINARY_START
from sim_backends.devices.aurora.faults import Pending

# What a serial line does to bytes: it takes its time, and turns a wrong rate into noise.


_NOISE_BYTES = 64


def wire_ns(count: int, baud_rate: int) -> int:
    """Time that `count` bytes take: 10 bits each."""
    return count * 10_000_000_000 // baud_rate


def heard(data: bytes, sent_at: int, heard_at: int, random: np.random.Generator) -> bytes:
    """What a receiver at one baud rate makes of bytes sent at another.

    Noise has its high bits set here: start bits and gaps are sampled at the wrong moments.
    """
    if sent_at == heard_at:
        return data
    count = min(max(len(data) * heard_at // max(sent_at, 1), 1), _NOISE_BYTES)
    return bytes(random.integers(0x80, 0x100, count, dtype=np.uint8))


# What an emulated device has still to do, and when.


class Agenda:
    """Actions by host time. While one runs, `now_ns` is the time it was due."""

    def __init__(self, now_ns: int = 0) -> None:
        self.now_ns = now_ns
        self._due: list[tuple[int, int, Callable[[], None], int]] = []
        self._order = count()

    def at(self, t_ns: int, action: Callable[[], None], unseen_ns: int = 0) -> None:
        """Do it then; what is due at the same time is done in the order it was put down.

        unseen_ns: for how long nobody outside can see whether it was done. So long it may wait for
        other things; it will not know.
        """
        if t_ns < self.now_ns:
            t_ns = self.now_ns
        heapq.heappush(self._due, (t_ns, next(self._order), action, t_ns + unseen_ns))

    def after(self, wait_ns: int, action: Callable[[], None]) -> None:
        """Do it in so long."""
        self.at(self.now_ns + wait_ns, action)

    def clear(self) -> None:
        """Do none of it."""
        self._due.clear()

    def run(self, t_ns: int) -> int | None:
        """Do all that is due up to then; returns when it has to be called again."""
        due = self._due
        while due and due[0][0] <= t_ns:
            self.now_ns, _, action, _ = heapq.heappop(due)
            action()
        if t_ns > self.now_ns:
            self.now_ns = t_ns
        next_ns = None
        for _, _, _, seen_ns in due:
            if next_ns is None or seen_ns < next_ns:
                next_ns = seen_ns
        return next_ns


Output = Callable[[bytes, int], None]
"""Called with bytes that have arrived at the host's end, and the rate they were sent at."""

_POWER_UP = LineSettings(9600)
_MAX_COMMANDS = 16
_MAX_BYTES_ON_THE_WAY = 8192
_HANDED_ON_NS = 16_000_000
"""A serial adapter hands on what has come at least so often."""
_FRAGMENTS = (1, 2, 3, 5)
_GAP_NS = 300_000
_GARBAGE_BYTES = 7


class Port:
    """One command at a time; what comes meanwhile waits, and too much of it is lost."""

    def __init__(
        self,
        agenda: Agenda,
        pending: Pending,
        strict_baud_rate: bool,
        random: np.random.Generator,
        least_ns: int,
        begin: Callable[[bytes], int],
        answer: Callable[[bytes], bytes | int],
    ) -> None:
        """begin: time in ns that a command line takes; least_ns: none takes less. answer: its
        reply, empty for none; or the host time at which to ask again."""
        self._agenda = agenda
        self._pending = pending
        self._strict = strict_baud_rate
        self._random = random
        self._least_ns = least_ns
        self._begin = begin
        self._answer = answer
        self._reader = CommandReader()
        self._commands: deque[bytes] = deque(maxlen=_MAX_COMMANDS)
        self._busy = False
        self._input_free_ns = 0
        self._on_the_way = 0
        self.settings = self._next_settings = _POWER_UP
        self.late_ns = 0
        self.hangs = False
        self.is_deaf = False
        self.left_unanswered = False
        """The last command got no reply: a client that flushes now is about to send a break."""
        self.output: Output = _nobody

    def receive(self, data: bytes, baud_rate: int, t_ns: int) -> None:
        """The host begins to send bytes."""
        if self._on_the_way + len(data) > _MAX_BYTES_ON_THE_WAY:
            return
        self._on_the_way += len(data)
        start_ns = max(t_ns, self._input_free_ns)
        self._input_free_ns = start_ns + wire_ns(len(data), max(baud_rate, 300))
        arrive = partial(self._arrive, data, baud_rate)
        self._agenda.at(self._input_free_ns, arrive, self._least_ns + self._unseen_ns)

    def restart(self) -> None:
        """Back to power-up settings; nothing that was going on goes on."""
        self.settings = self._next_settings = _POWER_UP
        self._reader.clear()
        self._commands.clear()
        self._busy = self.hangs = self.is_deaf = self.left_unanswered = False
        self._on_the_way = 0

    def change_settings(self, settings: LineSettings) -> None:
        """From the end of the present reply on."""
        self._next_settings = settings
        if not self._busy:
            self.settings = settings

    def send(self, reply: bytes) -> None:
        """Begin to send a reply, or something unasked."""
        self._busy = True
        if not reply or self.hangs or self._pending.take("no_reply"):
            self.left_unanswered = True
            self._done()
        elif self._pending.take("late"):
            self._agenda.after(self.late_ns, lambda: self._transmit(reply))
        else:
            self._transmit(reply)

    def _arrive(self, data: bytes, baud_rate: int) -> None:
        self._on_the_way -= len(data)
        if self.is_deaf:
            self.left_unanswered = True
            return
        if self._strict and baud_rate != self.settings.baud_rate:
            self.left_unanswered = True
            data = heard(data, baud_rate, self.settings.baud_rate, self._random)
        self._commands.extend(self._reader.feed(data))
        self._next()

    def _next(self) -> None:
        if self._commands and not self._busy:
            self._busy = True
            line = self._commands.popleft()
            due_ns = self._agenda.now_ns + self._begin(line)
            self._agenda.at(due_ns, partial(self._reply_to, line), self._unseen_ns)

    @property
    def _unseen_ns(self) -> int:
        """Whatever is answered, the first byte of it is on the line for so long."""
        return wire_ns(1, self.settings.baud_rate)

    def _reply_to(self, line: bytes) -> None:
        answer = self._answer(line)
        if isinstance(answer, int):
            self._agenda.at(answer, partial(self._reply_to, line), self._unseen_ns)
        else:
            self.send(answer)

    def _transmit(self, reply: bytes) -> None:
        baud_rate = self.settings.baud_rate
        gap_ns = _GAP_NS if self._pending.take("fragmented") else 0
        sizes = cycle(_FRAGMENTS if gap_ns else (max(_HANDED_ON_NS // wire_ns(1, baud_rate), 1),))
        rest = self._damaged(reply)
        end_ns = self._agenda.now_ns
        while rest:
            size = next(sizes)
            piece, rest = rest[:size], rest[size:]
            end_ns += wire_ns(len(piece), baud_rate) + gap_ns
            self._agenda.at(end_ns, partial(self._deliver, piece, baud_rate, not rest))
        self.left_unanswered = False

    def _deliver(self, piece: bytes, baud_rate: int, is_last: bool) -> None:
        self.output(piece, baud_rate)
        if is_last:
            self._done()

    def _done(self) -> None:
        self._busy = False
        self.settings = self._next_settings
        self._next()

    def _damaged(self, reply: bytes) -> bytes:
        if self._pending.take("bad_crc"):
            at = len(reply) - (1 if reply.startswith(BINARY_START) else 2)
            digit = b"1" if reply[at : at + 1] == b"0" else b"0"
            reply = reply[:at] + digit + reply[at + 1 :]
        if self._pending.take("truncated"):
            reply = reply[: len(reply) // 2]
        if self._pending.take("garbage"):
            reply = bytes(self._random.integers(0x80, 0xC0, _GARBAGE_BYTES, np.uint8)) + reply
        return reply


def _nobody(data: bytes, baud_rate: int) -> None:
    """Nobody is listening."""
