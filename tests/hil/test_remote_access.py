"""Clients and daemons as processes that flood, freeze and die: none of it hurts the others."""

import asyncio
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from daemon.host.clock import run_in_real_time
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, DisconnectedError, TimedOutError
from tests.daemon.remote.rig import ROBOT, FakeRobot, publish_until, serving, tip, until

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("hil")]

ENDS_WITHIN_S = 30.0
BLOCKED_S = 3.0
"""A put or an answer that is held up by a client would take zenoh's five seconds."""

CLIENT = """
import asyncio, os, signal, sys, time
from pathlib import Path
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.blocking_client import BlockingRobotClient
from daemon.remote.client.client import RobotClient
from daemon.messages import Arm, Load
from daemon.remote.wire import encode

address = LocalAddress("little_arm", Path(sys.argv[1]) / "zenoh.sock")

async def connected():
    client = await RobotClient.connect(address)
    print("ready", flush=True)
    return client

"""
LISTENS = (
    CLIENT
    + "client = BlockingRobotClient(address); tips = client.messages(['tip'])\n"
    + ("next(tips); print('ready', flush=True); time.sleep(1000)")
)
FLOODS = (
    CLIENT
    + """
async def main():
    client = await connected()
    session, keys = client._connection.session, client._connection.keys
    arm, load = encode(Arm()), encode(Load(trajectory={"points": [1.0] * 5000}))
    import zenoh
    nothing = zenoh.handlers.Callback(lambda reply: None, indirect=False)
    while True:
        for _ in range(20):
            session.get(keys.command("local", "arm"), nothing, payload=arm)
            session.get(keys.command("local", "load"), nothing, payload=load)
            session.get(keys.telemetry("state"), nothing)
            for _ in range(50):
                session.put(keys.setpoint("local"), arm)

asyncio.run(main())
"""
)
DOES_NOT_READ = (
    CLIENT
    + """
async def main():
    client = await connected()
    session, keys = client._connection.session, client._connection.keys
    import zenoh
    nothing = zenoh.handlers.Callback(lambda reply: None, indirect=False)
    for _ in range(10):
        for _ in range(10):
            session.get(keys.schemas, nothing, timeout=60.0)
        os.kill(os.getpid(), signal.SIGSTOP)

asyncio.run(main())
"""
)
HOLDS_THE_LEASE = (
    CLIENT
    + """
async def main():
    client = await RobotClient.connect(address)
    await client.acquire()
    print("ready", flush=True)
    if sys.argv[2] == "wedged":
        time.sleep(1000)
    await asyncio.sleep(1000)

asyncio.run(main())
"""
)
LEAVES_OPEN = (
    CLIENT
    + """
client = BlockingRobotClient(address)
client.acquire()
print("ready", flush=True)
if sys.argv[2] == "raise":
    raise RuntimeError("a mistake in somebody's program")
sys.exit(3)
"""
)


@pytest.fixture
def tmp_path() -> Iterator[Path]:
    """A folder with a short name: the path of a unix socket has 107 bytes at most."""
    with tempfile.TemporaryDirectory(prefix="tentacled-") as name:
        yield Path(name)


@contextmanager
def program(code: str, *words: str | Path) -> Iterator[subprocess.Popen[str]]:
    """A client in a process of its own, from when it is ready."""
    with process("-c", code, *map(str, words)) as one:
        yield one


@contextmanager
def daemon(folder: Path, ending: str = "close") -> Iterator[subprocess.Popen[str]]:
    """A daemon in a process of its own, from when it is ready."""
    with process("-m", "tests.daemon.remote.serve", str(folder), ending) as one:
        yield one


