"""Homing: who must, in which order, what ends it, and what is then known."""

import asyncio
from collections.abc import Callable
from typing import Any

import pytest

from config.axis import Axis
from config.robot import Robot
from daemon.messages import Acquire, Arm, Clear, Disarm, Event, Hold, Home, Inject, Stop
from drivers.cia402 import objects
from safety.states import OperatingState
from tests.daemon.service.rig import Rig, on_a_rig

S = OperatingState
NAMES = ["proximal_1", "proximal_2", "proximal_3", "distal_1", "distal_2", "distal_3"]


def homed_at_start(
    order: list[list[str]] | None = None, quirks: tuple[str, ...] = (), **homing: Any
) -> Callable[[Robot], Robot]:
    """The soft arm with encoders that lose their zeros."""

    def change(robot: Robot) -> Robot:
        def changed(axis: Axis) -> Axis:
            settings = {"referenced": "home_at_start", **homing}
            return axis.model_copy(update={"homing": axis.homing.model_copy(update=settings)})

        assert robot.emulation is not None
        drives = robot.emulation.drives.model_copy(update={"quirks": quirks})
        return robot.model_copy(
            update={
                "axes": [changed(axis) for axis in robot.axes],
                "homing_order": order,
                "emulation": robot.emulation.model_copy(update={"drives": drives}),
            }
        )

    return change


def homing_events(rig: Rig) -> list[tuple[str, str]]:
    events = (message for message in rig.told if isinstance(message, Event))
    return [(event.name, event.subject) for event in events if event.kind == "homing"]


async def modes(rig: Rig) -> set[int]:
    """The mode of operation of every drive, as it shows it."""
    nodes = [node for bus in rig.service.hardware.buses for node in bus.nodes.values()]
    return {(await node.sdo.read(objects.MODE_DISPLAY))[0] for node in nodes}


def test_axes_that_lose_their_zero_are_homed_before_the_robot_arms() -> None:
    async def scene(rig: Rig) -> None:
        assert rig.causes == {"not_referenced"}
        await rig.do(Acquire)
        refusal = await rig.refused(Arm)
        assert [reason.name for reason in refusal.reasons] == ["not_referenced"] * 6
        assert {reason.subject for reason in refusal.reasons} == set(NAMES)
        assert "tentacled home" in refusal.reasons[0].remedy
        answer = await rig.do(Home)
        assert answer.text == f"homed: {', '.join(NAMES)}"
        assert homing_events(rig) == [
            (name, axis) for axis in NAMES for name in ("homing", "homed")
        ]
        assert len(rig.events("state", "homing")) == 1
        assert not any(channel.state.energised for channel in rig.service.loop.channels)
        assert await modes(rig) == {8}
        await rig.until_state(S.READY)
        await rig.do(Arm)
        await asyncio.sleep(1.0)
        assert rig.in_state(S.ARMED)

    on_a_rig(scene, change=homed_at_start(), begins_in=S.STANDBY)


def test_groups_follow_each_other_and_axes_of_a_group_go_together() -> None:
    order = [["distal_1", "distal_2", "distal_3"], ["proximal_1", "proximal_2", "proximal_3"]]

    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Home)
        told = homing_events(rig)
        assert {subject for _, subject in told[:6]} == set(order[0])
        assert [name for name, _ in told[:3]] == ["homing"] * 3
        assert [name for name, _ in told[3:6]] == ["homed"] * 3
        assert {subject for _, subject in told[6:]} == set(order[1])
        # Each axis has gone down to its switch, 2 % of its travel below zero, and calls that zero.
        for place, shaft in zip(rig.shafts(), rig.service.loop.channels, strict=True):
            assert place - shaft.position_counts == pytest.approx(-2000, abs=2)
        await rig.until_state(S.READY)

    change = homed_at_start(order, method=17, timeout_s=60.0)
    on_a_rig(scene, change=change, begins_in=S.STANDBY)


