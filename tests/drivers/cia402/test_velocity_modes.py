"""Drives that are told velocities (CSV, PV): every limit is kept, and without a word they stop.

What went over the bus and where shafts really are is the witness; it knows the robot file alone.
"""

import asyncio
from itertools import pairwise
from struct import unpack

import numpy as np
import pytest

from config.emulation.lab import EmulatedDrives
from drivers.axis_scale import axis_scale, count_limits
from drivers.canopen.codec import cob_ids
from drivers.cia402.power_state import PowerGoal, PowerState
from safety.gate import Gate, Measured
from safety.risk_source import NoModel
from tests.drivers.cia402.rig import BUS, Rig, axes, on_a_rig

VELOCITY_MODES = pytest.mark.parametrize("mode", ["csv", "pv"])
STEP_S = 0.025
TIMEOUT_S = 0.2
LONG = EmulatedDrives(sync_lost_after_periods=1000.0)
"""So that it is the missing set-points that stop them, and not the missing SYNC."""
EVENT_TIMER = (0x1400, 5)


def real_positions(rig: Rig) -> list[float]:
    """Of the shafts."""
    rig.bus.advance(rig.clock.now_ns())
    return [drive.axes[0].position_counts for drive in rig.drives]


def gate_of(rig: Rig) -> Gate:
    made = [axis_scale(axis).counts_per_unit for axis in rig.axes]
    limits = [count_limits(axis) for axis in rig.axes]
    return Gate(limits, made, [None] * len(made), NoModel(), 1.0, 1.0)


async def led(rig: Rig, gate: Gate, targets: list[float], duration_s: float) -> None:
    """Towards `targets`, in counts, step after step, as the gate lets it."""
    for _ in range(round(duration_s / STEP_S)):
        measured = Measured(rig.positions(), [None] * len(targets))
        decision = gate.decide(targets, measured, rig.clock.now_ns(), round(STEP_S * 1e9))
        assert decision.step is not None, decision.refused
        rig.master.write(decision.step)
        await asyncio.sleep(STEP_S)


