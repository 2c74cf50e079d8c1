"""Who sends when on the modelled bus, and who hears it."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.frame_length import frame_bits
from tests.sim_backends.can.rig import MS, Node


@pytest.mark.parametrize("bit_rate", [1_000_000, 500_000, 125_000])
def test_a_frame_is_heard_when_its_last_bit_is_over(bit_rate: int) -> None:
    bus = CanBus(bit_rate)
    sender, hearer = Node.on(bus), Node.on(bus)
    data = b"\x11\x22\x33"
    assert sender.port.send(0x181, data, 1000)
    bus.advance(10 * MS)
    end_ns = 1000 + frame_bits(0x181, data) * (1_000_000_000 // bit_rate)
    assert hearer.heard == [(0x181, data, end_ns)]


def test_nobody_hears_itself() -> None:
    bus = CanBus(1_000_000)
    sender, hearer = Node.on(bus), Node.on(bus)
    sender.port.send(0x181, b"", 0)
    bus.advance(MS)
    assert (sender.ids, hearer.ids) == ([], [0x181])


def test_the_lowest_identifier_wins_whenever_the_bus_is_free() -> None:
    bus = CanBus(1_000_000)
    nodes = [Node.on(bus) for _ in range(3)]
    hearer = Node.on(bus)
    nodes[0].port.send(0x300, b"", 0)
    nodes[1].port.send(0x200, b"", 0)
    nodes[2].port.send(0x700, b"", 0)
    nodes[2].port.send(0x100, b"", 0)
    bus.advance(MS)
    # 0x100 waits behind 0x700 in its own queue: a fifo lets nothing overtake.
    assert hearer.ids == [0x200, 0x300, 0x700, 0x100]


def test_mailboxes_let_a_low_identifier_overtake() -> None:
    bus = CanBus(1_000_000)
    drive, hearer = Node.on(bus, mailboxes=True), Node.on(bus)
    for can_id in (0x700, 0x185, 0x085):
        drive.port.send(can_id, b"", 0)
    bus.advance(MS)
    assert hearer.ids == [0x085, 0x185, 0x700]


def test_what_has_begun_is_not_interrupted() -> None:
    bus = CanBus(1_000_000)
    slow, urgent, hearer = Node.on(bus), Node.on(bus), Node.on(bus)
    slow.port.send(0x7FF, bytes(8), 0)
    urgent.port.send(0x001, b"", 10_000)
    bus.advance(MS)
    assert hearer.ids == [0x7FF, 0x001]


@pytest.mark.parametrize(
    ("winner", "loser"),
    [
        (0x080, 0x080 | REMOTE_FLAG),
        (0x080 | REMOTE_FLAG, 0x081),
        (0x080, 0x080 << 18 | EXTENDED_FLAG),
        (0x080 | REMOTE_FLAG, 0x080 << 18 | EXTENDED_FLAG),
        (0x080 << 18 | EXTENDED_FLAG, 0x081),
        (0x080 << 18 | EXTENDED_FLAG, 0x080 << 18 | 1 | EXTENDED_FLAG),
        (0x080 << 18 | EXTENDED_FLAG, 0x080 << 18 | EXTENDED_FLAG | REMOTE_FLAG),
    ],
)
def test_arbitration_between_kinds_of_frames(winner: int, loser: int) -> None:
    bus = CanBus(1_000_000)
    nodes, hearer = [Node.on(bus), Node.on(bus)], Node.on(bus)
    nodes[0].port.send(loser, b"", 0)
    nodes[1].port.send(winner, b"", 0)
    bus.advance(MS)
    assert hearer.ids == [winner, loser]


def test_frames_leave_back_to_back() -> None:
    bus = CanBus(1_000_000)
    sender, hearer = Node.on(bus), Node.on(bus)
    for number in range(3):
        sender.port.send(0x200 + number, bytes(6), 0)
    bus.advance(MS)
    times = [t_ns for _, _, t_ns in hearer.heard]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert gaps == [frame_bits(0x200 + number, bytes(6)) * 1000 for number in (1, 2)]


def test_a_frame_can_be_ready_later() -> None:
    bus = CanBus(1_000_000)
    sender, hearer = Node.on(bus), Node.on(bus)
    sender.port.send(0x181, b"", 500_000)
    assert bus.advance(0) == 500_000
    bus.advance(MS)
    assert hearer.heard[0][2] == 500_000 + frame_bits(0x181, b"") * 1000


def test_an_answer_from_a_handler_follows_at_once() -> None:
    bus = CanBus(1_000_000)
    asker, answerer = Node.on(bus), Node.on(bus)
    answerer.port.listen({0x601: lambda _id, _data, t_ns: _answer(t_ns)})

    def _answer(t_ns: int) -> None:
        answerer.port.send(0x581, bytes(8), t_ns)

    asker.port.send(0x601, bytes(8), 0)
    bus.advance(MS)
    question, answer = frame_bits(0x601, bytes(8)), frame_bits(0x581, bytes(8))
    assert asker.heard == [(0x581, bytes(8), (question + answer) * 1000)]


def test_a_full_queue_takes_no_more_and_tells_when_it_does() -> None:
    bus = CanBus(1_000_000)
    sender, _ = Node.on(bus, capacity=2), Node.on(bus)
    space: list[int] = []
    sender.port.on_space = space.append
    assert [sender.port.send(0x181, b"", 0) for _ in range(3)] == [True, True, False]
    assert sender.port.refused == 1
    bus.advance(MS)
    assert space == [frame_bits(0x181, b"") * 1000]
    assert sender.port.send(0x181, b"", MS)


def test_each_identifier_goes_to_those_who_asked_for_it() -> None:
    bus = CanBus(1_000_000)
    sender, one, other = Node.on(bus), Node.on(bus), Node.on(bus)
    got: list[str] = []
    one.port.listen({0x080: lambda *_: got.append("one sync"), 0x201: lambda *_: got.append("one")})
    other.port.listen({0x080: lambda *_: got.append("other sync")})
    for can_id in (0x080, 0x201, 0x202):
        sender.port.send(can_id, b"", 0)
    bus.advance(MS)
    assert got == ["one sync", "other sync", "one"]


@given(
    st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=8),
    st.sampled_from([0, 50_000, 200_000]),
    st.integers(1, 12),
    st.booleans(),
)
def test_frames_queued_together_leave_as_if_queued_one_by_one(
    frames: list[tuple[int, bytes]], t_ns: int, capacity: int, mailboxes: bool
) -> None:
    def play(*, together: bool) -> tuple[list[tuple[int, bytes, int]], int, int]:
        bus = CanBus(1_000_000)
        sender = Node.on(bus, capacity, mailboxes=mailboxes)
        other, hearer = Node.on(bus), Node.on(bus)
        bus.advance(50_000)
        other.port.send(0x3FF, bytes(8), 50_000)
        for _ in range(2):
            if together:
                sender.port.send_all(frames, t_ns)
            else:
                for can_id, data in frames:
                    sender.port.send(can_id, data, t_ns)
        bus.advance(10 * MS)
        return hearer.heard, sender.port.refused, sender.port.pending

    assert play(together=True) == play(together=False)


def test_the_same_happens_however_often_the_bus_is_called() -> None:
    def play(step_ns: int) -> list[tuple[int, bytes, int]]:
        bus = CanBus(1_000_000)
        nodes, hearer = [Node.on(bus, mailboxes=True) for _ in range(3)], Node.on(bus)
        for number, node in enumerate(nodes):
            for turn in range(5):
                node.port.send(0x100 + 7 * number + turn, bytes(turn), 20_000 * turn + number)
        for t_ns in range(0, 2 * MS, step_ns):
            bus.advance(t_ns)
        return hearer.heard

    assert play(1_000) == play(17_321) == play(1_999_999)


def test_slack_lets_the_bus_be_called_later_but_changes_no_time() -> None:
    times: list[list[tuple[int, bytes, int]]] = []
    for slack_ns in (0, 100_000):
        bus = CanBus(1_000_000, slack_ns=slack_ns)
        sender, hearer = Node.on(bus), Node.on(bus)
        sender.port.send(0x181, b"\x01", 0)
        due_ns = bus.advance(0)
        assert due_ns == frame_bits(0x181, b"\x01") * 1000 + slack_ns
        bus.advance(due_ns)
        times.append(hearer.heard)
    assert times[0] == times[1]


def test_load_is_the_share_of_time_the_bus_is_busy() -> None:
    bus = CanBus(500_000)
    sender, _ = Node.on(bus), Node.on(bus)
    before = bus.statistics()
    sender.port.send(0x181, bytes(8), 0)
    sender.port.send(0x181, bytes(8), 0)
    bus.advance(MS)
    after = bus.statistics()
    assert after.frames - before.frames == 2
    assert after.load_since(before) == pytest.approx(2 * frame_bits(0x181, bytes(8)) * 2000 / MS)


def test_a_frame_under_way_counts_only_as_far_as_it_has_got() -> None:
    bus = CanBus(1_000_000)
    sender, _ = Node.on(bus), Node.on(bus)
    before = bus.statistics()
    sender.port.send(0x181, bytes(8), 0)
    bus.advance(10_000)
    assert bus.statistics().load_since(before) == pytest.approx(1.0)


def test_a_detached_node_neither_hears_nor_sends() -> None:
    bus = CanBus(1_000_000)
    sender, leaver, hearer = Node.on(bus), Node.on(bus), Node.on(bus)
    leaver.port.send(0x100, b"", 0)
    bus.detach(leaver.port)
    sender.port.send(0x200, b"", 0)
    bus.advance(MS)
    assert (leaver.ids, hearer.ids) == ([], [0x200])


@given(
    st.lists(
        st.tuples(
            st.integers(0, 2), st.integers(0, 0x7FF), st.binary(max_size=8), st.integers(0, 2 * MS)
        ),
        max_size=20,
    )
)
def test_no_frame_is_lost_doubled_or_overlapping(
    sends: list[tuple[int, int, bytes, int]],
) -> None:
    bus = CanBus(1_000_000)
    nodes, hearer = [Node.on(bus, 32, mailboxes=True) for _ in range(3)], Node.on(bus)
    for sender, can_id, data, t_ns in sends:
        assert nodes[sender].port.send(can_id, data, t_ns)
    bus.advance(20 * MS)
    sent = sorted((can_id, data) for _, can_id, data, _ in sends)
    assert sorted((can_id, data) for can_id, data, _ in hearer.heard) == sent
    free_ns = 0
    for can_id, data, end_ns in hearer.heard:
        start_ns = end_ns - frame_bits(can_id, data) * 1000
        assert start_ns >= free_ns
        free_ns = end_ns
