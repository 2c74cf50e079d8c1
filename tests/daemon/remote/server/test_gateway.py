"""Who comes over the network: each with his share, and nobody in the way of a STOP."""

import asyncio
import os
import signal
import socket
import ssl
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
import zenoh

from daemon.host.clock import run_in_real_time
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError
from daemon.remote.server.gateway import CONNECTIONS_PER_USER
from daemon.remote.server.tls_listener import AUTHENTICATES_WITHIN_S
from tests.daemon.remote.over_tls import Served, make_certificates, serving_all
from tests.daemon.remote.rig import WITHIN_S, raw, until


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("certificates") / "all")


def connects(port: int, count: int) -> list[socket.socket]:
    """So many that say nothing."""
    return [socket.create_connection(("127.0.0.1", port), WITHIN_S) for _ in range(count)]


def ended(connection: socket.socket) -> bool:
    connection.setblocking(False)
    try:
        return connection.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def close_all(connections: list[socket.socket]) -> None:
    for connection in connections:
        connection.close()


async def until_up(served: Served) -> None:
    """Its processes have started."""
    async with await RobotClient.connect(served.remote("alice"), wait_s=WITHIN_S) as client:
        assert (await client.stop()).confirmed


@pytest.mark.parametrize("speaking", [False, True])
def test_who_does_not_authenticate_is_hung_up_on_within_a_second(
    tmp_path: Path, certificates: Path, speaking: bool
) -> None:
    async def test() -> None:
        async with serving_all(tmp_path, certificates) as served:
            await until_up(served)
            for port in (served.port, served.stop_port):
                idle = await asyncio.to_thread(connects, port, 20)
                start_s = time.monotonic()
                for connection in idle:
                    if speaking:
                        connection.send(b"\x16\x03\x01\x02\x00")
                await until(lambda idle=idle: all(map(ended, idle)))  # type: ignore[misc]
                assert time.monotonic() - start_s < 3.0 * AUTHENTICATES_WITHIN_S
                close_all(idle)

    run_in_real_time(test())


def test_a_user_has_his_share_of_connections_and_others_have_theirs(
    tmp_path: Path, certificates: Path
) -> None:
    async def test() -> None:
        async with serving_all(tmp_path, certificates) as served:
            await until_up(served)
            context = ssl.create_default_context(cafile=str(certificates / "ca.pem"))
            context.load_cert_chain(certificates / "bob.pem", certificates / "bob.key")
            with ExitStack() as open_ones:
                mine = []
                for _ in range(CONNECTIONS_PER_USER + 5):
                    plain = socket.create_connection(("127.0.0.1", served.port), WITHIN_S)
                    one = open_ones.enter_context(
                        context.wrap_socket(plain, server_hostname="127.0.0.1")
                    )
                    mine.append(one)
                refused: set[ssl.SSLSocket] = set()

                def five() -> bool:
                    refused.update(one for one in mine if _refused(one))
                    return len(refused) >= 5

                await until(five)
                assert len(refused) == 5
                for user in ("alice", "dora"):
                    async with raw(served.remote(user)) as client:
                        assert len(await client.get(client.keys.whoami(user))) == 1

    run_in_real_time(test())


def _refused(one: ssl.SSLSocket) -> bool:
    """Whether it was told that it is one too many."""
    one.setblocking(False)
    try:
        return b"share" in one.recv(4096)
    except OSError:
        return False


@pytest.mark.parametrize("kept", [True, False], ids=["kept connection", "new connection"])
def test_a_stop_comes_through_any_number_of_idle_connections(
    tmp_path: Path, certificates: Path, kept: bool
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            await RobotClient.connect(served.remote("alice"), wait_s=WITHIN_S) as client,
        ):
            before = _descriptors()
            flood = await asyncio.to_thread(_idle, served)
            try:
                for number in range(1, 6):
                    if kept:
                        assert (await client.stop()).confirmed
                    else:
                        assert (await served.remote("dora").stop("x", WITHIN_S)).confirmed
                    assert len(served.robot.stopped_ns) == number
                assert _descriptors() - before - len(flood) < 50, (
                    "the flood is not this process' business"
                )
            finally:
                close_all(flood)

    run_in_real_time(test())


def test_who_asks_too_much_is_told_so_and_others_get_their_answers(
    tmp_path: Path, certificates: Path
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            raw(served.local) as viewer,
        ):
            await until_up(served)
            replies: list[bool] = []

            def came(reply: zenoh.Reply) -> None:
                replies.append(reply.err is not None and b"busy" in reply.err.payload.to_bytes())

            callback = zenoh.handlers.Callback(came, indirect=False)
            for _ in range(1500):
                viewer.session.get(viewer.keys.telemetry("state"), callback)
            async with raw(served.remote("alice")) as other:
                (reply,) = await other.get(other.keys.telemetry("state"))
                assert not reply.refused
                (reply,) = await other.get(other.keys.whoami("alice"))
                assert not reply.refused
            await until(lambda: any(replies))

    run_in_real_time(test())


def _idle(served: Served) -> list[socket.socket]:
    return connects(served.port, 300) + connects(served.stop_port, 300)


def _descriptors() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


def test_a_gateway_that_is_killed_is_started_again_at_the_same_port(
    tmp_path: Path, certificates: Path
) -> None:
    async def test() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        async with serving_all(tmp_path, certificates) as served:
            await until_up(served)
            for pid in _gateways():
                os.kill(pid, signal.SIGKILL)

            async def stopped() -> bool:
                with suppress(ClientError):
                    return (await served.remote("alice").stop("", 2.0)).confirmed
                return False

            async with asyncio.timeout(WITHIN_S):
                while not await stopped():
                    await asyncio.sleep(0.05)
            async with raw(served.remote("alice")) as client:
                assert len(await client.get(client.keys.whoami("alice"))) == 1
        assert list(_gateways()) == []

    run_in_real_time(test())


def _gateways() -> Iterator[int]:
    """The gateways that this process has started."""
    text = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(os.getpid())],
        capture_output=True,
        text=True,
        check=False,
    ).stdout
    for line in text.splitlines():
        if "daemon.remote.server.gateway" in line:
            yield int(line.split()[0])
