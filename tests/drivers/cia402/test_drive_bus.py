"""The master brings drives up, keeps them in step, and takes them down again."""

import asyncio
import struct
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from config.emulation.lab import EmulatedDrives
from drivers.axis_scale import count_limits
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.nmt import NmtState
from drivers.cia402 import conditions, objects
from drivers.cia402.configuration import Need, node_settings
from drivers.cia402.node import NodeState
from drivers.cia402.power_state import PowerGoal, PowerState
from safety.permit import PermittedStep, permit
from sim_backends.virtual_time import VirtualTimeLoop
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


def test_a_permitted_step_is_followed_and_its_end_held() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        start = rig.positions()
        rig.master.write(rig.step(4000, 0.5))
        await asyncio.sleep(0.25)
        halfway = [p - s for p, s in zip(rig.positions(), start, strict=True)]
        assert all(1700 < way < 2000 for way in halfway)
        await asyncio.sleep(0.5)
        assert rig.positions() == [s + 4000 for s in start]

    on_a_rig(test)


def test_a_step_is_refused_while_an_axis_does_not_follow() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        assert not rig.master.takes(rig.step(100, 0.1))

    on_a_rig(test)


def test_no_axis_moves_on_when_one_has_stopped_following() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(20_000, 1.0 / 0.5))
        await asyncio.sleep(0.5)
        rig.inject("drive.can0/2.emergency=0x4310")
        await asyncio.sleep(0.2)
        stopped = rig.positions()
        await asyncio.sleep(2.0)
        assert rig.positions() == stopped
        assert stopped[0] < 15_000

    on_a_rig(test, robot_axes=axes(3))


def between_syncs(frames: list[tuple[int, bytes]]) -> list[dict[int, int]]:
    """By node, the target that counted at each SYNC: the last that went over the bus before it."""
    told: list[dict[int, int]] = []
    newest: dict[int, int] = {}
    for can_id, data in frames:
        if can_id == cob_ids.SYNC:
            told.append(dict(newest))
        elif can_id & 0x780 == 0x200:
            newest[can_id & 0x7F] = int.from_bytes(data[2:], "little", signed=True)
    return told


@pytest.mark.parametrize("mode", ["csp", "csv", "pv"])
def test_axes_that_turn_together_are_told_so_with_one_sync(mode: str) -> None:
    """Whenever within a cycle the step comes: also so late that not all of it would be in time."""

    async def test(rig: Rig) -> None:
        heard: list[tuple[int, bytes]] = []
        syncs_ns: list[int] = []

        def hear(can_id: int, data: bytes, t_ns: int) -> None:
            heard.append((can_id, data))
            if can_id == cob_ids.SYNC:
                syncs_ns.append(t_ns)

        rig.bus.attach("witness", 128).listen({}, hear)
        await rig.enabled()
        syncs_ns.clear()  # nodes that are being set up have the bus to themselves
        for after_ms in (0.05, 2.0, 7.0, 8.5, 9.0, 9.3, 9.5, 9.7, 9.9, 9.99):
            tick_ns = rig.master._next_sync_ns
            await asyncio.sleep((tick_ns - rig.clock.now_ns()) * 1e-9 + after_ms * 1e-3)
            rig.master.write(rig.step(500, 0.1))
            heard.clear()
            await asyncio.sleep(0.3)
            told = between_syncs(heard)[2:]
            assert len(told) > 20
            changed = 0
            for before, after in pairwise(told):
                ways = [after[node] - before[node] for node in sorted(after)]
                assert max(ways) - min(ways) <= 1, f"{after_ms} ms after a SYNC: {ways}"
                changed += any(ways)
            assert changed >= 5
        late_ns = [abs(b - a - 10_000_000) for a, b in pairwise(syncs_ns)]
        assert max(late_ns) < 300_000, "and the SYNC does not wait behind them"

    on_a_rig(test, robot_axes=axes(6, mode=mode))


