"""How a bridge hears a robot: again when it has come back, and with dates that are right."""

import asyncio
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from daemon.bridges.robot_feed import DaemonDate, RobotFeed
from daemon.messages import Message, Status, Surroundings, Tip, WhoAmI
from daemon.remote.client.address import LocalAddress
from daemon.remote.surroundings import cut_surroundings
from tests.daemon.remote.conftest import tmp_path as tmp_path
from tests.daemon.remote.rig import ROBOT, publish_until, serving, tip, until

S = 1_000_000_000
AHEAD_NS = 1_700_000_000 * S


class Ears:
    def __init__(self) -> None:
        self.me: list[WhoAmI] = []
        self.told: list[tuple[Message, int]] = []
        self.why: list[str] = []
        self.around: list[tuple[str, bytes]] = []

    def connected(self, me: WhoAmI, surroundings: Surroundings, mesh: bytes) -> None:
        self.me.append(me)

    def surrounded(self, surroundings: Surroundings, mesh: bytes) -> None:
        self.around.append((surroundings.mesh, mesh))

    def heard(self, message: Message, date_ns: int) -> None:
        self.told.append((message, date_ns))

    def lost(self, why: str) -> None:
        self.why.append(why)

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message, _ in self.told if isinstance(message, kind)]


def test_it_waits_for_its_daemon_hears_it_and_hears_it_again(tmp_path: Path) -> None:
    async def story() -> None:
        ears = Ears()
        feed = RobotFeed(lambda: LocalAddress.in_folder(tmp_path), ears)
        running = asyncio.create_task(feed.run())
        await until(lambda: ears.why)
        assert "no daemon is running" in ears.why[0]
        for time in (1, 2):
            ears.told.clear()
            async with serving(tmp_path) as (server, robot):
                await until(lambda time=time: len(ears.me) == time)  # type: ignore[misc]
                assert ears.me[-1].robot == ROBOT
                await until(lambda: ears.of(Status))
                await publish_until(server, tip(), lambda: ears.of(Tip))
                assert robot.carried_out == [] and robot.lease.holder(0) is None
            await until(lambda time=time: len(ears.why) >= time + 1)  # type: ignore[misc]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(story())


def test_it_is_told_of_other_surroundings(tmp_path: Path) -> None:
    async def story() -> None:
        ears = Ears()
        feed = RobotFeed(lambda: LocalAddress.in_folder(tmp_path), ears)
        running = asyncio.create_task(feed.run())
        async with serving(tmp_path) as (server, robot):
            await until(lambda: ears.me)
            assert ears.around == []
            stl = bytes(84)
            server.show(cut_surroundings("box.stl", stl, None, "a" * 64))
            status = robot.status()
            risk = replace(status.risk, surroundings_sha256="a" * 64)
            await publish_until(server, replace(status, risk=risk), lambda: ears.around)
            await asyncio.sleep(0.2)
            assert ears.around == [("box.stl", stl)]
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(story())


@given(st.lists(st.integers(0, 30 * 1_000_000), min_size=2, max_size=60))
def test_dates_are_never_later_than_arrivals_nor_earlier_than_measured(delays: list[int]) -> None:
    """Once a message came quickly, later ones are dated as they were made."""
    date, least = DaemonDate(), 30 * 1_000_000
    for number, delay in enumerate(delays):
        made = 5 * S + number * 25_000_000
        least = min(least, delay)
        found = date.of(made, made + AHEAD_NS + delay)
        assert found == made + AHEAD_NS + least


def test_a_clock_that_is_set_back_or_drifts_is_followed() -> None:
    date = DaemonDate()
    for step in range(200):
        date.of(step * S, step * S + AHEAD_NS)
    assert date.of(200 * S, 200 * S + AHEAD_NS - 5 * S) == 195 * S + AHEAD_NS
    for step in range(201, 340):  # set forward by an hour: followed within two minutes
        found = date.of(step * S, step * S + AHEAD_NS + 3600 * S)
    assert found == 339 * S + AHEAD_NS + 3600 * S


def test_a_daemon_that_has_started_anew_begins_its_time_anew() -> None:
    date = DaemonDate()
    date.of(10_000 * S, 10_000 * S + AHEAD_NS)
    for step in range(70):
        found = date.of(step * S, step * S + AHEAD_NS + 20_000 * S)
    assert found == 69 * S + AHEAD_NS + 20_000 * S
