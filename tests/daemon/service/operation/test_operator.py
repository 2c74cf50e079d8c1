"""What a client may ask, when, and what then happens: the daemon and its lab in virtual time."""

import asyncio
import re
from typing import Any

import pytest
from msgspec.structs import replace

from daemon.messages import (
    Acquire,
    Arm,
    Clear,
    Disarm,
    Hold,
    Inject,
    Load,
    Release,
    Resume,
    Setpoint,
    Start,
    Stop,
    Teleoperate,
)
from daemon.service.motion_loader import MotionLoader
from drivers.cia402.power_state import PowerState
from safety.states import OperatingState
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, USER, Rig, on_a_rig

S = OperatingState


def test_nothing_but_acquire_and_stop_is_done_without_the_lease() -> None:
    async def scene(rig: Rig) -> None:
        for kind in (Arm, Disarm, Start, Hold, Resume, Clear, Release):
            refusal = await rig.refused(kind)
            assert refusal.name == "no_lease"
        assert rig.in_state(S.READY)
        assert (await rig.ask(Stop())).state == S.READY.value

    on_a_rig(scene)


def test_the_lease_is_exclusive_and_a_foreign_token_commands_nothing() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        other = await rig.operator.handle("other", Acquire())
        assert getattr(other, "name", "") == "lease_taken"
        stolen = await rig.operator.handle("other", Arm(token=rig.token))
        assert getattr(stolen, "name", "") == "no_lease"

    on_a_rig(scene)


def test_who_asks_again_and_again_for_a_lease_that_is_taken_is_told_of_once() -> None:
    async def scene(rig: Rig) -> None:
        async def waits(tries: int) -> int:
            for _ in range(tries):
                await rig.operator.handle("other", Acquire())
            return [told.subject for told in rig.events("command", "acquire")].count("other")

        await rig.do(Acquire)
        assert await waits(20) == 1
        await rig.do(Acquire)
        assert await waits(20) == 1, "a renewal changes nothing"
        await rig.do(Release)
        await rig.do(Acquire)
        assert await waits(20) == 2, "somebody has it anew"

    on_a_rig(scene)


def test_arming_energises_all_drives_where_they_stand() -> None:
    async def scene(rig: Rig) -> None:
        before = rig.shafts()
        await rig.armed()
        assert rig.power == {PowerState.OPERATION_ENABLED}
        await asyncio.sleep(1.0)
        assert max(abs(b - a) for a, b in zip(before, rig.shafts(), strict=True)) < 30  # counts
        answer = await rig.do(Disarm)
        assert answer.confirmed
        assert rig.power == {PowerState.SWITCH_ON_DISABLED}

    on_a_rig(scene)


def slowly_recording(rig: Rig) -> asyncio.Event:
    """From now on a recording begins only when the event is set."""
    begin, may_begin = rig.recording.begin, asyncio.Event()

    async def begin_late() -> None:
        await may_begin.wait()
        await begin()

    rig.recording.begin = begin_late  # type: ignore[method-assign]
    return may_begin


def test_a_stop_that_comes_while_arming_is_prepared_keeps_the_drives_off() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        may_begin = slowly_recording(rig)
        arming = asyncio.create_task(rig.refused(Arm))
        await asyncio.sleep(0.5)
        await rig.do(Stop)
        may_begin.set()
        assert (await arming).name == "stopped"
        await asyncio.sleep(0.5)
        assert rig.power == {PowerState.SWITCH_ON_DISABLED}
        assert rig.in_state(S.READY)

    on_a_rig(scene)


def test_what_is_lost_while_arming_is_prepared_keeps_the_drives_off() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        may_begin = slowly_recording(rig)
        arming = asyncio.create_task(rig.refused(Arm))
        await asyncio.sleep(0.1)
        await rig.do(Release)
        may_begin.set()
        assert (await arming).name == "no_lease"
        assert rig.power == {PowerState.SWITCH_ON_DISABLED}

        await rig.do(Acquire)
        may_begin.clear()
        arming = asyncio.create_task(rig.refused(Arm))
        await rig.do(Inject, fault="drive.can0/2.dead=20s")
        await rig.until(lambda: "node_not_ready" in rig.causes)
        may_begin.set()
        assert (await arming).name == "not_ready"

    on_a_rig(scene)


def test_only_one_arm_is_under_way_at_a_time() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        may_begin = slowly_recording(rig)
        first = asyncio.create_task(rig.do(Arm))
        await asyncio.sleep(0.1)
        assert (await rig.refused(Arm)).name == "wrong_state"
        may_begin.set()
        assert (await first).state == S.ARMED.value

    on_a_rig(scene)