@pytest.mark.parametrize("mode", ["csp", "csv", "pp", "pv"])
def test_every_mode_reaches_the_end_of_a_step(mode: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        start = rig.positions()
        rig.master.write(rig.step(4000, 0.5))
        await asyncio.sleep(3.0)
        error = [abs(p - s - 4000) for p, s in zip(rig.positions(), start, strict=True)]
        assert max(error) <= 2

    on_a_rig(test, robot_axes=axes(2, mode=mode))


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
        rig.master.link_lost(OSError("as if unplugged"))
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


def test_a_limit_that_comes_and_goes_with_every_step_is_told_once() -> None:
    async def scene(rig: Rig) -> None:
        await rig.enabled()
        for _ in range(8):
            rig.master.write(rig.step(-400, 0.05, past_ends=True))
            await asyncio.sleep(0.1)
            rig.master.write(rig.step(200, 0.05))
            await asyncio.sleep(0.1)
        assert limited(rig) == [True]
        await asyncio.sleep(1.0)
        assert limited(rig) == [True, False]

    def limited(rig: Rig) -> list[bool]:
        about = ("drive_limit_active", "axis_0")
        return [told.present for told in rig.told if (told.name, told.subject) == about]

    on_a_rig(scene)


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
        assert rig.master.nodes[1].emergencies == 1000
        last = 0x1000 + 998
        rig.master.frame_received(0x81, struct.pack("<HB5x", last, 1), rig.clock.now_ns())
        await asyncio.sleep(0.1)
        assert f"0x{last:04X}" in rig.detail_of("drive_emergency")

    on_a_rig(test)


def test_a_step_that_comes_too_late_is_dropped() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        late = rig.step(1000, 0.1)
        await asyncio.sleep(0.06)
        assert not rig.master.takes(late)
        await asyncio.sleep(0.2)
        assert rig.positions() == [0, 0]

    on_a_rig(test)


def test_in_a_fast_cycle_a_step_begins_where_the_one_before_has_led_the_drives() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        fast = rig.step(1000, 0.1)  # 20 counts in a cycle
        rig.master.write(fast)
        await asyncio.sleep(0.0507)
        rig.frames.clear()
        slow = permit(  # 8 counts in a cycle
            from_counts=fast.targets(rig.clock.now_ns()),
            to_counts=[target + 100 for target in fast.targets(rig.clock.now_ns())],
            measured_counts=rig.positions(),
            velocities_before=[10_000.0] * 2,
            begins_ns=rig.clock.now_ns(),
            duration_ns=25_000_000,
            limits=[replace(count_limits(axis), max_acceleration=10**6) for axis in rig.axes],
        )
        assert isinstance(slow, PermittedStep), slow
        before = rig.master.channels[0].target_counts
        rig.master.write(slow)
        await asyncio.sleep(0.02)
        told = [targets[1] for targets in between_syncs(rig.frames) if targets]
        changes = np.diff([before, *told])
        assert changes.min() >= 7
        assert changes.max() <= 20

    on_a_rig(test, bus=BUS.model_copy(update={"cycle_period_s": 0.002}))


def test_after_a_late_cycle_axes_catch_up_together_and_no_faster_than_they_may() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        start = rig.positions()
        rig.master.write(rig.step(1000, 0.1))
        await asyncio.sleep(0.03)
        before = [channel.target_counts for channel in rig.master.channels]
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.jump(0.06)  # the process stands still
        told = [before]
        for _ in range(12):
            rig.master.tick(rig.clock.now_ns())
            told.append([channel.target_counts for channel in rig.master.channels])
            loop.jump(0.01)
        changes = np.diff(np.array(told), axis=0)
        fastest = count_limits(rig.axes[0]).max_velocity * 0.01 + 1
        assert 0.9 * fastest < changes.max() <= fastest
        assert (changes[:, 0] == changes[:, 1]).all()
        assert told[-1] == [position + 1000 for position in start]

    on_a_rig(test)


def test_the_cycle_after_a_late_one_comes_sooner_and_leads_no_further_than_its_time() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.master.write(rig.step(1000, 0.1))
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        loop.jump(0.06)  # the process stands still
        told = [channel.target_counts or 0 for channel in rig.master.channels]
        fastest = count_limits(rig.axes[0]).max_velocity
        for period_s in (0.01, 0.001, 0.004, 0.0, 0.01):
            before = told
            loop.jump(period_s)
            rig.master.tick(rig.clock.now_ns())
            told = [channel.target_counts or 0 for channel in rig.master.channels]
            assert np.subtract(told, before).max() <= fastest * period_s + 1

    on_a_rig(test)


def test_where_one_axis_stops_following_the_others_brake_as_at_the_end_of_a_step() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        slower = [replace(count_limits(axis), max_acceleration=200_000) for axis in rig.axes]
        start = rig.positions()
        step = permit(
            from_counts=start,
            to_counts=[position + 1000 for position in start],
            measured_counts=start,
            velocities_before=[10_000.0] * 2,
            begins_ns=rig.clock.now_ns(),
            duration_ns=100_000_000,
            limits=[replace(one, max_lag=10**9) for one in slower],
        )
        assert isinstance(step, PermittedStep), step
        rig.master.write(step)
        await asyncio.sleep(0.05)
        stops, goes_on = rig.master.channels
        told = [goes_on.target_counts or 0]
        stops.set_goal(None, rig.clock.now_ns())
        loop = asyncio.get_running_loop()
        assert isinstance(loop, VirtualTimeLoop)
        for _ in range(6):
            loop.jump(0.01)
            rig.master.tick(rig.clock.now_ns())
            told.append(goes_on.target_counts or 0)
        assert np.diff(told).tolist() == [80, 60, 40, 20, 0, 0]

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


def test_what_the_gate_has_not_given_moves_nothing() -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        changed = rig.step(100, 0.1)
        object.__setattr__(changed, "to_counts", (9000, 9000))
        with pytest.raises(TypeError, match="only what the gate has permitted"):
            rig.master.write(changed)
        await asyncio.sleep(0.2)
        assert rig.positions() == [0, 0]

    on_a_rig(test)