@contextmanager
def process(*words: str) -> Iterator[subprocess.Popen[str]]:
    one = subprocess.Popen(
        [sys.executable, *words],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert one.stdout is not None and one.stdin is not None
    try:
        yield one
    finally:
        one.kill()
        one.wait()
        one.stdout.close()
        with suppress(BrokenPipeError):
            one.stdin.close()


async def ready(one: subprocess.Popen[str]) -> None:
    assert one.stdout is not None
    assert await asyncio.to_thread(one.stdout.readline) == "ready\n"


def local(folder: Path) -> LocalAddress:
    return LocalAddress(ROBOT, folder / "zenoh.sock")


async def took_s(client: RobotClient) -> float:
    """How long a STOP takes, there and back."""
    start_s = time.monotonic()
    assert (await client.stop(ENDS_WITHIN_S)).confirmed
    return time.monotonic() - start_s


def test_a_frozen_subscriber_holds_up_neither_the_loop_nor_other_clients(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (server, _),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            with program(LISTENS, tmp_path) as frozen:
                said = asyncio.create_task(ready(frozen))
                await publish_until(server, tip(), lambda: said.done())
                await said
                frozen.send_signal(signal.SIGSTOP)
                longest_s = 0.0
                for number in range(20_000):
                    start_s = time.monotonic()
                    server.publish(tip(number))
                    longest_s = max(longest_s, time.monotonic() - start_s)
                    if number % 200 == 0:
                        await asyncio.sleep(0)
                assert longest_s < BLOCKED_S
                assert await took_s(client) < BLOCKED_S
                assert (await client.status()).robot == ROBOT

    run_in_real_time(test())


def test_a_client_that_floods_does_not_delay_the_stop_of_another(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            loop = asyncio.get_running_loop()
            loop.set_exception_handler(lambda *_: None)
            with program(FLOODS, tmp_path) as flooding:
                await ready(flooding)
                for _ in range(20):
                    assert await took_s(client) < BLOCKED_S
                    await asyncio.sleep(0.05)
                assert flooding.poll() is None
            assert robot.verbs().count("stop") == 20

    run_in_real_time(test())


def test_a_client_that_never_reads_its_answers_does_not_keep_others_from_theirs(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            with program(DOES_NOT_READ, tmp_path) as stuck:
                await ready(stuck)
                for _ in range(20):
                    assert await took_s(client) < BLOCKED_S
                    assert (await client.status()).robot == ROBOT
                    stuck.send_signal(signal.SIGCONT)
                    await asyncio.sleep(0.02)

    run_in_real_time(test())


@pytest.mark.parametrize("how", ["killed", "wedged", "frozen"])
def test_a_lease_runs_out_when_its_holder_dies_hangs_or_freezes(tmp_path: Path, how: str) -> None:
    async def test() -> None:
        async with serving(tmp_path, FakeRobot(lease_s=2.0)) as (_, robot):
            with program(HOLDS_THE_LEASE, tmp_path, how) as holder:
                await ready(holder)
                if how == "killed":
                    holder.kill()
                elif how == "frozen":
                    holder.send_signal(signal.SIGSTOP)
                await until(lambda: robot.lease.holder(robot.clock.now_ns()) is None)
                async with await RobotClient.connect(local(tmp_path)) as client:
                    assert (await client.acquire()).token

    run_in_real_time(test())


@pytest.mark.parametrize("ending", ["raise", "exit"])
def test_a_clients_program_ends_even_if_it_forgets_to_close(tmp_path: Path, ending: str) -> None:
    async def test() -> None:
        async with serving(tmp_path):
            with program(LEAVES_OPEN, tmp_path, ending) as one:
                await ready(one)
                code = await asyncio.to_thread(one.wait, ENDS_WITHIN_S)
                assert code == (1 if ending == "raise" else 3)

    run_in_real_time(test())


@pytest.mark.parametrize(
    ("ending", "code"), [("close", 0), ("forget", 0), ("raise", 1), ("exit", 3)]
)
def test_a_daemons_process_ends_however_it_ends(tmp_path: Path, ending: str, code: int) -> None:
    async def test() -> None:
        with daemon(tmp_path, ending) as one:
            await ready(one)
            async with await RobotClient.connect(local(tmp_path)) as client:
                tips = client.subscribe(["tip"])
                await anext(tips)
                assert one.stdin is not None
                one.stdin.close()
                assert await asyncio.to_thread(one.wait, ENDS_WITHIN_S) == code
                with pytest.raises(DisconnectedError):
                    async with asyncio.timeout(ENDS_WITHIN_S):
                        while True:
                            await anext(tips)

    run_in_real_time(test())


def test_a_killed_daemon_leaves_nothing_in_the_way_of_the_next(tmp_path: Path) -> None:
    async def test() -> None:
        with daemon(tmp_path) as first:
            await ready(first)
            client = await RobotClient.connect(local(tmp_path))
            first.kill()
            with pytest.raises(ClientError):
                async with asyncio.timeout(ENDS_WITHIN_S):
                    while True:
                        await client.status()
        with daemon(tmp_path) as second:
            await ready(second)
            await until(lambda: client.connected, "the connection")
            assert (await client.status()).robot == ROBOT
            await client.close()
            with daemon(tmp_path) as third:
                assert await asyncio.to_thread(third.wait, ENDS_WITHIN_S) == 1
            async with await RobotClient.connect(local(tmp_path)) as other:
                assert (await other.status()).robot == ROBOT

    run_in_real_time(test())


def test_a_frozen_daemon_is_a_timeout_and_not_silence(tmp_path: Path) -> None:
    async def test() -> None:
        with daemon(tmp_path) as one:
            await ready(one)
            async with await RobotClient.connect(local(tmp_path)) as client:
                one.send_signal(signal.SIGSTOP)
                with pytest.raises((TimedOutError, DisconnectedError)):
                    await client.stop(within_s=0.3)
                with pytest.raises(TimedOutError):
                    await RobotClient.connect(local(tmp_path))
                one.send_signal(signal.SIGCONT)

                async def stopped() -> bool:
                    with suppress(ClientError):
                        return (await client.stop()).confirmed
                    return False

                async with asyncio.timeout(ENDS_WITHIN_S):
                    while not await stopped():
                        await asyncio.sleep(0.1)

    run_in_real_time(test())
