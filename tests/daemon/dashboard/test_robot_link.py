"""Only the page in control keeps the lease alive, and only while it is heard."""

import asyncio
from pathlib import Path

import msgspec
import pytest
from msgspec.structs import replace

from daemon.dashboard.robot_link import HEARD_WITHIN_S, PageControl, RobotLink
from daemon.host.clock import run_in_real_time
from daemon.messages import Status, Surroundings
from daemon.remote.client import surroundings_watch
from daemon.remote.client.client_errors import BadAnswerError
from daemon.remote.client.surroundings_watch import SurroundingsWatch
from daemon.remote.surroundings import cut_surroundings
from tests.daemon.remote.rig import FakeRobot, publish_until, serving, tip, until


def test_a_page_that_is_not_heard_is_no_operator() -> None:
    control = PageControl()
    assert not control.alive(0.0) and not control.heard("a", 0.0)
    assert control.take("a", 0.0) == ""
    assert control.alive(HEARD_WITHIN_S) and not control.alive(HEARD_WITHIN_S + 0.01)
    assert control.heard("a", 5.0) and control.alive(5.1)


def test_another_page_s_heart_keeps_nothing_alive() -> None:
    control = PageControl()
    control.take("a", 0.0)
    assert not control.heard("b", 5.0) and not control.heard("", 5.0)
    assert not control.alive(5.0)


def test_who_takes_over_has_it_alone() -> None:
    control = PageControl()
    control.take("a", 0.0)
    assert control.take("a", 0.1) == ""
    assert control.take("b", 0.2) == "a"
    assert not control.heard("a", 0.3) and not control.give("a") and control.heard("b", 0.3)
    assert control.give("b") and not control.alive(0.3) and not control.give("")


def test_other_surroundings_are_fetched_when_the_state_tells_of_them(tmp_path: Path) -> None:
    class Surrounded(FakeRobot):
        sha256 = "a" * 64

        def status(self) -> Status:
            status = super().status()
            risk = msgspec.structs.replace(status.risk, surroundings_sha256=self.sha256)
            return msgspec.structs.replace(status, risk=risk)

    async def test() -> None:
        robot = Surrounded()
        first = cut_surroundings("a.stl", b"first", None, "a" * 64)
        async with serving(tmp_path, robot, surroundings=first) as (server, _):
            link = RobotLink("little_arm", tmp_path)
            running = asyncio.create_task(link.run())
            await until(lambda: link.surroundings[1] == b"first")
            await publish_until(server, robot.status(), lambda: link.status is not None)
            robot.sha256 = "b" * 64
            server.show(cut_surroundings("b.stl", b"second" * 20_000, None, "b" * 64))
            await publish_until(
                server, robot.status(), lambda: link.surroundings[1] == b"second" * 20_000
            )
            assert link.surroundings[0].mesh == "b.stl"
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_in_real_time(test())


def test_another_robot_s_daemon_in_the_same_folder_is_not_taken_for_this_one(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with serving(tmp_path, name="other_arm"):
            link = RobotLink("little_arm", tmp_path)
            running = asyncio.create_task(link.run())
            await until(lambda: link.status is not None or "other_arm" in link.problem)
            assert link.status is None, "it would be shown and commanded by a wrong name"
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_in_real_time(test())


def test_a_night_s_cycles_are_not_told_over_and_over(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, _):
            link = RobotLink("little_arm", tmp_path)
            running = asyncio.create_task(link.run())
            await until(lambda: link.status is not None)
            for cycle in range(40):
                server.publish(replace(tip(), state="running", cycle=cycle, error_mm=1.0))
            await until(lambda: link.cycles and link.cycles[-1].cycle == 39)
            assert [row.cycle for row in link.cycles] == list(range(28, 40))
            running.cancel()
            await asyncio.gather(running, return_exceptions=True)

    run_in_real_time(test())


def test_surroundings_that_have_not_come_are_asked_for_again_and_the_last_ones_stay(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Client:
        """Is refused the first look; others take their place while the second one goes on."""

        now, looks = "a", 0

        async def surroundings(self) -> tuple[Surroundings, bytes]:
            self.looks += 1
            if self.looks == 1:
                raise BadAnswerError("the surroundings have not come whole: ask again")
            found, pause = Surroundings(counts_sha256=self.now), 0.03 if self.looks == 2 else 0.0
            await asyncio.sleep(pause)
            return found, b""

    async def test() -> None:
        client, heard = Client(), list[str]()
        watch = SurroundingsWatch(
            client,  # type: ignore[arg-type]
            Surroundings(),
            lambda around, _: heard.append(around.counts_sha256),
        )
        for step in range(12):
            client.now = "a" if step < 6 else "b"
            told = FakeRobot().status()
            risk = msgspec.structs.replace(told.risk, surroundings_sha256=client.now)
            watch.heard(msgspec.structs.replace(told, risk=risk))
            await asyncio.sleep(0.01)
        assert heard == ["a", "b"] and client.looks == 3

    monkeypatch.setattr(surroundings_watch, "_TRY_AGAIN_S", 0.03)
    run_in_real_time(test())
