"""Streams of moving obstacles: what counts, until when, and what happens when one stops."""

import asyncio
import math
from typing import Any

import pytest

from config.loader import RobotFile
from config.robot import Robot
from daemon.messages import (
    Clear,
    Disarm,
    Event,
    MovingObstacle,
    Obstacles,
    ObstaclesTaken,
    Resume,
    Surround,
)
from daemon.service.obstacles import MOST_BALLS, MovingObstacles, horizon_s
from safety.causes import cause
from safety.risk.moving_obstacles import Swept
from safety.states import OperatingState
from tests.daemon.service.grazing import BROYDEN
from tests.daemon.service.operation.test_surrounding import FAR_BALL, file, play, source_of
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig

__all__ = ["file"]
pytestmark = pytest.mark.usefixtures("shared_grids")

S = OperatingState
MS = 1_000_000


def ball(
    x_mm: float = 60.0, velocity_mm_s: list[float] | None = None, radius_mm: float = 5.0
) -> MovingObstacle:
    return MovingObstacle(
        centre_mm=[x_mm, 0.0, 150.0], radius_mm=radius_mm, velocity_mm_s=velocity_mm_s
    )


def stream(sequence: int = 1, *balls: MovingObstacle, **other: Any) -> Obstacles:
    return Obstacles(sequence=sequence, balls=list(balls), **other)


class Heard:
    """What a risk would be told."""

    def __init__(self) -> None:
        self.swept: list[list[float]] = []
        self.until_ns: int | None = None
        self.streams = MovingObstacles(0.2, self._hear)

    def _hear(self, swept: Swept, until_ns: int | None) -> None:
        self.swept, self.until_ns = swept.capsules.tolist(), until_ns


def test_a_ball_is_led_on_until_it_is_no_longer_believed_and_the_step_is_over() -> None:
    heard = Heard()
    assert heard.streams.take("local", stream(1, ball(60.0, [-10.0, 0.0, 4.0])), 5 * MS) == ""
    assert heard.swept == [pytest.approx([60.0, 0.0, 150.0, -5.0, 0.0, 2.0, 5.0])]
    assert heard.until_ns == 305 * MS
    old = stream(2, ball(60.0, [-10.0, 0.0, 0.0]), valid_for_s=0.5, age_s=0.1)
    assert heard.streams.take("local", old, 10 * MS) == ""
    assert heard.swept == [pytest.approx([60.0, 0.0, 150.0, -7.0, 0.0, 0.0, 5.0])]
    assert heard.until_ns == 410 * MS


def test_a_stream_is_late_when_nothing_newer_has_come_and_not_before() -> None:
    heard = Heard()
    assert heard.streams.late(1 << 40) == ""
    heard.streams.take("local", stream(1, ball()), 0)
    assert heard.streams.late(300 * MS) == ""
    assert heard.streams.late(301 * MS) == "local"
    heard.streams.take("local", stream(2, ball()), 301 * MS)
    assert heard.streams.late(302 * MS) == ""
    heard.streams.take("local", stream(3), 310 * MS)
    assert (heard.swept, heard.until_ns, heard.streams.count) == ([], None, 0)
    assert heard.streams.late(1 << 40) == ""


def test_the_first_of_several_streams_that_stops_is_told_and_all_count() -> None:
    heard = Heard()
    heard.streams.take("alice", stream(1, ball(60.0), ball(70.0)), 0)
    heard.streams.take("bob", stream(1, ball(80.0), valid_for_s=0.1), 0)
    assert [row[0] for row in heard.swept] == [60.0, 70.0, 80.0]
    assert heard.streams.count == 3
    assert heard.until_ns == 100 * MS
    assert heard.streams.late(200 * MS) == "bob"
    heard.streams.forget_late(200 * MS)
    assert [row[0] for row in heard.swept] == [60.0, 70.0]
    assert heard.until_ns == 300 * MS
    heard.streams.forget_late(200 * MS)
    assert heard.streams.count == 2


