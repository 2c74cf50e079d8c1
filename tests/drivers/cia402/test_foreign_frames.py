"""Others on the bus are told apart and named; what they do is undone when they have gone."""

import asyncio

import pytest

from drivers.can.conditions import FOREIGN_FRAMES, FOREIGN_MASTER
from drivers.can.link import CanLink, FrameReceiver
from drivers.cia402.foreign_frames import ENDS_AFTER_NS, ForeignFrames
from drivers.cia402.node import NodeState
from drivers.cia402.power_state import PowerGoal
from drivers.conditions import ConditionChange, Conditions
from tests.drivers.cia402.rig import Rig, on_a_rig


class Watched:
    def __init__(self) -> None:
        self.told: list[tuple[str, bool, str]] = []
        self.written: list[tuple[int, int, int]] = []
        self.frames = ForeignFrames(
            "can0",
            127,
            [0x1A5],
            Conditions(self._changed),
            lambda *written: self.written.append(written),
        )

    def _changed(self, change: ConditionChange) -> None:
        active = change.active
        self.told.append((active.condition.name, change.present, active.detail))


@pytest.mark.parametrize(
    ("can_id", "data", "said"),
    [
        (0x000, "8103", "NMT command 'reset node' to node 3"),
        (0x000, "0100", "NMT command 'start' to all nodes"),
        (0x000, "4200", "NMT command '0x42' to all nodes"),
        (0x000, "81", "NMT command 81"),
        (0x000, "", "NMT command "),
        (0x080, "", "SYNC"),
        (0x080, "07", "SYNC"),
        (0x77F, "05", "heartbeat of master node 127"),
        (0x7E5, "0401000000000000", "LSS command"),
        (0x201, "0f0000000000", "set-point for node 1"),
        (0x57F, "00", "set-point for node 127"),
        (0x1A5, "00", "set-point, identifier 0x1A5"),
        (0x603, "4018100100000000", "SDO read of node 3"),
        (0x603, "a018100100000000", "SDO read of node 3"),
        (0x603, "6000000000000000", "SDO request of node 3"),
        (0x603, "", "SDO request of node 3"),
        (0x603, "22", "SDO request of node 3"),
        (0x67F, "2f5a600002000000", "SDO write to 0x605A:00 of node 127"),
        (0x601, "2116100100000000", "SDO write to 0x1016:01 of node 1"),
        (0x601, "c216100100000000", "SDO write to 0x1016:01 of node 1"),
    ],
)
def test_what_only_a_master_sends_is_named(can_id: int, data: str, said: str) -> None:
    one = Watched()
    one.frames.received(can_id, bytes.fromhex(data), 5)
    assert one.told == [(FOREIGN_MASTER.name, True, said)]
    assert one.frames.master_present
    assert bool(one.written) is ("write" in said)


@pytest.mark.parametrize("can_id", [0x010, 0x100, 0x0AA, 0x1A0, 0x5A0, 0x70A, 0x7E4, 0x600, 0x680])
def test_other_strangers_are_told_of_and_are_no_masters(can_id: int) -> None:
    one = Watched()
    one.frames.received(can_id, bytes.fromhex("2f5a600002000000"), 5)
    assert one.told == [(FOREIGN_FRAMES.name, True, f"identifier 0x{can_id:X}")]
    assert not one.frames.master_present
    assert one.written == []


