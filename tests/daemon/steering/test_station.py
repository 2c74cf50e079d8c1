"""A journal of all that went in gives the same again, to the last bit."""

from random import Random

import msgspec
import pytest

from daemon.steering.hand import HandSettings
from daemon.steering.input_events import packed
from daemon.steering.station import (
    DeviceKind,
    JournalError,
    RecordedStation,
    Replayed,
    replayed,
)
from tests.daemon.steering.scripted import (
    CLUTCH,
    CLUTCH_OUT,
    DEAD_MAN,
    LET_GO,
    PERIOD_NS,
    Bench,
    push,
)


def recorded(seed: int, settings: HandSettings) -> tuple[list[bytes], list[Replayed]]:
    """A hand that does all a hand does, for ten seconds; and what was asked for."""
    random, lines = Random(seed), list[bytes]()
    station = RecordedStation(DeviceKind("3d_mouse", {}), settings, lines.append)
    bench = Bench(station=station)
    asked, began_ns = [], None
    for _ in range(400):
        events = [push(code, random.randint(-350, 350)) for code in range(6)]
        chance = random.random()
        events += [key for key, below in KEYS if (chance := chance - below) < 0.0][:1]
        x, y, z = bench.tip
        bench.tip = (x + random.gauss(0.0, 0.1), y + random.gauss(0.0, 0.1), z)
        target = bench.step(*events)
        began_ns = bench.t_ns if began_ns is None else began_ns
        asked.append(Replayed(bench.t_ns - began_ns, target))
        if target is not None and random.random() < 0.05:
            station.refused(target.sequence)
    station.unplugged()
    return lines, asked


KEYS = ((DEAD_MAN, 0.06), (LET_GO, 0.02), (CLUTCH, 0.03), (CLUTCH_OUT, 0.06))


@pytest.mark.parametrize("seed", range(5))
def test_what_was_asked_for_is_asked_for_again_to_the_last_bit(seed: int) -> None:
    settings = HandSettings(speed_mm_s=12.3, axes="-y+x+z", pointing=True)
    lines, asked = recorded(seed, settings)
    assert list(replayed(lines)) == asked
    assert sum(one.target is not None for one in asked) > 50
    assert sum(one.target is None for one in asked) > 20


def test_a_journal_that_was_cut_off_is_replayed_as_far_as_it_is_whole() -> None:
    lines, asked = recorded(1, HandSettings())
    whole = b"".join(lines)
    cut = whole[: len(whole) // 2].splitlines(keepends=True)
    again = list(replayed(cut))
    assert again == asked[: len(again)]
    assert len(again) > 100


def test_input_that_is_not_as_it_was_is_found_out() -> None:
    """A report while the tip is led says that the puck is lifted; it was not."""
    lines, asked = recorded(2, HandSettings())
    places = [one.target and one.target.position_mm for one in asked]
    led = next(
        i for i in range(1, 400) if places[i] and places[i - 1] and places[i] != places[i - 1]
    )
    place = [i for i, line in enumerate(lines) if line.startswith(b'["bytes"')][led]
    entry = msgspec.json.decode(lines[place])
    entry[2] = packed(entry[1], push(2, -350)).hex()
    lines[place] = msgspec.json.encode(entry) + b"\n"
    with pytest.raises(JournalError, match=r"line \d+: .*was asked for then, and now"):
        list(replayed(lines))


@pytest.mark.parametrize(
    ("line", "what"),
    [
        (b"", "line 1"),
        (b"no json\n", "line 1"),
        (b'{"kind": "another", "profile": "mouse", "ranges": {}, "settings": {}}\n', "another"),
        (
            b'{"kind": "tentacled steering/1", "profile": "x", "ranges": {}, "settings": {}}\n',
            "no kind of device",
        ),
        (
            b'{"kind": "tentacled steering/1", "profile": "mouse", "ranges": {}, '
            b'"settings": {"speed_mm_s": -1}}\n',
            "finite and more than 0",
        ),
        (
            b'{"kind": "tentacled steering/1", "profile": "mouse", "ranges": {}, '
            b'"settings": {"wrong": 1}}\n',
            "wrong",
        ),
        (
            b'{"kind": "tentacled steering/1", "profile": "mouse", "ranges": {}, '
            b'"settings": {"speed_mm_s": "x"}}\n',
            "line 1",
        ),
    ],
)
def test_a_file_that_is_no_journal_is_told_so(line: bytes, what: str) -> None:
    with pytest.raises(JournalError, match=what):
        list(replayed([line]))


@pytest.mark.parametrize(
    "entry",
    [b'["bytes", 1, "0x"]\n', b'["jump", 1]\n', b'["tip", 1]\n', b"{}\n", b"[1]\n", b"\xff\n"],
)
def test_a_line_that_is_none_is_named(entry: bytes) -> None:
    lines, _ = recorded(3, HandSettings())
    with pytest.raises(JournalError, match="line 7"):
        list(replayed([*lines[:6], entry, *lines[6:]]))


def test_moments_count_from_the_first_on() -> None:
    lines, _ = recorded(4, HandSettings())
    moments = [one.t_ns for one in replayed(lines)]
    assert moments == [PERIOD_NS * number for number in range(len(moments))]
