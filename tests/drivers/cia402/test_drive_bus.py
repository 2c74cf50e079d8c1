"""The master brings drives up, keeps them in step, and takes them down again."""

import asyncio
import struct
from dataclasses import replace
from typing import Any

import pytest

from config.emulation.lab import EmulatedDrives
from drivers.canopen.codec.nmt import NmtState
from drivers.cia402 import conditions, objects
from drivers.cia402.configuration import Need, node_settings
from drivers.cia402.node import NodeState
from drivers.cia402.power_state import PowerGoal, PowerState
from tests.drivers.cia402.rig import BUS, Rig, axes, on_a_rig


def test_drives_come_up_without_being_energised() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        await asyncio.sleep(1.0)
        assert [channel.state for channel in rig.master.channels] == [
            PowerState.SWITCH_ON_DISABLED
        ] * 6
        assert not any(can_id & 0x780 == 0x200 for can_id, _ in rig.frames)
        assert rig.names() == set()
        node = rig.master.nodes[1]
        assert node.identity is not None
        assert node.identity.name == "Emulated stepper drive"

    on_a_rig(test, robot_axes=axes(6))


def test_what_is_configured_is_what_the_drives_have() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        for setting in node_settings(BUS, [rig.axes[0]]):
            data = await rig.master.nodes[1].sdo.read(setting.index, setting.subindex)
            dictionary = rig.master.nodes[1].dictionary
            assert dictionary.decode(setting.index, setting.subindex, data) in setting.values

    on_a_rig(test)


def test_the_drives_own_safety_objects_are_all_in_the_table() -> None:
    table = {(s.index, s.subindex): s for s in node_settings(BUS, axes(1))}
    for index, subindex in (
        (objects.CONSUMER_HEARTBEAT, 1),
        (objects.ERROR_BEHAVIOUR, 1),
        (objects.ABORT_CONNECTION_OPTION, 0),
        (objects.QUICK_STOP_OPTION, 0),
        (objects.FAULT_REACTION_OPTION, 0),
        (objects.QUICK_STOP_DECELERATION, 0),
        (objects.SOFTWARE_POSITION_LIMIT, 1),
        (objects.SOFTWARE_POSITION_LIMIT, 2),
        (objects.FOLLOWING_ERROR_WINDOW, 0),
        (objects.FOLLOWING_ERROR_TIMEOUT, 0),
        (objects.MAX_TORQUE, 0),
    ):
        assert table[index, subindex].need is not Need.OPTIONAL
    assert (objects.INTERPOLATION_PERIOD, 1) in table
    assert (objects.INTERPOLATION_PERIOD, 2) in table
    assert table[objects.CONSUMER_HEARTBEAT, 1].values == (0x007F00C8,)


def test_all_axes_are_enabled_in_the_same_cycle_and_stand_still() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        before = rig.positions()
        states: list[tuple[PowerState, ...]] = []
        rig.master.set_goal(PowerGoal.ENABLED)
        while not all(channel.following for channel in rig.master.channels):
            states.append(tuple(channel.state for channel in rig.master.channels))
            await asyncio.sleep(0.01)
        for together in states:
            enabled = [state is PowerState.OPERATION_ENABLED for state in together]
            assert all(enabled) or not any(enabled)
        assert rig.positions() == before

    on_a_rig(test, robot_axes=axes(6))


def test_three_axes_on_one_node_are_three_axes() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        assert set(rig.master.nodes) == {1, 2}
        start = rig.positions()
        rig.master.write(rig.step(1000, 0.2))
        await asyncio.sleep(0.5)
        assert rig.positions() == [s + 1000 for s in start]

    on_a_rig(test, robot_axes=axes(6, per_node=3))


