"""What a client may ask for besides what is published: surroundings, and the events before it."""

from pathlib import Path

import pytest

from daemon.host.clock import run_in_real_time
from daemon.messages import Event
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import RefusedError
from daemon.remote.surroundings import cut_surroundings
from tests.daemon.remote.rig import serving

STL = bytes(range(256)) * 700
BOX = [[-1.0, 1.0], [-2.0, 2.0], [0.0, 3.0]]


def event(number: int, detail: str = "") -> Event:
    return Event(
        sequence=number,
        t_ns=number,
        kind="note",
        name="something",
        subject="test",
        present=True,
        text="it has happened",
        detail=detail,
    )


def test_surroundings_come_whole_with_their_hash(tmp_path: Path) -> None:
    async def test() -> None:
        prepared = cut_surroundings("chest.stl", STL, BOX)
        assert prepared.about.parts == 4
        async with (
            serving(tmp_path, surroundings=prepared),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            about, mesh = await client.surroundings()
            assert mesh == STL
            assert about == prepared.about and about.workspace_mm == BOX
            connection = client._connection
            for wrong in ("4", "-1", "x", "9" * 20):
                key = f"{connection.keys.surroundings}/{wrong}"
                with pytest.raises(RefusedError, match="have 4 parts"):
                    await connection.ask_bytes(key, 5.0)

    run_in_real_time(test())


def test_a_robot_that_does_not_know_its_surroundings_says_so(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            about, mesh = await client.surroundings()
            assert mesh == b"" and about.mesh == "" and about.workspace_mm is None

    run_in_real_time(test())


def test_who_comes_late_gets_the_last_200_events_in_their_order(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (server, _),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            assert await client.events() == []
            for number in range(250):
                server.publish(event(number))
            assert [told.sequence for told in await client.events()] == list(range(50, 250))
            for number in range(250, 450):  # more than an answer holds
                server.publish(event(number, "x" * 3000))
            told = [one.sequence for one in await client.events()]
            assert len(told) == 50 and told == list(range(400, 450))

    run_in_real_time(test())