def test_arm_answers_with_everything_that_stands_in_the_way() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        for fault in ("drive.can0/2.dead=20s", "drive.can0/5.dead=20s", "tracker.hang_up=20s"):
            await rig.do(Inject, fault=fault)
        await rig.until(lambda: {"node_not_ready", "tracker_not_ready"} <= rig.causes)
        refusal = await rig.refused(Arm)
        assert refusal.name == "not_ready"
        subjects = " ".join(reason.subject for reason in refusal.reasons)
        assert "can0/2" in subjects
        assert "can0/5" in subjects
        assert any(reason.name == "tracker_not_ready" for reason in refusal.reasons)
        assert all(reason.remedy for reason in refusal.reasons)
        assert rig.power <= {PowerState.SWITCH_ON_DISABLED, PowerState.UNKNOWN}

    on_a_rig(scene)


def test_a_trajectory_is_followed_to_its_end_and_the_robot_stays_armed() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE | {"cycle_s": 10.0})
        await rig.until_state(S.ARMED, within_s=60.0)
        errors = [tip.error_mm for tip in rig.tips if tip.cycle >= 0 and tip.error_mm is not None]
        assert len(errors) > 350
        assert sum(errors) / len(errors) < 1.5
        assert rig.recording.table.rows()[0].samples > 350

    on_a_rig(scene)


def test_what_was_asked_for_under_a_lease_that_has_ended_is_not_loaded(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        rig.renewing, read = False, asyncio.Event()
        to_follow = MotionLoader.to_follow

        async def read_slowly(loader: MotionLoader, command: Load) -> Any:
            await read.wait()
            return await to_follow(loader, command)

        monkeypatch.setattr(MotionLoader, "to_follow", read_slowly)
        loading = asyncio.create_task(rig.refused(Load, trajectory=SMALL_CIRCLE, controller=MODEL))
        await rig.until(lambda: rig.status.lease.holder is None)
        rig.token = ""
        await rig.do(Acquire)
        read.set()
        assert (await loading).name == "no_lease"
        verbs = {verb.name: verb for verb in rig.status.verbs}
        assert not verbs["start"].possible
        await rig.do(Arm)
        assert (await rig.refused(Start)).name == "nothing_loaded"

    on_a_rig(scene)


def test_nothing_overtakes_a_load_neither_another_one_nor_a_start() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
        long, short = SMALL_CIRCLE | {"cycle_s": 60.0}, SMALL_CIRCLE | {"cycle_s": 30.0}
        loading = asyncio.create_task(rig.do(Load, trajectory=long, controller=MODEL))
        await asyncio.sleep(0.0)
        assert not loading.done(), "it is being looked through, a piece at a time"
        refused = await rig.refused(Load, trajectory=short, controller=MODEL)
        assert (refused.name, refused.text) == (
            "busy",
            "something is being loaded: wait for its answer",
        )
        assert (await rig.refused(Start)).name == "busy"
        assert (await loading).text == "circle, 60 s"
        await rig.do(Start)
        assert rig.status.reference is not None
        assert rig.status.reference.duration_s == 60.0

    on_a_rig(scene)


def test_what_cannot_be_reached_is_refused_with_place_and_amount() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        refusal = await rig.refused(Load, trajectory=SMALL_CIRCLE | {"radius_mm": 95.0})
        assert refusal.name == "unreachable"
        assert "workspace" in refusal.text
        wrong = await rig.refused(Load, trajectory=SMALL_CIRCLE | {"radus_mm": 5.0})
        assert wrong.name == "bad_trajectory"
        assert "radius_mm" in wrong.text
        assert (await rig.refused(Start)).name == "nothing_loaded"

    on_a_rig(scene)


def test_a_path_that_the_axes_are_too_slow_for_is_refused_with_what_would_do() -> None:
    async def scene(rig: Rig) -> None:
        await rig.do(Acquire)
        hasty = SMALL_CIRCLE | {"radius_mm": 40.0, "cycle_s": 2.0, "cycles": 3}
        controller = MODEL | {"max_tip_speed_mm_s": 200.0}
        refusal = await rig.refused(Load, trajectory=hasty, controller=controller)
        assert refusal.name == "axis_too_slow"
        found = re.search(r"let a cycle take ([\d.]+) s instead of 2$", refusal.text)
        assert found is not None
        slower = hasty | {"cycle_s": float(found[1])}
        await rig.do(Load, trajectory=slower, controller=controller)

    on_a_rig(scene)


def test_hold_stands_still_and_resume_goes_on_where_it_was() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await asyncio.sleep(6.0)
        await rig.do(Hold)
        assert rig.in_state(S.HOLD)
        await asyncio.sleep(0.5)
        held, elapsed_s = rig.shafts(), rig.service.following.elapsed_s
        await asyncio.sleep(2.0)
        assert max(abs(b - a) for a, b in zip(held, rig.shafts(), strict=True)) < 30
        await rig.do(Resume)
        assert rig.in_state(S.RUNNING)
        assert rig.service.following.elapsed_s == elapsed_s
        await asyncio.sleep(5.0)  # back to where it was held, and up to speed
        assert rig.service.following.elapsed_s > elapsed_s

    on_a_rig(scene)


def test_stop_is_answered_when_the_drives_have_said_that_they_stopped() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await asyncio.sleep(3.0)
        answer = await rig.do(Stop)
        assert answer.confirmed
        assert rig.power == {PowerState.SWITCH_ON_DISABLED}
        assert rig.in_state(S.READY, S.STANDBY)

    on_a_rig(scene)


def test_stop_says_so_when_a_drive_does_not_confirm() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running()
        await rig.do(Inject, fault="drive.can0/3.dead=20s")
        answer = await rig.do(Stop)
        assert not answer.confirmed
        assert "NOT confirmed" in answer.text

    on_a_rig(scene)


def test_a_stop_of_drives_that_have_stopped_by_themselves_sends_nothing_and_says_that() -> None:
    """After a stall of the machine they have missed their master and are being set up anew: what
    they are sent means nothing to them, and that they are off is not known until they are heard."""

    async def scene(rig: Rig) -> None:
        await rig.running()
        for node in range(1, 7):
            await rig.do(Inject, fault=f"drive.can0/{node}.dead=4s")
        await rig.until_state(S.FAULT)
        await asyncio.sleep(2.0)
        assert rig.service.supervisor.power.at_rest
        sent_before = [channel.target_counts for channel in rig.service.loop.channels]
        answer = await rig.do(Stop)
        assert not answer.confirmed
        assert answer.state == S.FAULT.value
        assert sent_before == [None] * 6
        assert [channel.target_counts for channel in rig.service.loop.channels] == [None] * 6
        await asyncio.sleep(3.0)
        assert (await rig.do(Stop)).confirmed

    on_a_rig(scene)


def test_the_lease_cannot_be_given_back_while_energised() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        assert (await rig.refused(Release)).name == "wrong_state"
        await rig.do(Disarm)
        await rig.do(Release)

    on_a_rig(scene)


def test_teleoperation_follows_setpoints_and_holds_when_they_stop() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Teleoperate, controller=MODEL)
        assert rig.status.tip_mm is not None
        x, y, z = rig.status.tip_mm
        for sequence in range(1, 101):
            goal = [x + 5.0, y, z]
            setpoint = Setpoint(token=rig.token, sequence=sequence, position_mm=goal, valid_s=0.2)
            assert rig.operator.setpoint(USER, setpoint) is None
            await asyncio.sleep(0.05)
            assert rig.in_state(S.RUNNING) or sequence < 3
        assert rig.status.tip_mm is not None
        assert rig.status.tip_mm[0] - x > 3.5
        await rig.until_state(S.HOLD, within_s=1.0)
        assert "setpoint_late" in rig.causes

    on_a_rig(scene)