def test_closing_stops_the_drives_then_takes_their_power_then_falls_silent() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(20_000, 2.0))
        await asyncio.sleep(0.5)
        rig.frames.clear()
        await rig.master.close()
        words = [
            int.from_bytes(data[:2], "little") for can_id, data in rig.frames if can_id == 0x201
        ]
        assert words[0] == 0x02
        assert words[-1] == 0x00
        assert all(drive.axes[0].power.state.value for drive in rig.drives)
        assert not any(drive.axes[0].shaft.energised for drive in rig.drives)
        assert rig.drives[0].nmt.state is NmtState.PRE_OPERATIONAL
        rig.frames.clear()
        await asyncio.sleep(0.5)
        assert not rig.master.connected

    on_a_rig(test)


def test_drives_stop_by_themselves_when_the_heartbeat_is_held_back() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(20_000, 2.0))
        await asyncio.sleep(0.5)
        rig.healthy = False
        await asyncio.sleep(0.25)
        positions = [drive.axes[0].shaft.position for drive in rig.drives]
        rig.healthy = True
        await asyncio.sleep(0.5)
        assert [drive.axes[0].shaft.position for drive in rig.drives] == pytest.approx(
            positions, abs=200
        )
        assert "0x8130" in rig.detail_of("drive_emergency")
        await rig.operational()
        assert all(channel.goal is None for channel in rig.master.channels)

    on_a_rig(test)


def test_a_node_without_power_is_absent_and_comes_up_when_it_gets_it() -> None:
    async def test(rig: Rig) -> None:
        await asyncio.sleep(5.0)
        assert rig.holding() >= {("node_absent", "can0/1"), ("node_absent", "can0/2")}
        assert ("bus_queue_full", "can0") in rig.holding()  # nobody acknowledges
        for drive in rig.drives:
            drive.power_on(rig.clock.now_ns())
        rig.pump.touch()
        await rig.operational()
        assert rig.holding() == set()

    on_a_rig(test, powered=False)


@pytest.mark.parametrize(
    ("drive", "says"),
    [
        ({"product_code": 1}, "product code is 0x57E1, not 0x1"),
        ({"vendor_id": 0xFB}, "vendor ID is 0x7E57, not 0xFB"),
    ],
)
def test_another_device_than_the_file_names_is_not_used(drive: dict[str, Any], says: str) -> None:
    async def test(rig: Rig) -> None:
        await asyncio.sleep(3.0)
        assert ("node_wrong_device", "can0/1") in rig.holding()
        assert says in rig.detail_of("node_wrong_device")
        assert rig.master.nodes[1].state is not NodeState.OPERATIONAL

    on_a_rig(test, robot_axes=axes(1, **drive))


@pytest.mark.parametrize(
    ("quirk", "condition"),
    [
        ("boots_twice", None),
        ("csp_not_listed", "drive_mode_not_listed"),
        ("emcy_short", None),
        ("fixed_mapping_count", None),
        ("even_mapping_only", None),
        ("no_dummy_mapping", None),
        ("factory_pdos_flood", None),
        ("guarding_excludes_heartbeat", None),
        ("interpolation_index_fixed", None),
        ("interpolation_while_inactive", None),
        ("late_sync_holds", None),
        ("no_encoder", None),
        ("communication_error_stops", None),
    ],
)
def test_every_products_ways_are_got_along_with(quirk: str, condition: str | None) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        start = rig.positions()
        rig.master.write(rig.step(1000, 0.2))
        await asyncio.sleep(0.5)
        assert rig.positions() == pytest.approx([s + 1000 for s in start], abs=1)
        assert rig.names() == ({condition} if condition else set())

    on_a_rig(test, options=EmulatedDrives(quirks=(quirk,)))  # type: ignore[arg-type]


def test_settings_survive_a_master_that_starts_anew() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.bus.adapters[0].set_plugged(False)  # the next one is there at once
        await asyncio.sleep(0.01)
        await rig.operational()
        await rig.enabled()

    on_a_rig(test)


def test_two_runs_with_one_seed_exchange_the_same_frames() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(1000, 0.2))
        await asyncio.sleep(0.5)

    one, other = on_a_rig(test), on_a_rig(test)
    assert one.frames == other.frames
    assert len(one.frames) > 500