def test_it_ends_when_nothing_has_come_for_a_while_each_for_itself() -> None:
    one = Watched()
    one.frames.received(0x080, b"", 0)
    one.frames.received(0x010, b"", ENDS_AFTER_NS // 2)
    one.frames.received(0x080, b"", ENDS_AFTER_NS)
    one.frames.watch(3 * ENDS_AFTER_NS // 2)
    assert [present for _, present, _ in one.told] == [True, True]
    one.frames.watch(3 * ENDS_AFTER_NS // 2 + 1)
    assert one.told[2:] == [(FOREIGN_FRAMES.name, False, "identifier 0x10")]
    present = []
    for t_ns in (2 * ENDS_AFTER_NS, 2 * ENDS_AFTER_NS + 1):
        one.frames.watch(t_ns)
        present.append(one.frames.master_present)
    assert present == [True, False]
    assert one.told[3:] == [(FOREIGN_MASTER.name, False, "SYNC")]
    one.frames.received(0x000, b"\x81\x00", 9 * ENDS_AFTER_NS)
    assert one.told[4][1:] == (True, "NMT command 'reset node' to all nodes")


def test_a_new_link_begins_with_nothing_heard() -> None:
    one = Watched()
    one.frames.received(0x080, b"", 0)
    one.frames.forget()
    assert not one.frames.master_present


def test_no_node_is_set_up_while_another_master_is_there() -> None:
    """Its drives may be moving: a reset of their communication would stop them."""

    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("bus.can0.foreign_master=5s")
        await asyncio.sleep(0.5)
        rig.frames.clear()
        rig.inject("drive.can0/1.reset")
        await asyncio.sleep(4.0)
        assert not [frame for frame in rig.frames if frame[0] in (0x000, 0x601)]
        assert rig.master.nodes[1].state is not NodeState.OPERATIONAL
        assert rig.master.nodes[2].state is NodeState.OPERATIONAL
        await asyncio.sleep(1.0)
        await rig.operational()
        assert rig.holding() == set()

    on_a_rig(test)


def test_the_master_listens_first_and_keeps_silent_until_the_other_one_has_gone() -> None:
    async def test(rig: Rig) -> None:
        rig.master._listens_first_s = 0.25
        rig.inject("bus.can0.foreign_master=3s")
        await asyncio.sleep(2.9)
        assert ("bus_foreign_master", "can0") in rig.holding()
        assert rig.master.traffic.sent == 0
        assert not rig.master.connected
        await asyncio.sleep(1.5)
        await rig.operational()
        assert rig.holding() == set()

    on_a_rig(test)


def test_a_link_that_is_lost_while_it_listens_is_opened_again() -> None:
    async def test(rig: Rig) -> None:
        rig.master._listens_first_s = 0.25
        rig.inject("bus.can0.foreign_master=3s")
        await asyncio.sleep(1.0)
        rig.inject("bus.can0.unplug=0.5s")
        await asyncio.sleep(1.0)
        assert rig.master.traffic.sent == 0
        await rig.operational()

    on_a_rig(test)


def test_a_master_that_is_ended_while_it_listens_lets_go_of_the_link() -> None:
    closed: list[CanLink] = []

    async def test(rig: Rig) -> None:
        rig.master._listens_first_s = 1000.0
        opener = rig.master._open_link

        async def open_link(receiver: FrameReceiver) -> CanLink:
            link = await opener(receiver)
            close = link.close

            def closing() -> None:
                closed.append(link)
                close()

            link.close = closing  # type: ignore[method-assign]
            return link

        rig.master._open_link = open_link
        await asyncio.sleep(1.0)

    on_a_rig(test)
    assert len(closed) == 1


def test_a_setting_that_somebody_else_wrote_is_written_back_when_the_drives_are_off() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.inject("bus.can0.foreign_write=2,0x6085,0,7")
        await asyncio.sleep(3.0)
        assert rig.holding() == {("node_settings_changed", "can0/2")}
        assert rig.detail_of("node_settings_changed") == (
            "somebody else wrote to 0x6085:00 (quick stop ramp)"
        )
        assert all(channel.following for channel in rig.master.channels)
        (wrong,) = await rig.master.check_settings(1.0)
        assert wrong.startswith("can0/2 0x6085:00 (quick stop ramp) reads 7, not ")
        rig.master.set_goal(PowerGoal.OFF)
        await rig.until(lambda: not rig.holding())
        await rig.operational()
        assert await rig.master.check_settings(1.0) == []

    on_a_rig(test)


@pytest.mark.parametrize("index", ["0x1600", "0x1A00", "0x1400", "0x1800", "0x1010", "0x1011"])
def test_writing_to_pdos_or_the_whole_configuration_counts_too(index: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject(f"bus.can0.foreign_write=1,{index},1,0")
        await rig.until(lambda: "node_settings_changed" in rig.names())
        await rig.until(lambda: not rig.holding())

    on_a_rig(test)


def test_what_we_have_not_set_may_be_written_by_anybody() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.inject("bus.can0.foreign_write=1,0x2005,0,0")
        rig.inject("bus.can0.foreign_write=99,0x6085,0,0")
        await asyncio.sleep(3.0)
        assert rig.names() == {"bus_foreign_master"}

    on_a_rig(test)


def test_settings_that_are_not_shown_in_time_are_said_to_be() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert await rig.master.check_settings(1.0) == []
        assert len(await rig.master.check_settings(0.001)) == 2
        rig.inject("drive.can0/1.sdo_silent=5s")
        (wrong,) = await rig.master.check_settings(1.0)
        assert wrong.startswith("can0/1 does not show its settings: node 1 0x")
        rig.inject("drive.can0/2.dead=5s")
        began_ns = rig.clock.now_ns()
        (wrong,) = await rig.master.check_settings(1.0)
        assert wrong.startswith("can0/1 "), "that node 2 is gone is told as such"
        assert rig.clock.now_ns() - began_ns < 1_100_000_000

    on_a_rig(test)
