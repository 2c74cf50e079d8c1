"""Faults of the bus, by the orders an operator would give."""

import pytest

from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BUS_FAULTS, BusFaults
from sim_backends.devices.can.port import Adapter, ControllerState, Port
from sim_backends.faults import FaultError, understand
from tests.sim_backends.can.rig import MS, Node


class OneNode:
    """The least that is an adapter."""

    def __init__(self, node: Node) -> None:
        self.node = node
        self.told: list[str] = []

    def ports(self) -> list[Port]:
        return [self.node.port]

    def set_up(self, up: bool) -> None:
        self.told.append("up" if up else "down")

    def set_plugged(self, plugged: bool) -> None:
        self.told.append("plugged" if plugged else "pulled")


class Rig:
    def __init__(self) -> None:
        self.bus = CanBus(1_000_000, seed=1)
        self.devices = {"bus.can0": BusFaults(self.bus)}
        self.master, self.drive = Node.on(self.bus, 64), Node.on(self.bus, 64)
        self.adapter = OneNode(self.master)
        adapter: Adapter = self.adapter
        self.bus.adapters.append(adapter)
        self.master.port.restart_after_ns = 100 * MS

    def order(self, text: str) -> None:
        understand(self.devices, f"bus.can0.{text}").carry_out(self.bus.now_ns)

    def run(self, milliseconds: float) -> None:
        self.bus.advance(self.bus.now_ns + round(milliseconds * MS))


def test_every_fault_can_be_ordered_and_ends() -> None:
    rig = Rig()
    for fault in BUS_FAULTS:
        arguments = [
            "10ms" if p.name == "duration" else "1" if p.default is None else str(p.default)
            for p in fault.parameters
        ]
        rig.order(f"{fault.name}={','.join(arguments)}")
        rig.run(300)
    rig.drive.heard.clear()
    assert rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(1)
    assert rig.drive.ids == [0x181]


@pytest.mark.parametrize(
    ("frames", "can_id"),
    [("sync", 0x080), ("heartbeat", 0x77F), ("nmt", 0x000), ("sdo", 0x601), ("setpoint", 0x201)],
)
def test_another_master_says_one_thing_again_and_again_while_it_is_there(
    frames: str, can_id: int
) -> None:
    rig = Rig()
    rig.order(f"foreign_master=500ms,{frames}")
    rig.run(499)
    assert set(rig.drive.ids) == {can_id}
    assert 8 <= len(rig.drive.ids) <= 11
    rig.run(1000)
    assert len(rig.drive.ids) <= 11
    with pytest.raises(FaultError, match="sends sync, heartbeat"):
        rig.order("foreign_master=500ms,telegrams")


def test_another_master_writes_one_object_once() -> None:
    rig = Rig()
    rig.order("foreign_write=3,0x605A,0,-2")
    rig.run(1000)
    assert rig.drive.ids == [0x603]
    assert rig.drive.heard[0][1] == bytes.fromhex("225a6000feffffff")
    for wrong in ("200,0x605A", "3,0x1605A", "3,0x605A,300", "3,0x605A,0,1e12"):
        with pytest.raises(FaultError, match="no such object can be written"):
            rig.order(f"foreign_write={wrong}")


def test_off_takes_adapters_off_the_bus_but_no_drives() -> None:
    rig = Rig()
    rig.order("off")
    assert rig.master.states == [ControllerState.OFF]
    assert rig.drive.states == []
    rig.run(99)
    assert rig.master.states == [ControllerState.OFF]
    rig.run(2)
    assert rig.master.states == [ControllerState.OFF, ControllerState.ACTIVE]


def test_passive_lasts_however_well_frames_go() -> None:
    rig = Rig()
    rig.order("passive=50ms")
    for _ in range(60):
        rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(49)
    assert rig.master.states == [ControllerState.PASSIVE]
    rig.run(2)
    assert rig.master.states == [ControllerState.PASSIVE, ControllerState.ACTIVE]


def test_down_and_unplug_are_told_to_the_adapters() -> None:
    rig = Rig()
    rig.order("down=10ms")
    rig.run(20)
    rig.order("unplug=10ms")
    rig.run(20)
    assert rig.adapter.told == ["down", "up", "pulled", "plugged"]
    assert rig.bus.up
    assert rig.bus.plugged


def test_full_lets_nothing_through_and_afterwards_everything() -> None:
    rig = Rig()
    rig.order("full=50ms")
    assert all(rig.master.port.send(0x181, b"", rig.bus.now_ns) for _ in range(64))
    assert not rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(49)
    assert rig.drive.ids == []
    rig.run(20)
    assert rig.drive.ids == [0x181] * 64


def test_drop_loses_frames() -> None:
    rig = Rig()
    rig.order("drop=0.5")
    for _ in range(60):
        rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(10)
    assert 15 < len(rig.drive.heard) < 45


def test_corrupt_costs_time_but_loses_nothing() -> None:
    rig = Rig()
    rig.order("corrupt=0.3")
    for _ in range(60):
        rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(20)
    assert len(rig.drive.heard) == 60
    assert rig.bus.statistics().error_frames > 5


def test_a_babbling_node_fills_the_bus_and_wins() -> None:
    rig = Rig()
    rig.order("babble=5000,100ms")
    rig.run(1)
    before = rig.bus.statistics()
    rig.run(50)
    assert rig.bus.statistics().load_since(before) == pytest.approx(0.6, abs=0.1)
    assert set(rig.master.ids) == {0x010}
    assert 240 < len(rig.master.heard) < 270
    rig.run(100)
    rig.master.heard.clear()
    rig.run(10)
    assert rig.master.heard == []


def test_delayed_frames_come_in_order_and_late() -> None:
    rig = Rig()
    rig.order("delay=20ms,100ms")
    for number in range(5):
        rig.drive.port.send(0x181 + number, b"", rig.bus.now_ns)
    rig.run(15)
    assert rig.master.ids == []
    rig.run(10)
    assert rig.master.ids == [0x181 + number for number in range(5)]
    assert rig.master.heard[0][2] > 20 * MS


def test_injecting_again_prolongs() -> None:
    rig = Rig()
    rig.order("full=20ms")
    rig.run(15)
    rig.order("full=20ms")
    rig.master.port.send(0x181, b"", rig.bus.now_ns)
    rig.run(15)
    assert rig.drive.ids == []
    rig.run(10)
    assert rig.drive.ids == [0x181]


@pytest.mark.parametrize("order", ["drop=1.5", "corrupt=2", "babble=0", "babble=1e9", "drop=-1"])
def test_what_cannot_be_is_refused(order: str) -> None:
    with pytest.raises(FaultError):
        Rig().order(order)
