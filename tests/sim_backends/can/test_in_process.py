"""The bus as a link in the same process, in virtual time."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import dataclass, field
from typing import Any

import pytest

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG
from drivers.can.link import CanLink, LinkError
from drivers.conditions import Condition
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.frame_length import frame_bits
from sim_backends.devices.can.in_process import InProcessLink
from sim_backends.devices.device import Pump
from sim_backends.virtual_time import VirtualClock, run_in_virtual_time, virtual_clock
from tests.sim_backends.can.rig import Node


@dataclass
class Receiver:
    """Keeps what the link tells."""

    frames: list[tuple[int, bytes, int]] = field(default_factory=list)
    conditions: list[tuple[str, bool]] = field(default_factory=list)
    lost: list[OSError] = field(default_factory=list)
    on_frame: Callable[[int], None] | None = None

    def frame_received(self, can_id: int, data: bytes, t_ns: int) -> None:
        self.frames.append((can_id, data, t_ns))
        if self.on_frame is not None:
            self.on_frame(can_id)

    def condition_seen(self, condition: Condition, present: bool, detail: str) -> None:
        self.conditions.append((condition.name, present))

    def link_lost(self, error: OSError) -> None:
        self.lost.append(error)


class Rig:
    """A link and a plain node on one bus."""

    def __init__(self, clock: VirtualClock, **options: Any) -> None:
        self.clock = clock
        self.bus = CanBus(1_000_000)
        self.pump = Pump(self.bus, clock)
        self.faults = BusFaults(self.bus)
        self.receiver = Receiver()
        self.options = options
        self.link = self.open()
        self.node = Node.on(self.bus)

    def open(self) -> InProcessLink:
        return InProcessLink(self.bus, self.pump, self.clock, self.receiver, **self.options)

    def inject(self, fault: str, **arguments: Any) -> None:
        self.faults.inject(fault, arguments, self.clock.now_ns())
        self.pump.touch()


def play(scene: Callable[[Rig], Coroutine[Any, Any, None]], **options: Any) -> None:
    async def main() -> None:
        await scene(Rig(virtual_clock(), **options))

    run_in_virtual_time(main())


def test_it_is_a_link_as_the_master_knows_it() -> None:
    async def scene(rig: Rig) -> None:
        link: CanLink = rig.link
        assert link.send(0x601, bytes(8))
        await asyncio.sleep(0.001)
        assert rig.node.heard == [(0x601, bytes(8), frame_bits(0x601, bytes(8)) * 1000)]

    play(scene)


def test_frames_come_in_at_their_own_time() -> None:
    async def scene(rig: Rig) -> None:
        seen_at: list[int] = []
        rig.receiver.on_frame = lambda _: seen_at.append(rig.clock.now_ns())
        rig.node.port.send(0x181, b"\x01", 0)
        rig.pump.touch()
        await asyncio.sleep(0.001)
        end_ns = frame_bits(0x181, b"\x01") * 1000
        assert rig.receiver.frames == [(0x181, b"\x01", end_ns)]
        assert seen_at == [pytest.approx(end_ns, abs=1)]

    play(scene)


def test_a_frame_may_be_answered_from_where_it_comes_in() -> None:
    async def scene(rig: Rig) -> None:
        def answer(can_id: int) -> None:
            rig.link.send(can_id + 1, b"")

        rig.receiver.on_frame = answer
        rig.node.port.send(0x181, b"", 0)
        rig.pump.touch()
        await asyncio.sleep(0.001)
        assert rig.node.ids == [0x182]

    play(scene)


def test_what_the_master_cannot_use_does_not_reach_it() -> None:
    async def scene(rig: Rig) -> None:
        rig.node.port.send(0x701 | REMOTE_FLAG, b"", 0)
        rig.node.port.send(0x18DAF110 | EXTENDED_FLAG, b"", 0)
        rig.node.port.send(0x181, b"", 0)
        rig.pump.touch()
        await asyncio.sleep(0.001)
        assert [can_id for can_id, _, _ in rig.receiver.frames] == [0x181]

    play(scene)


def test_a_full_queue_is_told_once_and_again_when_there_is_room() -> None:
    async def scene(rig: Rig) -> None:
        assert [rig.link.send(0x200, b"") for _ in range(6)] == [True] * 4 + [False] * 2
        await asyncio.sleep(0.01)
        assert rig.link.send(0x200, b"")
        assert rig.receiver.conditions == [("bus_queue_full", True), ("bus_queue_full", False)]

    play(scene, queue_frames=4)


def test_bus_off_and_its_end() -> None:
    async def scene(rig: Rig) -> None:
        rig.inject("off")
        assert rig.link.send(0x200, b"")
        await asyncio.sleep(0.2)
        assert rig.receiver.conditions[0] == ("bus_off", True)
        assert ("bus_off", False) in rig.receiver.conditions
        assert rig.node.ids == []
        rig.link.send(0x201, b"")
        await asyncio.sleep(0.001)
        assert rig.node.ids == [0x201]

    play(scene, restart_s=0.1)


def test_down_and_up() -> None:
    async def scene(rig: Rig) -> None:
        rig.inject("down", duration=0.1)
        assert not rig.link.send(0x200, b"")
        rig.node.port.send(0x181, b"", rig.clock.now_ns())
        await asyncio.sleep(0.2)
        assert rig.receiver.conditions == [("bus_down", True), ("bus_down", False)]
        assert rig.link.send(0x201, b"")

    play(scene)


def test_pulled_out_and_opened_again() -> None:
    async def scene(rig: Rig) -> None:
        rig.inject("unplug", duration=0.1)
        assert len(rig.receiver.lost) == 1
        assert not rig.link.send(0x200, b"")
        with pytest.raises(LinkError, match="not there"):
            rig.open()
        await asyncio.sleep(0.2)
        link = rig.open()
        assert link.send(0x201, b"")
        await asyncio.sleep(0.001)
        assert rig.node.ids == [0x201]
        link.close()
        link.close()
        assert not link.send(0x202, b"")

    play(scene)


def test_two_runs_are_the_same() -> None:
    runs: list[list[tuple[int, bytes, int]]] = []

    async def scene(rig: Rig) -> None:
        rig.inject("drop", probability=0.3, duration=1e9)
        rig.inject("babble", rate_per_s=900.0, duration=1e9)
        for number in range(50):
            rig.node.port.send(0x180 + number, b"", rig.clock.now_ns())
            rig.pump.touch()
            await asyncio.sleep(0.001)
        runs.append(rig.receiver.frames)

    play(scene)
    play(scene)
    assert runs[0] == runs[1]
    assert len(runs[0]) > 10