def test_only_those_that_are_named_are_homed() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Home, axes=["distal_2", "proximal_1"])
        assert [axis for _, axis in homing_events(rig)[::2]] == ["proximal_1", "distal_2"]
        assert (await rig.refused(Home, axes=["distal_9"])).name == "bad_axis"
        left = await rig.refused(Arm)
        assert {reason.subject for reason in left.reasons} == set(NAMES) - {
            "distal_2",
            "proximal_1",
        }
        await rig.do(Home)
        await rig.until_state(S.READY)

    on_a_rig(scene, change=homed_at_start(), begins_in=S.STANDBY)


async def going(rig: Rig) -> asyncio.Task[Any]:
    """A homing that has begun to move the first axis."""
    await rig.do(Acquire)
    task = asyncio.create_task(rig.ask(Home(token=rig.token)))
    before = rig.shafts()
    await rig.until(lambda: rig.shafts() != before)
    assert rig.in_state(S.HOMING)
    return task


@pytest.mark.parametrize("by", ["stop", "hold", "disarm", "lease", "fault", "power_cycle"])
def test_whatever_would_stop_the_robot_ends_homing(by: str) -> None:
    async def scene(rig: Rig) -> None:
        task = await going(rig)
        if by == "lease":
            rig.renewing = False
        elif by == "fault":
            await rig.do(Inject, fault="drive.can0/1.emergency=0x7121")
        elif by == "power_cycle":
            await rig.do(Inject, fault="drive.can0/1.power_cycle=0.5s")
        else:
            await rig.do({"stop": Stop, "hold": Hold, "disarm": Disarm}[by])
        await rig.until(lambda: not rig.in_state(S.HOMING), within_s=4.0)
        refusal = await asyncio.wait_for(task, 8.0)
        assert refusal.name == "not_homed"
        assert not any(channel.state.energised for channel in rig.service.loop.channels)
        if by == "lease":
            assert "lease_lost" in {reason.name for reason in refusal.reasons}
            rig.renewing, rig.token = True, ""
            await rig.do(Acquire)
        await asyncio.sleep(3.0)
        assert await modes(rig) == {8}
        assert "not_referenced" in rig.causes
        if rig.in_state(S.FAULT) or "drive_fault" in rig.causes:
            await rig.do(Clear)
        await rig.until(lambda: rig.causes == {"not_referenced"})
        await rig.do(Home)
        await rig.until_state(S.READY)
        await rig.do(Arm)

    change = homed_at_start(method=17, timeout_s=60.0)
    on_a_rig(scene, change=change, begins_in=S.STANDBY)


@pytest.mark.parametrize("after_s", [0.0, 0.02])
def test_a_drive_that_tells_of_an_error_before_its_fault_ends_homing_in_fault(
    after_s: float,
) -> None:
    """Which of its two messages comes first is the drive's own affair."""

    async def scene(rig: Rig) -> None:
        task = await going(rig)
        node = rig.service.hardware.buses[0].nodes[1]
        node.emergencies.received(bytes.fromhex("1023050000000000"), rig.service.clock.now_ns())
        await asyncio.sleep(after_s)
        await rig.do(Inject, fault="drive.can0/1.emergency=0x2310")
        await rig.until_state(S.FAULT, within_s=4.0)
        assert (await asyncio.wait_for(task, 8.0)).name == "not_homed"
        await rig.until(lambda: not any(one.state.energised for one in rig.service.loop.channels))
        await rig.do(Clear)
        await rig.until(lambda: rig.causes == {"not_referenced"})
        await rig.do(Home)
        await rig.until_state(S.READY)

    change = homed_at_start(method=17, timeout_s=60.0)
    on_a_rig(scene, change=change, begins_in=S.STANDBY)


