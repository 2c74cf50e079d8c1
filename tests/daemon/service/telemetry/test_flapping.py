"""What comes and goes with every frame is told, and does not fill log and recording."""

import asyncio
from itertools import pairwise
from pathlib import Path

from daemon.commands.views.probe_snapshot import Json, ProbeSession
from daemon.messages import Event, Message
from daemon.robot.checked_robot import check_robot
from daemon.service.telemetry.events import EventHistory
from drivers.aurora.conditions import TOOL_DISABLED, TOOL_MISSING
from drivers.conditions import Conditions
from safety.causes import Cause
from safety.failsafe import ActiveReason
from sim_backends.virtual_time import run_in_virtual_time, virtual_clock
from tests import SOFT_ARM

FRAME_NS = 25_000_000


class Told:
    """What an `EventHistory` tells, at a time that is set."""

    def __init__(self) -> None:
        self.now = 0
        self.events: list[Event] = []
        self.history = EventHistory(self, self.hear)

    def now_ns(self) -> int:
        return self.now

    def hear(self, message: Message) -> None:
        assert isinstance(message, Event)
        self.events.append(message)

    def pass_frames(self, count: int) -> None:
        for _ in range(count):
            self.now += FRAME_NS
            self.history.reasons(())

    def of(self, name: str) -> list[Event]:
        return [event for event in self.events if event.name == name]


def test_a_sensor_that_is_missing_and_disabled_by_turns_is_told_once_a_second() -> None:
    told = Told()
    conditions = Conditions(told.history.condition)
    for frame in range(401):
        missing = frame % 2 == 0
        for condition, holds in ((TOOL_MISSING, missing), (TOOL_DISABLED, not missing)):
            if holds:
                conditions.set(condition, "tracker/tip", told.now)
            else:
                conditions.clear(condition, "tracker/tip", told.now)
        told.pass_frames(1)
    told.pass_frames(400)
    for condition, holds in ((TOOL_MISSING, True), (TOOL_DISABLED, False)):
        events = told.of(condition.name)
        assert 16 < len(events) < 30, "in ten seconds"
        assert all(one.present != other.present for one, other in pairwise(events))
        assert events[-1].present is holds, "what holds in the end is told"
        assert "changes were not told" in "".join(event.detail for event in events)


def test_what_comes_and_goes_a_few_times_is_told_each_time_and_at_once() -> None:
    told = Told()
    slack = ActiveReason(Cause.TENDON_SLACK, "tendon_1", "0.1 N", 0, latched=False)
    for _ in range(8):
        told.history.reasons((slack,))
        told.history.reasons(())
    assert [event.present for event in told.events] == [True, False] * 8
    assert {event.detail for event in told.events} == {"0.1 N"}


def test_a_cause_that_flaps_is_told_as_it_is_in_the_end() -> None:
    told = Told()
    slack = ActiveReason(Cause.TENDON_SLACK, "tendon_1", "0.1 N", 0, latched=False)
    for _ in range(100):
        told.history.reasons((slack,))
        told.history.reasons(())
    told.history.reasons((slack,))
    before = len(told.events)
    assert before == 16
    told.now += 2_000_000_000
    told.history.reasons((slack,))
    assert [event.present for event in told.events[before:]] == [True]


def test_what_flaps_while_a_robot_is_probed_is_told_once_a_second_too(tmp_path: Path) -> None:
    told: list[Json] = []

    async def scene() -> None:
        clock = virtual_clock()
        session = ProbeSession(check_robot(SOFT_ARM), tmp_path, clock, told.append, None)
        conditions = Conditions(session._changed)
        catching_up = asyncio.create_task(session._catch_up())
        for frame in range(401):
            change = conditions.clear if frame % 2 else conditions.set
            change(TOOL_MISSING, "tracker/tip", clock.now_ns())
            await asyncio.sleep(FRAME_NS * 1e-9)
        await asyncio.sleep(2.0)
        catching_up.cancel()

    run_in_virtual_time(scene())
    assert 16 < len(told) < 30, "in ten seconds"
    assert all(one["present"] != other["present"] for one, other in pairwise(told))
    assert told[-1]["present"], "what holds in the end is told"
    assert {event["name"] for event in told} == {"tool_missing"}
    assert "changes were not told" in told[-1]["detail"]