def test_who_goes_on_with_a_teleoperation_under_another_lease_counts_from_the_beginning() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Teleoperate, controller=MODEL)
        assert rig.status.tip_mm is not None
        first = Setpoint(token=rig.token, sequence=5000, position_mm=rig.status.tip_mm, valid_s=0.2)
        assert rig.operator.setpoint(USER, first) is None
        rig.renewing = False
        await rig.until(lambda: rig.status.lease.holder is None)
        rig.token = ""
        await rig.do(Acquire)
        rig.renewing = True
        assert rig.operator.setpoint(USER, replace(first, sequence=5001)) is not None
        second = replace(first, token=rig.token, sequence=1)
        assert rig.operator.setpoint(USER, second) is None
        await rig.do(Resume)
        again = rig.operator.setpoint(USER, second)
        assert again is not None and "not newer" in again.reason

    on_a_rig(scene)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"token": "wrong"}, "token"),
        ({"sequence": 0}, "not newer"),
        ({"position_mm": [0.0, 0.0]}, "three numbers"),
        ({"position_mm": [0.0, float("nan"), 190.0]}, "finite"),
        ({"position_mm": [0.0, 500.0, 190.0]}, "outside the workspace"),
        ({"valid_s": 0.0}, "valid_s"),
        ({"valid_s": 60.0}, "valid_s"),
        ({"direction": [0.0, 0.0, 1.0]}, "pointing"),
    ],
)
def test_setpoints_that_are_not_followed_are_refused_with_a_reason(
    change: dict[str, object], why: str
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        good = {"token": rig.token, "sequence": 1, "position_mm": [0.0, 0.0, 190.0], "valid_s": 0.2}
        too_early = rig.operator.setpoint(USER, Setpoint(**good))  # type: ignore[arg-type]
        assert too_early is not None
        assert "teleoperate" in too_early.reason
        await rig.do(Teleoperate, controller=MODEL)
        assert rig.operator.setpoint(USER, Setpoint(**good)) is None  # type: ignore[arg-type]
        bad = Setpoint(**(good | {"sequence": 2} | change))  # type: ignore[arg-type]
        refused = rig.operator.setpoint(USER, bad)
        assert refused is not None
        assert why in refused.reason

    on_a_rig(scene)
