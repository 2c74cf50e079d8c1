"""The remote API: what publishing costs the loop, and how long questions and a STOP take."""

import asyncio
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path

from config.remote import Remote
from daemon.clock import run_in_real_time
from daemon.remote.messages import Message
from daemon.remote.server import RemoteServer
from tests.benchmarks.timing import Figures, percentiles
from tests.daemon.remote.rig import ROBOT, FakeRobot, tip

PUBLISHED = 4000
ASKED = 400
IMPORTS = 5
_GAP_S = 0.001

_CLIENT = """
import asyncio, json, sys, time
from pathlib import Path
from daemon.clock import run_in_real_time
from daemon.remote.address import LocalAddress
from daemon.remote.client import RobotClient

async def main(what, count):
    address = LocalAddress("little_arm", Path(sys.argv[1]) / "zenoh.sock")
    async with await RobotClient.connect(address) as client:
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


def measure() -> Figures:
    """All figures of the remote API."""
    return run_in_real_time(_measure())


async def _measure() -> Figures:
    with tempfile.TemporaryDirectory() as name:
        folder, robot = Path(name), FakeRobot()
        server = RemoteServer(ROBOT, Remote(), folder, robot, simulated=True, version="0")
        await server.open()
        try:
            messages: dict[str, Message] = {"tip": tip(), "status": robot.status()}
            figures: Figures = {"publish_us": {}}
            for name, message in messages.items():
                nobody = await _publish(server, message)
                async with _client(folder, "listen"):
                    one = await _publish(server, message)
                figures["publish_us"][name] = {"no_subscriber": nobody, "one_subscriber": one}
            figures["status_round_trip_us"] = await _asking(folder, "status")
            figures["stop_round_trip_us"] = await _asking(folder, "stop")
            async with _client(folder, "flood"):
                figures["stop_round_trip_beside_a_flood_us"] = await _asking(folder, "stop")
        finally:
            await server.close()
    figures["stop_command_ms"] = await asyncio.to_thread(_import_times)
    return figures


async def _publish(server: RemoteServer, message: Message) -> Figures:
    took = []
    for _ in range(PUBLISHED):
        start = time.perf_counter_ns()
        server.publish(message)
        took.append(time.perf_counter_ns() - start)
        await asyncio.sleep(_GAP_S)
    return percentiles(took, 1e-3)


async def _asking(folder: Path, what: str) -> Figures:
    async with _client(folder, what) as took:
        return percentiles(await took(), 1e-3)


@asynccontextmanager
async def _client(folder: Path, what: str) -> AsyncIterator[Callable[[], Awaitable[list[int]]]]:
    """A client in a process of its own. Gives what it has measured, once it is ready."""
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-c",
        _CLIENT,
        str(folder),
        what,
        str(ASKED),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        limit=1 << 24,
    )
    assert process.stdout is not None
    output = process.stdout

    async def took() -> list[int]:
        figures: list[int] = json.loads(await output.readline())
        return figures

    try:
        if what in ("listen", "flood"):
            await took()
        yield took
    finally:
        process.kill()
        await process.wait()


def _import_times() -> Figures:
    """What a `tentacled stop` spends before it can connect, beside bare Python."""

    def took(code: str) -> float:
        start = time.perf_counter_ns()
        subprocess.run([sys.executable, "-c", code], check=True)
        return time.perf_counter_ns() - start

    codes = {"python": "pass", "client": "import daemon.remote.client, daemon.commands.stop"}
    return {
        name: percentiles([took(code) for _ in range(IMPORTS)], 1e-6)
        for name, code in codes.items()
    }