def test_a_faster_cycle_and_a_slower_bus_work_too() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(1000, 0.2))
        await asyncio.sleep(0.5)

    fast = BUS.model_copy(update={"cycle_period_s": 0.002})
    slow = BUS.model_copy(update={"bitrate_bit_s": 250_000, "cycle_period_s": 0.02})
    assert on_a_rig(test, bus=fast).master.traffic.refused == 0
    assert on_a_rig(test, bus=slow).master.traffic.refused == 0


@pytest.mark.parametrize(
    ("trouble", "condition"), [("off", "bus_off"), ("passive=0.2s", "bus_error_passive")]
)
def test_a_controller_that_was_set_down_and_up_is_well_again(trouble: str, condition: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        for adapter in rig.bus.adapters:
            for port in adapter.ports():
                port.restart_after_ns = None  # as SocketCAN without restart-ms
        rig.inject(f"bus.can0.{trouble}")
        await asyncio.sleep(0.1)
        assert (condition, "can0") in rig.holding()
        rig.inject("bus.can0.down=0.5s")
        await asyncio.sleep(0.4)
        assert ("bus_down", "can0") in rig.holding()
        await asyncio.sleep(6.0)
        await rig.enabled()
        assert rig.holding() == set()

    on_a_rig(test)


def test_traffic_is_counted() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        before = replace(rig.master.traffic)
        await asyncio.sleep(1.0)
        after = rig.master.traffic
        assert after.sent - before.sent == pytest.approx(100 + 20, abs=2)
        assert after.received - before.received == pytest.approx(2 * (100 + 10), abs=4)

    on_a_rig(test)


def test_one_state_in_a_wrong_form_does_not_keep_a_node_from_being_ready_for_ever() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        node, channel = rig.master.nodes[1], rig.master.channels[0]
        node.state_handler(channel)(b"abc", rig.clock.now_ns())
        await asyncio.sleep(0.4)
        assert ("node_pdo_malformed", "can0/1") in rig.holding()
        await asyncio.sleep(0.3)
        assert rig.holding() == set()
        assert node.state is NodeState.OPERATIONAL

    on_a_rig(test)


def test_what_an_earlier_set_up_found_is_forgotten_when_the_next_does_not_find_it() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        for condition in (conditions.MODE_REFUSED, conditions.SAFETY_MISSING):
            rig.master.conditions.set(condition, "can0/1", rig.clock.now_ns())
        rig.inject("drive.can0/1.reset")
        await rig.until(lambda: rig.master.nodes[1].state is not NodeState.OPERATIONAL)
        await rig.operational()
        assert rig.holding() == set()

    on_a_rig(test)


def test_a_storm_of_errors_is_told_in_a_few_words_and_the_newest_stays() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        rig.told.clear()
        for number in range(1000):
            code = 0x1000 + number if number % 3 else 0  # 0: the error is gone
            rig.master.frame_received(0x81, struct.pack("<HB5x", code, 1), rig.clock.now_ns())
            rig.master.frame_received(0x82, b"\x01", rig.clock.now_ns())
            await asyncio.sleep(0.0002)
        changes = [one for one in rig.told if one.name == "drive_emergency"]
        assert 2 < len(changes) < 40, "in 0.2 s, of two nodes"
        last = 0x1000 + 998
        rig.master.frame_received(0x81, struct.pack("<HB5x", last, 1), rig.clock.now_ns())
        await asyncio.sleep(0.1)
        assert f"0x{last:04X}" in rig.detail_of("drive_emergency")

    on_a_rig(test)


def test_a_drive_that_says_nothing_sensible_is_not_known_to_be_off() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert rig.master.known_unpowered
        rig.inject("drive.can0/1.tpdo_stop=1s")
        senseless = struct.pack("<Hih", 0x0025, 0, 0)  # no row of the table
        rig.master.frame_received(0x181, senseless, rig.clock.now_ns())
        assert not rig.master.known_unpowered

    on_a_rig(test)
