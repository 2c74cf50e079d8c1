"""A browser's line for STOP: what it may say, and that nothing of the server is in its way."""

import asyncio
import json
import os
import resource
import signal
import socket
import subprocess
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import aiohttp
import msgspec
import pytest
from wsproto import WSConnection
from wsproto.connection import ConnectionType
from wsproto.events import (
    AcceptConnection,
    BytesMessage,
    CloseConnection,
    Event,
    Message,
    Ping,
    Pong,
    RejectConnection,
    Request,
    TextMessage,
)

from daemon.dashboard.stop_lines import HANDED_ON, Line, Robots, StopLine
from daemon.host.clock import run_in_real_time
from daemon.messages import Answer
from daemon.remote.client.client_errors import ClientError
from tests.daemon.dashboard.test_server import VIEWER, served
from tests.daemon.remote.rig import ROBOT, until


class Browser(NamedTuple):
    """The other end of a line, by the same library's client side."""

    frames: WSConnection
    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    def send(self, *events: Event) -> None:
        self.writer.write(b"".join(self.frames.send(event) for event in events))

    def press(self, *numbers: int, robot: str = ROBOT) -> None:
        self.send(*(TextMessage(json.dumps({"robot": robot, "n": n})) for n in numbers))

    async def events(self) -> list[Event]:
        """What comes next. Raises EOFError, ConnectionError where the line is over."""
        async with asyncio.timeout(5.0):
            data = await self.reader.read(65536)
        if not data:
            raise EOFError
        self.frames.receive_data(data)
        return list(self.frames.events())

    async def outcome(self) -> dict[str, object]:
        """Of a press; before it there may be word that it has gone."""
        while True:
            for event in await self.events():
                if isinstance(event, BytesMessage):
                    message: dict[str, object] = json.loads(bytes(event.data))
                    if "outcome" in message:
                        return message
                    assert message["sent"] is True


@asynccontextmanager
async def a_line(
    stop: Callable[[str], Awaitable[Answer]], **headers: str
) -> AsyncIterator[Browser]:
    """Open, where its request is in order. headers: instead of what a browser sends."""
    ours, theirs = socket.socketpair()
    asked = {
        "Host": "here",
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Version": "13",
    }
    frames = WSConnection(ConnectionType.CLIENT)
    request = frames.send(Request(host="here", target="/stop")).decode()
    key = next(line for line in request.splitlines() if line.startswith("Sec-WebSocket-Key"))
    asked["Sec-WebSocket-Key"] = key.partition(": ")[2]
    asked.update({name.replace("_", "-"): value for name, value in headers.items()})
    reader, writer = await asyncio.open_connection(sock=theirs)
    serving = asyncio.create_task(StopLine(reader, writer, stop).serve(list(asked.items())))
    browser = Browser(frames, *await asyncio.open_connection(sock=ours))
    try:
        yield browser
    finally:
        browser.writer.close()
        async with asyncio.timeout(5.0):
            await asyncio.gather(serving)


def answering(outcomes: list[str], confirmed: bool = True) -> Callable[[str], Awaitable[Answer]]:
    async def stop(robot: str) -> Answer:
        outcomes.append(robot)
        await asyncio.sleep(0.01)
        return Answer(request="page", text="off", state="ready", confirmed=confirmed)

    return stop


@pytest.mark.parametrize(("confirmed", "outcome"), [(True, "confirmed"), (False, "not confirmed")])
def test_a_press_is_told_to_have_gone_and_then_what_came_of_it(
    confirmed: bool, outcome: str
) -> None:
    async def test() -> None:
        robots: list[str] = []
        async with a_line(answering(robots, confirmed)) as browser:
            assert isinstance((await browser.events())[0], AcceptConnection)
            browser.press(4)
            told = (await browser.events())[0]
            assert isinstance(told, BytesMessage)
            assert json.loads(bytes(told.data)) == {"n": 4, "sent": True}
            came = await browser.outcome()
            assert came["n"] == 4 and came["outcome"] == outcome and robots == [ROBOT]

    run_in_real_time(test())


def test_a_stop_that_cannot_be_told_says_so_at_once_and_never_that_it_went() -> None:
    async def stop(robot: str) -> Answer:
        raise ClientError(f"{robot}: no daemon")

    async def test() -> None:
        async with a_line(stop) as browser:
            await browser.events()
            browser.press(1)
            told = await browser.outcome()
            assert (told["outcome"], told["text"]) == ("no answer", f"{ROBOT}: no daemon")

    run_in_real_time(test())


@pytest.mark.parametrize("said", ["heart", "{}", "[]", "1", '{"robot": 1}', ""])
def test_what_is_no_stop_does_nothing_and_the_line_stays(said: str) -> None:
    async def test() -> None:
        robots: list[str] = []
        async with a_line(answering(robots)) as browser:
            await browser.events()
            half = json.dumps({"robot": ROBOT, "n": 2})
            browser.send(TextMessage(said), BytesMessage(b"\0"), Ping(b"there?"))
            assert isinstance((await browser.events())[0], Pong)
            assert robots == []
            browser.send(Message(half[:9], message_finished=False), Message(half[9:]))
            assert (await browser.outcome())["n"] == 2 and robots == [ROBOT]

    run_in_real_time(test())


def test_a_line_that_asks_without_end_is_ended_and_the_robot_was_told_some_times_only() -> None:
    async def test() -> None:
        robots: list[str] = []
        async with a_line(answering(robots)) as browser:
            await browser.events()
            browser.press(*range(200))
            with pytest.raises((EOFError, ConnectionError)):
                while True:
                    await browser.events()
            assert 1 <= len(robots) <= 8

    run_in_real_time(test())


