"""Permitted steps on the bus: followed together and in time, and left together."""

import asyncio
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from drivers.axis_scale import count_limits
from drivers.canopen.codec import cob_ids
from safety.permit import PermittedStep, permit
from sim_backends.virtual_time import VirtualTimeLoop
from tests.drivers.cia402.rig import BUS, Rig, axes, on_a_rig


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
            tick_ns = rig.master.targets.next_sync_ns
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
