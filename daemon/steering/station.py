"""One device and one hand on it: bytes and measured tips go in, targets come out.

All that comes in may be written to a journal, one JSON line each, with what was asked for. Read
again, a journal goes the same way through the same code: what comes out is compared with what came
out then, number for number.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Any, Final, NamedTuple, TypeVar

import msgspec

from daemon.steering.devices import PROFILES, DeviceState, Profile
from daemon.steering.hand import Hand, HandSettings, Target, Triple
from daemon.steering.input_events import EventStream

KIND: Final = "tentacled steering/1"
_MOST_LINE: Final = 1 << 20

S = TypeVar("S", bound=msgspec.Struct)


class Station:
    """What is asked for with one device. Times are of one clock, in ns, and never go back."""

    def __init__(self, profile: Profile, settings: HandSettings) -> None:
        self.device = DeviceState(profile)
        self.gone = False
        """Whether the device was unplugged: then nothing is asked for any more."""
        self._stream = EventStream()
        self._hand = Hand(settings)

    def read(self, t_ns: int, data: bytes) -> None:
        """Bytes of the device."""
        for report in self._stream.feed(data):
            self._hand.moved(self.device.take(report, t_ns))

    def unplugged(self) -> None:
        """There is nothing more to read of the device."""
        self.gone = True
        self.device.let_go()

    def tip(self, t_ns: int, position_mm: Triple, direction: Triple | None) -> None:
        """The tip was measured. direction: of unit length; None: nobody knows it."""
        self._hand.tip(t_ns, position_mm, direction)

    def refused(self, sequence: int) -> None:
        """The daemon does not follow that target."""
        self._hand.refused(sequence)

    def advance(self, t_ns: int) -> Target | None:
        """What is to be asked for now; None: nothing, so that the daemon holds."""
        device = self.device
        return self._hand.advance(t_ns, device.dead_man, device.clutch, device.rates(t_ns))


# The journal.


class JournalError(ValueError):
    """No journal, or not a whole one. Says which line, and why."""


class Header(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A journal's first line."""

    kind: str
    profile: str
    ranges: dict[int, tuple[float, float]]
    """Of absolute axes, as the device has stated them."""
    settings: dict[str, Any]


class Entry(msgspec.Struct, frozen=True, array_like=True):
    """One line: what, when, and of what a word allows what there is."""

    what: str
    """`bytes`, `gone`, `tip`, `refused`, `advance`."""
    t_ns: int = 0
    """Of bytes, tips and what is asked for."""
    data: str = ""
    """Hexadecimal."""
    position_mm: Triple | None = None
    direction: Triple | None = None
    sequence: int = 0


@dataclass(frozen=True)
class DeviceKind:
    """What a station is made for."""

    profile: str
    ranges: dict[int, tuple[float, float]]

    def made(self) -> Profile:
        return PROFILES[self.profile].ranged(self.ranges)


class RecordedStation(Station):
    """A station that writes down all that goes in and comes out."""

    def __init__(
        self, kind: DeviceKind, settings: HandSettings, write: Callable[[bytes], object]
    ) -> None:
        """write: takes whole lines."""
        super().__init__(kind.made(), settings)
        self._write = write
        self._line(Header(KIND, kind.profile, kind.ranges, asdict(settings)))

    def read(self, t_ns: int, data: bytes) -> None:
        self._line(Entry("bytes", t_ns, data.hex()))
        super().read(t_ns, data)

    def unplugged(self) -> None:
        self._line(Entry("gone"))
        super().unplugged()

    def tip(self, t_ns: int, position_mm: Triple, direction: Triple | None) -> None:
        self._line(Entry("tip", t_ns, "", position_mm, direction))
        super().tip(t_ns, position_mm, direction)

    def refused(self, sequence: int) -> None:
        self._line(Entry("refused", sequence=sequence))
        super().refused(sequence)

    def advance(self, t_ns: int) -> Target | None:
        target = super().advance(t_ns)
        asked = Entry("advance", t_ns)
        if target is not None:
            asked = Entry(
                "advance", t_ns, "", target.position_mm, target.direction, target.sequence
            )
        self._line(asked)
        return target

    def _line(self, what: Header | Entry) -> None:
        self._write(msgspec.json.encode(what) + b"\n")


class Replayed(NamedTuple):
    """What was asked for at one moment. t_ns: since the first of them. target: None: nothing."""

    t_ns: int
    target: Target | None


def replayed(lines: Iterable[bytes]) -> Iterator[Replayed]:
    """What comes out of a journal's lines when they go in again.

    Raises JournalError, also where that is not what came out then; a last line that is not whole,
    as a program leaves it that was killed, is left out.
    """
    numbered = enumerate(lines, 1)
    _, first = next(numbered, (0, b""))
    station = _station(first)
    began_ns: int | None = None
    for number, line in numbered:
        if not line.endswith(b"\n"):
            return
        entry = _decoded(line, Entry, number)
        target = _again(station, entry, number)
        if entry.what == "advance":
            began_ns = entry.t_ns if began_ns is None else began_ns
            then = _target(entry)
            if target != then:
                raise JournalError(f"line {number}: {then} was asked for then, and now {target}")
            yield Replayed(entry.t_ns - began_ns, target)


def _station(first: bytes) -> Station:
    header = _decoded(first, Header, 1)
    if header.kind != KIND:
        raise JournalError(f"line 1: its kind is {header.kind!r}, not {KIND!r}")
    if header.profile not in PROFILES:
        raise JournalError(f"line 1: there is no kind of device {header.profile!r}")
    try:
        settings = HandSettings(**header.settings)
    except (TypeError, ValueError) as error:
        raise JournalError(f"line 1: {error}") from None
    return Station(DeviceKind(header.profile, header.ranges).made(), settings)


def _again(station: Station, entry: Entry, number: int) -> Target | None:
    """Raises JournalError."""
    if entry.what == "advance":
        return station.advance(entry.t_ns)
    if entry.what == "bytes":
        try:
            station.read(entry.t_ns, bytes.fromhex(entry.data))
        except ValueError:
            raise JournalError(f"line {number}: these are no bytes") from None
    elif entry.what == "tip" and entry.position_mm is not None:
        station.tip(entry.t_ns, entry.position_mm, entry.direction)
    elif entry.what == "gone":
        station.unplugged()
    elif entry.what == "refused":
        station.refused(entry.sequence)
    else:
        raise JournalError(f"line {number}: {entry.what!r} is nothing that happens")
    return None


def _target(entry: Entry) -> Target | None:
    if entry.position_mm is None:
        return None
    return Target(entry.sequence, entry.position_mm, entry.direction)


def _decoded(line: bytes, kind: type[S], number: int) -> S:
    """Raises JournalError."""
    try:
        if len(line) > _MOST_LINE:
            raise JournalError(f"line {number}: too long for a journal")
        return msgspec.json.decode(line, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise JournalError(f"line {number}: {error}") from None
