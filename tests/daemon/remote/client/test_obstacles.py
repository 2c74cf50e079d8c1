"""Moving obstacles on their way from a client to the robot."""

from pathlib import Path

import msgspec.msgpack

from daemon.host.clock import run_in_real_time
from daemon.messages import MovingObstacle, Obstacles
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from tests.daemon.remote.rig import FakeRobot, raw, serving, setpoint, until

BALL = MovingObstacle(centre_mm=[1.0, 2.0, 3.0], radius_mm=4.0, velocity_mm_s=[5.0, 6.0, 7.0])


def test_what_a_client_streams_comes_with_its_user_and_needs_no_lease(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            client.send_obstacles([BALL], valid_for_s=0.5, age_s=0.1)
            await until(lambda: robot.seen)
            expected = Obstacles(sequence=1, balls=[BALL], valid_for_s=0.5, age_s=0.1)
            assert robot.seen == [("local", expected)]
            client.send_obstacles([])
            await until(lambda: len(robot.seen) == 2)
            assert robot.seen[1] == ("local", Obstacles(sequence=2, balls=[]))

    run_in_real_time(test())


def test_what_cannot_be_read_is_told_in_words_and_set_points_go_their_own_way(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            raw(LocalAddress.in_folder(tmp_path)) as client,
        ):
            key = client.keys.obstacles("local")
            client.session.put(key, b"\xc1")
            await until(lambda: robot.seen)
            assert robot.seen == [("local", robot.seen[0][1])]
            assert "this is no application/msgpack" in str(robot.seen[0][1])
            nan = {"type": "obstacles/1", "sequence": 1, "balls": [{"radius_mm": float("nan")}]}
            client.session.put(key, msgspec.msgpack.encode(nan))
            await until(lambda: len(robot.seen) == 2)
            assert "is not a finite number" in str(robot.seen[1][1])
            client.stream("local", setpoint(1))
            await until(lambda: robot.setpoints)
            assert len(robot.seen) == 2

    run_in_real_time(test())


def test_a_handler_that_breaks_does_not_end_the_stream(tmp_path: Path) -> None:
    class Breaking(FakeRobot):
        def obstacles(self, user: str, obstacles: Obstacles | str) -> None:
            super().obstacles(user, obstacles)
            raise RuntimeError("broken")

    async def test() -> None:
        import asyncio

        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        async with (
            serving(tmp_path, Breaking()) as (_, robot),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            for number in (1, 2):
                client.send_obstacles([BALL])
                await until(lambda number=number: len(robot.seen) == number)  # type: ignore[misc]

    run_in_real_time(test())