@pytest.mark.parametrize(
    ("message", "told"),
    [
        (stream(3, ball()), "not newer than what came before"),
        (stream(4, *[ball()] * (MOST_BALLS + 1)), "more than 16"),
        (stream(4, ball(), valid_for_s=0.0), "valid_for_s"),
        (stream(4, ball(), valid_for_s=1.1), "valid_for_s"),
        (stream(4, ball(), valid_for_s=math.nan), "valid_for_s"),
        (stream(4, ball(), age_s=0.3), "age_s"),
        (stream(4, ball(), age_s=-0.1), "age_s"),
        (stream(4, ball(), age_s=math.nan), "age_s"),
        (stream(4, ball(math.inf)), "finite"),
        (stream(4, ball(), ball(radius_mm=-1.0)), "positive"),
        (stream(4, ball(60.0, [1.0, 2.0])), "three numbers"),
    ],
)
def test_what_cannot_count_is_dropped_and_what_was_there_goes_on(
    message: Obstacles, told: str
) -> None:
    heard = Heard()
    heard.streams.take("local", stream(3, ball(61.0)), 0)
    assert told in heard.streams.take("local", message, 50 * MS)
    assert heard.swept[0][0] == 61.0 and heard.until_ns == 300 * MS


def test_a_program_that_begins_anew_counts_from_the_beginning_once_the_old_is_over() -> None:
    heard = Heard()
    heard.streams.take("local", stream(700, ball()), 0)
    assert heard.streams.take("local", stream(1, ball()), 300 * MS) != ""
    assert heard.streams.take("local", stream(1, ball()), 301 * MS) == ""


def test_the_horizon_is_longer_than_any_axis_needs_to_stop(file: RobotFile) -> None:
    axes = file.robot.axes
    assert horizon_s(axes) >= 0.1 + max(a.max_velocity / a.max_acceleration for a in axes)


# In the daemon.


async def streaming(rig: Rig, where: Any, every_s: float = 0.05) -> None:
    number = 0
    while True:
        number += 1
        rig.operator.obstacles("local", stream(number, *where()))
        await asyncio.sleep(every_s)


