"""The remote API: what publishing costs the loop, and how long questions and a STOP take."""

import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple

from config.remote import Remote
from daemon.host.clock import run_in_real_time
from daemon.messages import Message
from daemon.remote.server.server import RemoteServer
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.daemon.remote.rig import ROBOT, FakeRobot, tip

PUBLISHED = 4000
ASKED = 400
IMPORTS = 5
_GAP_S = 0.001

_CLIENT = """
import asyncio, json, sys, time
from pathlib import Path
from daemon.host.clock import run_in_real_time
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError

async def connected(address):
    while True:  # a flood of the same user's uses up its quota of questions again and again
        try:
            return await RobotClient.connect(address)
        except ClientError:
            await asyncio.sleep(0.02)

async def main(what, count):
    address = LocalAddress("little_arm", Path(sys.argv[1]) / "zenoh.sock")
    async with await connected(address) as client:
        if what == "listen":
            tips = client.subscribe(["tip", "state"])
            print("[]", flush=True)
            await asyncio.to_thread(sys.stdin.read)
            return
        if what == "flood":
            import zenoh
            key = client._connection.keys
            nothing = zenoh.handlers.Callback(lambda reply: None, indirect=False)
            print("[]", flush=True)
            while True:
                for _ in range(20):
                    client._connection.session.put(key.setpoint("local"), b"x" * 200)
                    client._connection.session.get(key.telemetry("state"), nothing)
                await asyncio.sleep(0.001)
        ask = client.stop if what == "stop" else client.status
        took = []
        for _ in range(count):
            start = time.perf_counter_ns()
            await ask()
            took.append(time.perf_counter_ns() - start)
            await asyncio.sleep(0.001)
        print(json.dumps(took), flush=True)

run_in_real_time(main(sys.argv[2], int(sys.argv[3])))
"""


def measure(tiny: bool = False) -> Figures:
    """All figures of the remote API."""
    published, asked, imports = (20, 5, 1) if tiny else (PUBLISHED, ASKED, IMPORTS)
    named: dict[str, Callable[[], Figures]] = {
        f"publish_{what}_us": partial(_beside_a_server, partial(_publishing, what, published))
        for what in ("tip", "status")
    }
    for name, what, beside in (
        ("status_round_trip_us", "status", None),
        ("stop_round_trip_us", "stop", None),
        ("stop_round_trip_beside_a_flood_us", "stop", "flood"),
    ):
        named[name] = partial(_beside_a_server, partial(_asking, what, asked, beside))
    named["stop_command_ms"] = partial(_import_times, imports)
    return pieces(named)


class Served(NamedTuple):
    """What a piece is measured with."""

    server: RemoteServer
    robot: FakeRobot
    folder: Path


def _beside_a_server(scene: Callable[[Served], Awaitable[Figures]]) -> Figures:
    async def play() -> Figures:
        with tempfile.TemporaryDirectory() as name:
            folder, robot = Path(name), FakeRobot()
            server = RemoteServer(ROBOT, Remote(), folder, robot, simulated=True, version="0")
            await server.open()
            try:
                return await scene(Served(server, robot, folder))
            finally:
                await server.close()

    return run_in_real_time(play())


async def _publishing(what: str, count: int, served: Served) -> Figures:
    message: Message = tip() if what == "tip" else served.robot.status()
    nobody = await _publish(served.server, message, count)
    async with _client(served.folder, "listen", 1):
        one = await _publish(served.server, message, count)
    return {"no_subscriber": nobody, "one_subscriber": one}


async def _asking(what: str, count: int, beside: str | None, served: Served) -> Figures:
    async with AsyncExitStack() as others:
        if beside is not None:
            await others.enter_async_context(_client(served.folder, beside, count))
        async with _client(served.folder, what, count) as took:
            return percentiles(await took(), 1e-3)


async def _publish(server: RemoteServer, message: Message, count: int) -> Figures:
    took = []
    for _ in range(count):
        start = time.perf_counter_ns()
        server.publish(message)
        took.append(time.perf_counter_ns() - start)
        await asyncio.sleep(_GAP_S)
    return percentiles(took, 1e-3)


@asynccontextmanager
async def _client(
    folder: Path, what: str, count: int
) -> AsyncIterator[Callable[[], Awaitable[list[int]]]]:
    """A client in a process of its own. Gives what it has measured, once it is ready."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        _CLIENT,
        str(folder),
        what,
        str(count),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        limit=1 << 24,
    )
    assert process.stdout is not None
    output = process.stdout

    async def took() -> list[int]:
        line = await output.readline()
        assert line, f"the client that is to {what} has ended"
        figures: list[int] = json.loads(line)
        return figures

    try:
        if what in ("listen", "flood"):
            await took()
        yield took
    finally:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def _import_times(count: int) -> Figures:
    """What a `tentacled stop` spends before it can connect, beside bare Python."""

    def took(code: str) -> float:
        start = time.perf_counter_ns()
        subprocess.run([sys.executable, "-c", code], check=True)
        return time.perf_counter_ns() - start

    codes = {
        "python": "pass",
        "client": "import daemon.remote.client.client, daemon.commands.client.stop",
    }
    return {
        name: percentiles([took(code) for _ in range(count)], 1e-6) for name, code in codes.items()
    }
