"""The OpenIGTLink server: many clients, none of which can hold up another."""

import asyncio
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress

import numpy as np

from daemon.bridges.openigtlink.contents import (
    StatusCode,
    pack_start_tracking,
    read_status,
    read_tracking_data,
    read_transform,
)
from daemon.bridges.openigtlink.framing import Deframer, Frame, packed
from daemon.bridges.openigtlink.server import OpenIGTLinkServer
from daemon.messages import Surroundings, WhoAmI
from tests.daemon.bridges.telling import DATE_NS, body, status, tip

WITHIN_S = 20.0
ME = WhoAmI(robot="little_arm", version="1", role="viewer", simulated=True)


class Reader:
    """A client that hears everything."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.heard: list[Frame] = []
        self.writer = writer
        self._listening = asyncio.create_task(self._listen(reader))

    def of(self, kind: str) -> list[Frame]:
        return [frame for frame in self.heard if frame.kind == kind]

    def ask(self, kind: str, content: bytes = b"", version: int = 1) -> None:
        self.writer.write(packed(Frame(kind, "", content), version))

    async def close(self) -> None:
        self.writer.close()
        await self._listening

    async def _listen(self, reader: asyncio.StreamReader) -> None:
        deframer = Deframer(1 << 20)
        with suppress(ConnectionError):
            while data := await reader.read(1 << 16):
                self.heard += deframer.feed(data)


@asynccontextmanager
async def serving() -> AsyncIterator[tuple[OpenIGTLinkServer, int]]:
    server = OpenIGTLinkServer("robot", ("POLYDATA", "POINT"))
    listening = socket.create_server(("127.0.0.1", 0))
    await server.open(listening)
    server.connected(ME, Surroundings(), b"")
    try:
        yield server, listening.getsockname()[1]
    finally:
        await server.close()


async def come(server: OpenIGTLinkServer, port: int) -> Reader:
    before = len(server.clients)
    one = Reader(*await asyncio.open_connection("127.0.0.1", port))
    await until(lambda: len(server.clients) > before)
    return one


async def until(true: Callable[[], object]) -> None:
    async with asyncio.timeout(WITHIN_S):
        while not true():
            await asyncio.sleep(0.005)


def test_all_clients_hear_the_tip() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            clients = [await come(server, port) for _ in range(5)]
            server.heard(tip(), DATE_NS)
            await until(lambda: all(len(one.of("TRANSFORM")) == 2 for one in clients))
            for one in clients:
                place = read_transform(one.of("TRANSFORM")[0].content)[:, 3]
                assert np.allclose(place, [10.0, -20.0, 190.5])
                await one.close()

    asyncio.run(told())


def test_who_comes_late_hears_body_and_state_at_once() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            server.heard(status(), DATE_NS)
            server.heard(body(), DATE_NS)
            one = await come(server, port)
            await until(lambda: len(one.heard) == 4)
            assert {frame.kind for frame in one.heard} == {"STATUS", "STRING", "POLYDATA", "POINT"}
            await one.close()

    asyncio.run(told())


def test_a_client_that_does_not_read_is_hung_up_on_and_holds_up_nobody() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            deaf = socket.create_connection(("127.0.0.1", port))
            deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            await until(lambda: len(server.clients) == 1)
            hearing = await come(server, port)
            sent = 0

            async def flood() -> None:
                nonlocal sent
                server.heard(body(30), DATE_NS)
                sent += 1
                await asyncio.sleep(0.005)

            async with asyncio.timeout(WITHIN_S):
                while not server.dropped:
                    waiting = [
                        one._writer.transport.get_write_buffer_size()
                        for one in server.clients.values()
                    ]
                    assert max(waiting) < 1 << 16, "nothing is queued for a slow client"
                    await flood()
            assert len(server.clients) == 1
            await until(lambda: len(hearing.of("POLYDATA")) == sent)
            deaf.close()
            await hearing.close()

    asyncio.run(told())


def test_tracking_data_comes_to_who_asks_and_as_often_as_is_wanted() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            asking, other = await come(server, port), await come(server, port)
            asking.ask("STT_TDATA", pack_start_tracking(200))
            await until(lambda: asking.of("RTS_TDATA"))
            assert asking.of("RTS_TDATA")[0].content == b"\0"
            for _ in range(20):
                server.heard(tip(), DATE_NS)
                await asyncio.sleep(0.02)
            await until(lambda: len(other.of("TRANSFORM")) == 40)
            assert 2 <= len(asking.of("TDATA")) <= 4 and not other.of("TDATA")
            tools = read_tracking_data(asking.of("TDATA")[0].content)
            assert [tool.name for tool in tools] == ["Tip", "Base", "Reference"]
            asking.ask("STP_TDATA")
            await until(lambda: len(asking.of("RTS_TDATA")) == 2)
            before = len(asking.of("TDATA"))
            server.heard(tip(), DATE_NS)
            await until(lambda: len(asking.of("TRANSFORM")) == 42)
            assert len(asking.of("TDATA")) == before
            await asking.close()
            await other.close()

    asyncio.run(told())


def test_questions_are_answered_with_the_asker_s_own_header() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            one = await come(server, port)
            server.heard(status(state="running"), DATE_NS)
            one.ask("GET_STATUS", version=2)
            await until(lambda: len(one.of("STATUS")) == 2)
            assert read_status(one.of("STATUS")[1].content).code == StatusCode.OK
            one.ask("GET_CAPABIL", version=2)
            await until(lambda: one.of("CAPABILITY"))
            assert b"TRANSFORM\0\0\0TDATA" in one.of("CAPABILITY")[0].content
            (client,) = server.clients.values()
            assert client.deframer.version == 2
            one.ask("GET_STRING")
            await until(lambda: len(one.of("STRING")) == 2)
            await one.close()

    asyncio.run(told())


def test_a_picture_that_a_client_sends_to_everybody_is_ignored() -> None:
    async def story() -> None:
        async with serving() as (server, port):
            one = await come(server, port)
            one.ask("IMAGE", bytes(1 << 18))
            one.ask("GET_CAPABIL")
            await until(lambda: one.of("CAPABILITY"))
            await one.close()

    asyncio.run(story())


def test_what_is_no_openigtlink_ends_that_client_alone() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            good, bad = await come(server, port), await come(server, port)
            good.ask("IMAGE", b"of somebody else")  # not ours, and no error
            bad.writer.write(b"GET / HTTP/1.1\r\nHost: localhost\r\nAccept: text/html,*/*\r\n\r\n")
            await until(lambda: len(server.clients) == 1)
            server.heard(tip(), DATE_NS)
            await until(lambda: good.of("TRANSFORM"))
            await good.close()
            await bad.close()

    asyncio.run(told())


def test_a_daemon_that_goes_is_told_and_no_place_after_it() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            one = await come(server, port)
            server.heard(status(state="running"), DATE_NS)
            server.heard(body(), DATE_NS)
            server.lost("the daemon has gone")
            await until(lambda: len(one.of("STATUS")) == 2)
            assert read_status(one.of("STATUS")[1].content).code == StatusCode.TIME_OUT
            late = await come(server, port)
            await until(lambda: len(late.heard) == 2)
            assert {frame.kind for frame in late.heard} == {"STATUS", "STRING"}
            await one.close()
            await late.close()

    asyncio.run(told())


def test_the_state_is_told_when_it_changes_and_each_second() -> None:
    async def told() -> None:
        async with serving() as (server, port):
            one = await come(server, port)
            for step in range(31):
                server.heard(status(state="running"), DATE_NS + step * 100_000_000)
            server.heard(status(state="hold"), DATE_NS + 3_150_000_000)
            await until(lambda: len(one.of("STATUS")) == 5)
            assert len(one.of("STRING")) == 2
            await one.close()

    asyncio.run(told())