def test_a_message_without_an_end_ends_the_line() -> None:
    async def test() -> None:
        robots: list[str] = []
        async with a_line(answering(robots)) as browser:
            await browser.events()
            with pytest.raises((EOFError, ConnectionError)):
                while True:
                    browser.send(Message("{" * 1000, message_finished=False))
                    with suppress(TimeoutError):
                        async with asyncio.timeout(0.02):
                            await browser.events()
            assert robots == []

    run_in_real_time(test())


def test_who_hangs_up_is_answered_so_and_bytes_of_nobody_s_protocol_end_it() -> None:
    async def test() -> None:
        async with a_line(answering([])) as browser:
            await browser.events()
            browser.send(CloseConnection(1000))
            assert isinstance((await browser.events())[-1], CloseConnection)
        async with a_line(answering([])) as browser:
            await browser.events()
            browser.writer.write(b"GET / HTTP/1.1\r\n\r\n")
            with pytest.raises((EOFError, ConnectionError)):
                while True:
                    await browser.events()

    run_in_real_time(test())


@pytest.mark.parametrize("header", ["Sec_WebSocket_Version", "Upgrade"])
def test_a_request_for_another_protocol_opens_no_line(header: str) -> None:
    async def test() -> None:
        async with a_line(answering([]), **{header: "7"}) as browser:
            with suppress(EOFError, ConnectionError):
                told = await browser.events()
                assert all(isinstance(one, RejectConnection) for one in told), told

    run_in_real_time(test())


def test_a_stop_goes_where_whoever_pressed_it_leaves_at_once() -> None:
    async def test() -> None:
        robots: list[str] = []
        async with a_line(answering(robots)) as browser:
            await browser.events()
            browser.press(1)
            browser.writer.close()
        assert robots == [ROBOT]

    run_in_real_time(test())


def test_what_is_handed_on_is_read_back() -> None:
    for told in (Robots({"a": "/run/a"}), Line([("Upgrade", "websocket")])):
        assert HANDED_ON.decode(msgspec.json.encode(told)) == told


def newest_process() -> int:
    """The one for STOP that was made last by this test; 0: there is none."""
    found = subprocess.run(
        ["pgrep", "-P", str(os.getpid()), "-f", "daemon.dashboard.stop_lines"],
        capture_output=True,
        text=True,
        check=False,
    ).stdout.split()
    return int(found[-1]) if found else 0


@pytest.mark.skipif(
    os.geteuid() != 0 and resource.getrlimit(resource.RLIMIT_RTPRIO)[0] < 10,
    reason="no real-time priority is permitted here: LimitRTPRIO=80",
)
def test_the_process_for_stop_goes_before_what_draws_pictures(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            async with page.http.ws_connect(f"{page.base}/stop", headers=page.sent(VIEWER)):
                policy = os.sched_getscheduler(newest_process())
            assert policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO

    run_in_real_time(test())


def test_the_process_for_stop_is_made_again_and_new_lines_go_there(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            url = f"{page.base}/stop"
            first = newest_process()
            async with page.http.ws_connect(url, headers=page.sent(VIEWER)) as line:
                await line.send_str(json.dumps({"robot": ROBOT, "n": 1}))
                assert json.loads((await line.receive(10.0)).data)["n"] == 1
                os.kill(first, signal.SIGKILL)
                while (await line.receive(10.0)).type is aiohttp.WSMsgType.BINARY:
                    pass
            async with page.http.ws_connect(url, headers=page.sent()) as line:
                await line.send_str(json.dumps({"robot": ROBOT, "n": 2}))
                assert json.loads((await line.receive(10.0)).data)["n"] == 2
            assert newest_process() not in (0, first)
            await until(lambda: len(page.robot.stopped_ns) == 2)

    run_in_real_time(test())


def pressed(url: str, headers: dict[str, str], opened: threading.Event) -> tuple[float, bytes]:
    """When it was told that the STOP had gone, and what was told. Blocks, in a thread."""
    frames = WSConnection(ConnectionType.CLIENT)
    host = url.removeprefix("http://").partition("/")[0]
    name, _, port = host.partition(":")
    with socket.create_connection((name, int(port)), timeout=5.0) as connection:
        wanted = [(key.encode(), value.encode()) for key, value in headers.items()]
        asked = Request(host=host, target="/stop", extra_headers=wanted)
        connection.sendall(frames.send(asked))
        frames.receive_data(connection.recv(4096))
        assert isinstance(next(frames.events()), AcceptConnection)
        opened.set()
        time.sleep(0.2)
        connection.sendall(frames.send(TextMessage(json.dumps({"robot": ROBOT, "n": 1}))))
        frames.receive_data(connection.recv(4096))
        told = next(one for one in frames.events() if isinstance(one, BytesMessage))
        return time.monotonic(), bytes(told.data)


def test_a_server_that_hangs_is_not_in_a_stop_s_way(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            opened = threading.Event()
            waiting = asyncio.create_task(
                asyncio.to_thread(pressed, page.base, page.sent(VIEWER), opened)
            )
            await until(opened.is_set)
            time.sleep(1.5)  # noqa: ASYNC251
            free_again_s = time.monotonic()  # the server, and the robot, whose loop is the same
            told_s, told = await waiting
            assert json.loads(told) == {"n": 1, "sent": True} and told_s < free_again_s - 0.5
            await until(lambda: len(page.robot.stopped_ns) == 1)

    run_in_real_time(test())