@VELOCITY_MODES
def test_the_drive_is_told_after_which_silence_it_has_to_stop(mode: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        for node in rig.master.nodes.values():
            assert int.from_bytes(await node.sdo.read(*EVENT_TIMER), "little") == 200
        assert await rig.master.check_settings(1.0) == []
        rig.inject("drive.can0/2.setting=0x1400,5,0")
        (differs,) = await rig.master.check_settings(1.0)
        assert differs == "can0/2 0x1400:05 (time-out of the set-points) reads 0, not 200"

    on_a_rig(test, robot_axes=axes(2, mode=mode))


def test_a_drive_that_is_told_positions_waits_for_none() -> None:
    async def test(rig: Rig) -> None:
        await rig.operational()
        data = await rig.master.nodes[1].sdo.read(*EVENT_TIMER)
        assert int.from_bytes(data, "little") == 0

    on_a_rig(test)


@VELOCITY_MODES
@pytest.mark.parametrize("all_is_silent", [True, False])
def test_a_stopped_stream_of_velocities_stops_the_axis_and_holds_it(
    mode: str, all_is_silent: bool
) -> None:
    """all_is_silent: SYNC and heartbeat as well, as where the host has died."""

    async def test(rig: Rig) -> None:
        await rig.enabled()
        await led(rig, gate_of(rig), [60_000.0, 60_000.0], 1.5)
        before = real_positions(rig)
        if all_is_silent:
            rig.timer.stop()
        else:
            rig.master.targets._frames_of = lambda step: []  # type: ignore[method-assign]
        await asyncio.sleep(0.1)
        moved = [now - then for now, then in zip(real_positions(rig), before, strict=True)]
        assert min(moved) > 1000, "it goes on until the time is over"
        await asyncio.sleep(0.5)
        rested = real_positions(rig)
        moved = [now - then for now, then in zip(rested, before, strict=True)]
        most = 20_000 * (TIMEOUT_S + 0.02) + 20_000**2 / (2 * 200_000)
        assert max(moved) < most
        await asyncio.sleep(1.0)
        assert real_positions(rig) == rested
        assert all(drive.axes[0].shaft.energised for drive in rig.drives), "it is held"

    bus = BUS.model_copy(update={"master_heartbeat_timeout_s": 5.0})
    on_a_rig(test, robot_axes=axes(2, mode=mode), options=LONG, bus=bus)


@VELOCITY_MODES
def test_the_master_hears_why_an_axis_stopped_and_moves_none_without_it(mode: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        await led(rig, gate_of(rig), [60_000.0, 60_000.0], 1.0)
        outputs = rig.master.targets._frames_of
        rig.master.targets._frames_of = lambda step: outputs(step)[:1]  # type: ignore[method-assign]
        await asyncio.sleep(0.6)
        first, second = rig.master.channels
        assert second.state is PowerState.QUICK_STOP_ACTIVE
        assert "0x8250" in rig.detail_of("drive_emergency")
        stopped = real_positions(rig)
        await asyncio.sleep(0.5)
        assert real_positions(rig) == pytest.approx(stopped, abs=20)
        assert first.following
        rig.master.targets._frames_of = outputs  # type: ignore[method-assign]
        rig.master.set_goal(PowerGoal.OFF)
        await rig.until(lambda: rig.master.known_unpowered)
        await rig.enabled()
        await led(rig, gate_of(rig), [0.0, 0.0], 0.5)
        assert max(real_positions(rig)) < min(stopped)

    on_a_rig(test, robot_axes=axes(2, mode=mode))


@VELOCITY_MODES
def test_while_it_is_off_or_in_fault_nothing_is_missed(mode: str) -> None:
    async def test(rig: Rig) -> None:
        await rig.enabled()
        rig.inject("drive.can0/2.emergency=0x4310")
        await asyncio.sleep(1.0)
        rig.master.set_goal(PowerGoal.OFF)
        await asyncio.sleep(1.0)
        told = [one.detail for one in rig.told if one.name == "drive_emergency" and one.present]
        assert told
        assert not any("0x8250" in detail for detail in told)

    on_a_rig(test, robot_axes=axes(2, mode=mode))


@VELOCITY_MODES
@pytest.mark.parametrize("cut_after_s", [1.9, 4.05, 4.6, 7.7, 9.0])
def test_wherever_the_stream_is_cut_the_axes_keep_every_limit(
    mode: str, cut_after_s: float
) -> None:
    """Led from end to end as fast as the gate lets it, towards places that are out of reach."""
    random = np.random.default_rng(round(100 * cut_after_s))
    real: list[list[float]] = []

    async def test(rig: Rig) -> None:
        await rig.enabled()
        gate, left_s, targets = gate_of(rig), cut_after_s, [1e6, 1e6]
        looking = asyncio.create_task(look(rig))
        rig.frames.clear()
        while left_s > 0.0:
            once_s = min(left_s, float(random.uniform(1.0, 6.0)))
            await led(rig, gate, targets, once_s)
            targets = random.choice([-1e6, 1e6], 2).tolist()
            left_s -= once_s
        sent = velocities(rig)
        rig.timer.stop()
        await asyncio.sleep(2.0)
        looking.cancel()
        for places in real:
            assert all(-1.0 <= place <= 100_001.0 for place in places)
        for of_axis in sent:
            assert max(map(abs, of_axis)) <= 20_000
            changes = [abs(after - before) for before, after in pairwise(of_axis)]
            assert max(changes) <= 2_000 + 1
            assert max(map(abs, of_axis)) > 15_000, "it was led fast"

    async def look(rig: Rig) -> None:
        while True:
            real.append(real_positions(rig))
            await asyncio.sleep(0.002)

    on_a_rig(test, robot_axes=axes(2, mode=mode), options=LONG)


def velocities(rig: Rig) -> list[list[int]]:
    """Of both axes, as they counted: the last that each had when a SYNC came."""
    told: list[list[int]] = [[], []]
    newest: dict[int, int] = {}
    for can_id, data in rig.frames:
        if can_id == cob_ids.SYNC and len(newest) == 2:
            told[0].append(newest[1])
            told[1].append(newest[2])
        elif can_id in (0x201, 0x202):
            newest[can_id - 0x200] = unpack("<Hi", data)[1]
    return told


@pytest.mark.parametrize("mode", ["csp", "csv", "pv"])
def test_drives_whose_host_has_died_stop_and_hold_in_every_mode(mode: str) -> None:
    """With torque, or, where the missing SYNC was a fault, with their brakes."""

    async def test(rig: Rig) -> None:
        await rig.enabled()
        await led(rig, gate_of(rig), [60_000.0, 60_000.0], 1.5)
        before = real_positions(rig)
        rig.timer.stop()
        await asyncio.sleep(0.6)
        rested = real_positions(rig)
        way = max(now - then for now, then in zip(rested, before, strict=True))
        assert 0 < way < 20_000 * (TIMEOUT_S + 0.02) + 20_000**2 / (2 * 200_000)
        await asyncio.sleep(2.0)
        assert real_positions(rig) == rested
        for drive in rig.drives:
            axis = drive.axes[0]
            assert axis.shaft.energised or not axis.power.brake_open

    on_a_rig(test, robot_axes=axes(2, mode=mode))
