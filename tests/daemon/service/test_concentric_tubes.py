"""The tubes as they are shipped, with the whole daemon: their day, and what goes wrong in it.

The same with separate processes is in tests/hil/test_concentric_tubes.py.
"""

import asyncio
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from config.robot import Robot
from daemon.control.controller import Observation, Proposal
from daemon.messages import (
    Acquire,
    Arm,
    Body,
    Clear,
    Disarm,
    Event,
    Hold,
    Home,
    Inject,
    Resume,
    Start,
    Stop,
)
from daemon.service.telemetry.emulated_body import told_body
from drivers.cia402.power_state import PowerState
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import Rig, on_a_rig

S = OperatingState
TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
CIRCLE = {
    "kind": "circle",
    "center_mm": [45.0, 0.0, 180.0],
    "radius_mm": 12.0,
    "cycle_s": 6.0,
}
BROYDEN = {"kind": "broyden", "settle_s": 0.3}


def truth(rig: Rig) -> Body | None:
    """As the lab's own port tells it."""
    body = rig.lab.body.record.state
    return told_body(
        {
            "t_ns": 0,
            "centreline_mm": body.centreline_mm.tolist(),
            "body_radius_mm": body.radius_mm,
            "stability": body.stability,
            "snaps": body.snaps,
        }
    )


def of_that_name(rig: Rig, name: str) -> list[Event]:
    return [one for one in rig.told if isinstance(one, Event) and one.name == name]


async def going_round(rig: Rig, **circle: float) -> None:
    await rig.running(CIRCLE | circle, BROYDEN)
    loop = rig.service.loop
    await rig.until(lambda: loop.aim is not None and loop.aim.cycle >= 0, 60.0)
    await asyncio.sleep(3.0)
    assert rig.in_state(S.RUNNING), rig.causes


async def stands(rig: Rig) -> None:
    """No tube goes on, and none unwinds."""
    await asyncio.sleep(0.5)
    before = rig.shafts()
    await asyncio.sleep(2.0)
    assert rig.shafts() == pytest.approx(before, abs=2.0)


def changed(**homing: Any) -> Callable[[Robot], Robot]:
    """With encoders that lose their zeros."""

    def change(robot: Robot) -> Robot:
        axes = [
            axis.model_copy(
                update={
                    "homing": axis.homing.model_copy(
                        update={"referenced": "home_at_start", **homing}
                    )
                }
            )
            for axis in robot.axes
        ]
        return robot.model_copy(update={"axes": axes})

    return change


IN_ORDER = [["carriage_pair"], ["carriage_inner"], ["rotation_1", "rotation_2", "rotation_3"]]


def homed_in_order(rig: Rig) -> list[list[str]]:
    """Who looked for its zero together: the next ones begin when all of these have found it."""
    groups: list[list[str]] = [[]]
    looking: set[str] = set()
    for event in rig.told:
        if not isinstance(event, Event) or event.kind != "homing":
            continue
        if event.name == "homing":
            looking.add(event.subject)
            groups[-1].append(event.subject)
        else:
            looking.remove(event.subject)
        if not looking:
            groups.append([])
    return [group for group in groups if group]


def test_an_axis_that_finds_no_zero_ends_the_homing_of_the_tubes_and_is_named() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        await rig.do(Inject, fault="drive.can0/5.blocked=100s")
        refusal = await rig.refused(Home)
        assert refusal.name == "not_homed"
        assert "carriage_inner" in refusal.text
        assert homed_in_order(rig) == IN_ORDER[:2], "nobody turns before the carriages are home"
        await asyncio.sleep(1.0)
        left = {reason.subject for reason in rig.service.supervisor.reasons if not reason.over}
        assert "carriage_pair" not in left, "it knows where it is"
        assert {"carriage_inner", "rotation_1", "rotation_2", "rotation_3"} <= left
        assert (await rig.refused(Arm)).reasons

    on_a_rig(scene, path=TUBES, change=changed(), begins_in=S.STANDBY)