async def ended(task: "asyncio.Task[None]") -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def test_a_stream_that_stops_holds_the_robot_by_name_until_it_is_back(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        stream_of = asyncio.create_task(streaming(rig, lambda: [ball(90.0)]))
        await asyncio.sleep(0.1)
        await rig.running(SMALL_CIRCLE | {"radius_mm": 5.0}, BROYDEN)
        await asyncio.sleep(2.0)
        assert rig.in_state(S.RUNNING)
        assert rig.status.risk.moving_obstacles == 1
        (capsule,) = rig.status.risk.moving_mm
        assert capsule == pytest.approx([90.0, 0.0, 150.0, 0.0, 0.0, 0.0, 5.0])
        await ended(stream_of)
        taken_s = await rig.until_state(S.HOLD, within_s=1.0)
        assert taken_s < 0.4, "0.3 s it was valid, and a cycle to see that"
        assert rig.causes == {"obstacles_late"}
        (told,) = rig.events("cause", "obstacles_late")
        assert told.text == cause("obstacles_late").text and told.detail == "local"
        u = [0.0] * 4
        now_ns = rig.service.clock.now_ns()
        reading = source_of(rig).assess(u, u, now_ns)
        assert reading is not None and reading.contact_risk == 1.0
        assert "no longer known" in reading.doubt
        await asyncio.sleep(1.0)
        assert rig.in_state(S.HOLD)
        stream_of = asyncio.create_task(streaming(rig, lambda: [ball(90.0)]))
        await asyncio.sleep(0.2)
        await rig.do(Resume)
        assert rig.in_state(S.RUNNING)
        # It ends properly: nothing is missed.
        await ended(stream_of)
        rig.operator.obstacles("local", stream(10_000))
        await asyncio.sleep(1.0)
        assert rig.in_state(S.RUNNING) and rig.status.risk.moving_obstacles == 0
        assert rig.status.risk.moving_mm == []

    rig = play(scene, file)
    assert len([told for told in rig.told if isinstance(told, ObstaclesTaken)]) > 40


def test_what_sent_it_and_is_gone_for_good_is_forgotten_with_the_drives_off(
    file: RobotFile,
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        rig.operator.obstacles("camera", stream(1, ball(90.0)))
        await asyncio.sleep(1.0)
        assert rig.causes == {"obstacles_late"}
        await rig.do(Disarm)
        assert rig.in_state(S.STANDBY)
        await rig.do(Clear)
        await rig.until_state(S.READY)
        assert rig.causes == set()

    play(scene, file)


def test_a_ball_that_comes_nearer_holds_the_robot_before_it_touches(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        place = {"x": 90.0}
        moving = asyncio.create_task(
            streaming(rig, lambda: [ball(place["x"], [-10.0, 0.0, 0.0], 8.0)])
        )
        await asyncio.sleep(0.1)
        await rig.running(SMALL_CIRCLE | {"radius_mm": 5.0}, BROYDEN)
        while rig.in_state(S.RUNNING) and place["x"] > 0.0:
            place["x"] -= 0.5
            await asyncio.sleep(0.05)
        assert rig.in_state(S.HOLD) and rig.causes == {"risk_too_high"}
        nearest = rig.lab.body.record.state.centreline_mm
        away = ((nearest - [place["x"], 0.0, 150.0]) ** 2).sum(axis=1).min() ** 0.5
        assert away - 8.0 - rig.lab.body.record.state.radius_mm > 0.0, "nothing is touched yet"
        # It goes away again, and the robot goes on.
        place["x"] = 90.0
        await asyncio.sleep(0.2)
        await rig.do(Resume)
        await asyncio.sleep(1.0)
        assert rig.in_state(S.RUNNING)
        await ended(moving)

    play(scene, file, change=unyielding)


def unyielding(robot: Robot) -> Robot:
    """Its steps are not turned aside."""
    return robot.model_copy(update={"risk": robot.risk.model_copy(update={"slide": False})})


def test_among_other_surroundings_what_moves_counts_as_before(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        touching = asyncio.create_task(streaming(rig, lambda: [ball(10.0)]))
        await asyncio.sleep(0.1)
        u, now_ns = [0.0] * 4, rig.service.clock.now_ns
        assert source_of(rig).assess(u, u, now_ns()).contact_risk > 0.9  # type: ignore[union-attr]
        await rig.do(Surround, surface={"regions": [FAR_BALL]}, add=True)
        assert source_of(rig).assess(u, u, now_ns()).contact_risk > 0.9  # type: ignore[union-attr]
        await ended(touching)
        rig.operator.obstacles("local", stream(1000))
        assert source_of(rig).assess(u, u, now_ns()).contact_risk < 0.01  # type: ignore[union-attr]

    play(scene, file)


def test_why_obstacles_are_dropped_is_told_once(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        for number in range(5):
            rig.operator.obstacles("local", stream(number, ball(math.inf)))
        rig.operator.obstacles("local", "this is no application/msgpack")

    told = [
        message
        for message in play(scene, file).told
        if isinstance(message, Event) and message.name == "obstacles_refused"
    ]
    assert [event.subject for event in told] == ["local", "local"]
    assert "finite" in told[0].text and "msgpack" in told[1].text


def test_two_programs_of_one_user_do_not_fill_the_events(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        for number in range(100):
            rig.operator.obstacles("local", stream(1000 + number))
            rig.operator.obstacles("local", stream(1000 + number, ball()))
            rig.operator.obstacles("local", stream(number, ball()))
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.5)
        rig.operator.obstacles("local", stream(2000, ball(), valid_for_s=0.9))
        rig.operator.obstacles("local", stream(1, ball()))

    told = [
        message
        for message in play(scene, file).told
        if isinstance(message, Event) and message.name == "obstacles_refused"
    ]
    assert len(told) == 2, "once, and once again after a while without"
    assert "another program" in told[0].text


def test_a_robot_without_a_model_says_that_nothing_counts_with_them() -> None:
    async def scene(rig: Rig) -> None:
        rig.operator.obstacles("local", stream(1, ball()))
        await asyncio.sleep(1.0)
        assert rig.in_state(S.READY)

    (told,) = [
        message
        for message in on_a_rig(scene).told
        if isinstance(message, Event) and message.name == "obstacles_refused"
    ]
    assert "no model" in told.text