def test_an_axis_that_finds_no_zero_ends_the_homing_of_all() -> None:
    order = [["proximal_1", "proximal_2"], ["proximal_3", "distal_1", "distal_2", "distal_3"]]

    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        refusal = await rig.refused(Home)
        assert refusal.name == "not_homed"
        assert "proximal_1: not within 0.3 s: in progress" in refusal.text
        assert {axis for _, axis in homing_events(rig)} == set(order[0])
        assert not any(channel.state.energised for channel in rig.service.loop.channels)
        assert await modes(rig) == {8}
        assert "not_referenced" in rig.causes

    change = homed_at_start(order, method=17, timeout_s=0.3)
    on_a_rig(scene, change=change, begins_in=S.STANDBY)


def test_a_drive_that_was_without_power_has_lost_its_zero_again() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Home)
        await rig.until_state(S.READY)
        await rig.do(Inject, fault="drive.can0/2.power_cycle=0.5s")
        await rig.until(lambda: rig.causes == {"not_referenced"})
        assert [r.subject for r in rig.service.supervisor.reasons] == ["proximal_2"]
        await rig.do(Home)
        await rig.until_state(S.READY)

    on_a_rig(scene, change=homed_at_start(), begins_in=S.STANDBY)


def test_a_drive_that_says_so_itself_is_believed() -> None:
    async def scene(rig: Rig) -> None:
        assert rig.causes == {"not_referenced"}
        await rig.do(Acquire)
        await rig.do(Home)
        await rig.until_state(S.READY)
        await rig.do(Inject, fault="drive.can0/2.dead=0.5s")
        await rig.until(lambda: "not_referenced" not in rig.causes and rig.in_state(S.STANDBY))
        await rig.until_state(S.READY)  # it was away, and says that it still knows its zero
        await rig.do(Inject, fault="drive.can0/2.power_cycle=0.5s")
        await rig.until(lambda: rig.causes == {"not_referenced"})

    change = homed_at_start(quirks=("tells_reference",), referenced_bit=15)
    on_a_rig(scene, change=change, begins_in=S.STANDBY)


def test_an_absolute_encoder_needs_no_homing_until_it_fails() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        assert (await rig.refused(Home)).name == "nothing_to_home"
        await rig.do(Inject, fault="drive.can0/1.encoder=0.3s")
        await rig.until(lambda: "not_referenced" in rig.causes)
        assert await rig.refused(Arm)

    on_a_rig(scene)


def test_homing_needs_the_lease_and_a_robot_at_rest() -> None:
    async def scene(rig: Rig) -> None:
        assert (await rig.refused(Home, axes=["distal_1"])).name == "no_lease"
        await rig.armed()
        refusal = await rig.refused(Home, axes=["distal_1"])
        assert refusal.name == "wrong_state"
        await rig.do(Disarm)
        await rig.do(Inject, fault="tracker.missing=5s")
        await rig.until(lambda: "tracker_late" in rig.causes)
        refusal = await rig.refused(Home, axes=["distal_1"])
        assert refusal.name == "not_ready"
        assert "tracker_late" in {reason.name for reason in refusal.reasons}

    on_a_rig(scene)


def test_no_axis_is_homed_faster_than_the_gate_permits() -> None:
    def change(robot: Robot) -> Robot:
        slow = homed_at_start()(robot)
        axes = [axis.model_copy(update={"homing_speed_mm_s": 1e4}) for axis in slow.axes]
        return slow.model_copy(update={"axes": axes})

    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Home)
        node = rig.service.hardware.buses[0].nodes[1]
        told = [
            int.from_bytes(await node.sdo.read(index, subindex), "little")
            for index, subindex in (
                (objects.HOMING_SPEEDS, 1),
                (objects.HOMING_SPEEDS, 2),
                (objects.HOMING_ACCELERATION, 0),
            )
        ]
        assert told == [20_000, 20_000, 200_000]  # 10 mm/s and 100 mm/s², of 2000 counts per mm

    on_a_rig(scene, change=change, begins_in=S.STANDBY)