def test_a_day_from_homing_to_stop() -> None:
    async def scene(rig: Rig) -> None:
        assert rig.causes == {"not_referenced"}
        await rig.do(Acquire)
        await rig.do(Home)
        assert homed_in_order(rig) == IN_ORDER
        # Each axis knows where it really is; the carriages went out to their switches for it.
        positions = [channel.position_counts for channel in rig.service.loop.channels]
        assert positions == pytest.approx(rig.shafts(), abs=3.0)
        actual = [axis.actual for axis in rig.status.axes]
        assert actual == pytest.approx([0.0, 0.0, 0.0, 10.4, 24.84], abs=0.05)
        await rig.until_state(S.READY)
        await going_round(rig)
        round_ns = rig.service.clock.now_ns()
        await rig.do(Hold)
        await stands(rig)
        assert rig.power == {PowerState.OPERATION_ENABLED}
        await rig.do(Resume)
        await rig.until_state(S.ARMED, within_s=60.0)
        errors = [tip.error_mm for tip in rig.tips if tip.cycle == 0 and tip.error_mm is not None]
        assert float(np.mean(errors)) < 1.5
        await rig.do(Start)
        await asyncio.sleep(2.0)
        await rig.do(Stop)
        await rig.until(lambda: not any(state.energised for state in rig.power))
        await stands(rig)
        assert not of_that_name(rig, "gate_refused")
        limited = [e for e in of_that_name(rig, "drive_limit") if e.t_ns > round_ns]
        assert not limited, "but for what homing has left outside its travel"

    on_a_rig(scene, path=TUBES, change=changed(), begins_in=S.STANDBY)


@pytest.mark.parametrize(
    ("fault", "name", "subject"),
    [
        ("drive.can0/2.dead=3s", "node_lost", "can0/2"),
        ("drive.can0/5.blocked=6s", "drive_following_error", "carriage_inner"),
        pytest.param(
            *("drive.can0/1.blocked=6s", "drive_following_error", "rotation_1"),
            marks=pytest.mark.long,
        ),
        pytest.param("drive.can0/3.sync_loss=2s", "node_lost", "can0/3", marks=pytest.mark.long),
    ],
)
def test_a_tube_that_does_not_follow_is_named_all_stand_and_it_goes_on_after_clear(
    fault: str, name: str, subject: str
) -> None:
    async def scene(rig: Rig) -> None:
        await going_round(rig)
        await rig.do(Inject, fault=fault)
        await rig.until_state(S.FAULT, within_s=8.0)
        assert any(subject in told.subject for told in rig.events("cause", name))
        assert rig.service.supervisor.reasons[0].cause.value in {name, "drive_fault", "node_lost"}
        await stands(rig)
        await asyncio.sleep(3.0)
        await rig.do(Clear)
        await rig.until_state(S.READY, within_s=15.0)
        await rig.do(Arm)
        await rig.do(Start)
        began = len(rig.tips)
        await rig.until_state(S.ARMED, within_s=120.0)
        last = [tip.error_mm for tip in rig.tips[began:] if tip.cycle == 0 and tip.error_mm]
        assert float(np.mean(last)) < 1.5, "it goes round as before"

    on_a_rig(scene, path=TUBES)


def drawn_in(robot: Robot) -> Robot:
    """A robot whose inner tube may be drawn in so far that the tubes snap, and that nobody guards:
    its reference tells nothing of where it is led."""
    inner = robot.axes[4].model_copy(update={"travel_mm": (-53.0, 23.5)})
    supervision = robot.supervision.model_copy(update={"tracking_error_mm": 1000.0})
    unguarded: dict[str, Any] = {"axes": [*robot.axes[:4], inner], "supervision": supervision}
    if "coupled_limits" in type(robot).model_fields:
        unguarded["coupled_limits"] = ()
    return robot.model_copy(update=unguarded)


def test_tubes_that_snap_are_named_by_emulation_and_by_the_tracker_and_held() -> None:
    goal = np.array([0.0, 0.0, 3.6, 0.0, -51.5])

    async def scene(rig: Rig) -> None:
        rig.service.body.emulated = lambda: truth(rig)
        await going_round(rig, cycle_s=10.0, cycles=2)  # time enough to come where they snap
        controller = rig.service.loop.controller
        assert controller is not None
        propose = controller.propose

        def towards_the_snap(observation: Observation) -> Proposal:
            drawn_in = bool(abs(observation.u[4] - goal[4]) < 0.5)
            way = 0.2 * (goal - observation.targets)
            way[2] *= drawn_in  # the inner tube is turned when it is drawn in
            return Proposal(np.clip(way, -0.02, 0.02) * np.array([1, 1, 1, 5, 5]))

        controller.propose = towards_the_snap  # type: ignore[method-assign]
        await rig.until(lambda: rig.lab.body.record.state.snaps > 0, 120.0)
        await asyncio.sleep(0.2)
        snapped = of_that_name(rig, "snapped")[0]
        assert "snapped to another shape, for the 1. time" in snapped.text
        await rig.until_state(S.HOLD, within_s=1.0)
        (told,) = rig.events("cause", "tip_jumped")
        assert 5.0 < float(told.detail.split()[0]) < 20.0
        at_s = (told.t_ns - snapped.t_ns) * 1e-9
        assert abs(at_s) < 0.3
        await stands(rig)
        assert rig.power == {PowerState.OPERATION_ENABLED}, "held, not let go"
        bodies = [one for one in rig.told if isinstance(one, Body) and one.snaps is not None]
        assert bodies[-1].snaps == 1
        assert min(one.stability for one in bodies if one.stability is not None) < 0.8
        # Recovery without a restart: what led there is over, and motion goes on.
        controller.propose = propose  # type: ignore[method-assign]
        await rig.do(Resume)
        await asyncio.sleep(1.0)
        assert not rig.in_state(S.FAULT)
        await rig.do(Disarm)
        await rig.until_state(S.READY)
        await rig.do(Arm)

    on_a_rig(scene, path=TUBES, change=drawn_in)


def test_without_a_limit_for_it_nobody_looks_whether_the_tip_jumps() -> None:
    def change(robot: Robot) -> Robot:
        supervision = robot.supervision.model_copy(update={"tip_jump_mm": None})
        return robot.model_copy(update={"supervision": supervision})

    async def scene(rig: Rig) -> None:
        await rig.armed()
        assert not rig.service.loop.reasons.jumps(100.0)

    on_a_rig(scene, path=TUBES, change=change)


@pytest.mark.parametrize("mode", ["csv", "pv"])
def test_tubes_that_are_told_velocities_go_round_and_stand_when_they_are_told_none(
    mode: str,
) -> None:
    def change(robot: Robot) -> Robot:
        axes = [
            axis.model_copy(update={"drive": axis.drive.model_copy(update={"mode": mode})})
            for axis in robot.axes
        ]
        return robot.model_copy(update={"axes": axes})

    async def scene(rig: Rig) -> None:
        await going_round(rig)
        errors = [tip.error_mm for tip in rig.tips if tip.cycle == 0 and tip.error_mm is not None]
        assert float(np.mean(errors)) < 2.0
        for bus in rig.service.hardware.buses:  # nothing is said to the drives any more
            bus.targets._frames_of = lambda step: []  # type: ignore[method-assign]
        await asyncio.sleep(1.0)
        await stands(rig)
        assert not rig.in_state(S.RUNNING)
        assert {"drive_emergency"} <= {
            event.name for event in rig.told if isinstance(event, Event) and event.kind == "cause"
        }

    on_a_rig(scene, path=TUBES, change=change)
