"""STOP by its own way: whatever is sent, whoever else is in the way, and with an older daemon."""

import asyncio
import socket
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from config.remote import Remote
from daemon.host.clock import run_in_real_time
from daemon.messages import Answer, Command, Refusal, Stop
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import RefusedError
from daemon.remote.client.stop_client import NoStopWayError, stop_answer, stop_locally
from daemon.remote.discovery import read_daemon
from daemon.remote.wire import Format, encode
from tests.daemon.remote.rig import ROBOT, WITHIN_S, FakeRobot, raw, serving, until

PAYLOADS = [
    b"",
    b"\0",
    b"stop",
    b"\xff" * 4000,
    b'{"type": "stop/99"}',
    b'{"type": "arm/1"}',
    b"[" * 4000,
    encode(Stop(request="7"), Format.MSGPACK),
    encode(Stop(request="7"), Format.JSON),
]

NAMES = [f"{len(payload)} bytes, {payload[:16]!r}" for payload in PAYLOADS]


def address(folder: Path) -> LocalAddress:
    return LocalAddress(ROBOT, folder / "zenoh.sock")


@pytest.mark.parametrize("payload", PAYLOADS, ids=NAMES)
def test_every_datagram_is_a_stop_and_is_answered(tmp_path: Path, payload: bytes) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot):
            robot.state = "RUNNING"
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
                line.setblocking(False)
                line.bind("")
                line.connect(str(tmp_path / "stop.sock"))
                line.send(payload)
                answer = await asyncio.wait_for(
                    asyncio.get_running_loop().sock_recv(line, 4096), WITHIN_S
                )
            assert robot.state == "STANDBY"
            request = "7" if b"7" in payload else ""
            assert stop_answer(answer) == Answer(request=request, state="STANDBY")

    run_in_real_time(test())


def test_a_sender_without_an_address_is_obeyed_too(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot):
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
                line.sendto(b"", str(tmp_path / "stop.sock"))
            await until(lambda: robot.stopped_ns)

    run_in_real_time(test())


@pytest.mark.parametrize("payload", [None, *PAYLOADS], ids=["none", *NAMES])
def test_a_stop_as_a_command_is_obeyed_whatever_it_carries(
    tmp_path: Path, payload: bytes | None
) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            (reply,) = await client.get(client.keys.command("local", "stop"), payload)
            assert reply.answer.confirmed
            assert robot.verbs() == ["stop"]

    run_in_real_time(test())


def test_a_stop_is_obeyed_before_anybody_waits_for_its_confirmation(tmp_path: Path) -> None:
    """Who waits for the drives does not keep the next STOP from being obeyed."""

    class Slow(FakeRobot):
        """Its drives do not confirm."""

        async def handle(self, user: str, command: Command) -> Answer | Refusal:
            await asyncio.Event().wait()
            raise AssertionError

    async def test() -> None:
        robot = Slow()
        async with serving(tmp_path, robot):
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as line:
                line.setblocking(False)
                line.connect(str(tmp_path / "stop.sock"))
                for number in range(50):
                    line.send(b"")
                    await until(lambda want=number: len(robot.stopped_ns) > want)  # type: ignore[misc]

    run_in_real_time(test())


def test_who_floods_stops_and_reads_no_answer_holds_up_nobody(tmp_path: Path) -> None:
    flood = (
        "import socket, sys\n"
        "line = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)\n"
        "line.bind('')\n"
        "line.connect(sys.argv[1])\n"
        "while True: line.send(b'')\n"
    )

    async def test() -> None:
        async with serving(tmp_path) as (_, robot):
            path = tmp_path / "stop.sock"
            flooding = await asyncio.create_subprocess_exec(sys.executable, "-c", flood, str(path))
            try:
                await until(lambda: len(robot.stopped_ns) > 100)
                for number in range(5):
                    answer = await stop_locally(path, str(number), WITHIN_S)
                    assert answer.request == str(number)
            finally:
                flooding.kill()
                await flooding.wait()

    run_in_real_time(test())


@pytest.mark.parametrize(("group", "mode"), [(False, 0o600), (True, 0o660)])
def test_the_socket_may_be_used_by_who_may_command(tmp_path: Path, group: bool, mode: int) -> None:
    async def test() -> None:
        async with serving(tmp_path, settings=Remote(group_may_connect=group)):
            path = tmp_path / "stop.sock"
            assert stat.S_IMODE(path.stat().st_mode) == mode
            daemon = read_daemon(tmp_path)
            assert daemon is not None and daemon.stop_socket == str(path)
        assert not path.exists()

    run_in_real_time(test())


def test_a_dead_daemons_socket_is_in_nobodys_way(tmp_path: Path) -> None:
    async def test() -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as dead:
            dead.bind(str(tmp_path / "stop.sock"))
        with pytest.raises(NoStopWayError):
            await stop_locally(tmp_path / "stop.sock", "", WITHIN_S)
        async with serving(tmp_path):
            assert (await stop_locally(tmp_path / "stop.sock", "", WITHIN_S)).confirmed

    run_in_real_time(test())


def test_a_client_stops_by_the_own_way_and_with_an_older_daemon_by_a_command(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(address(tmp_path)) as client,
        ):
            assert (await client.stop()).confirmed
            assert len(robot.stopped_ns) == 1
            (tmp_path / "stop.sock").unlink()
            assert (await client.stop()).confirmed
            assert len(robot.stopped_ns) == 1
            assert robot.verbs() == ["stop", "stop"]

    run_in_real_time(test())


def test_a_stop_that_fails_inside_is_refused_and_not_silent(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot):
            told: list[object] = []
            asyncio.get_running_loop().set_exception_handler(lambda _, what: told.append(what))
            robot.fails = True
            with pytest.raises(RefusedError) as refused:
                await stop_locally(tmp_path / "stop.sock", "3", WITHIN_S)
            assert (refused.value.refusal.name, refused.value.refusal.request) == ("internal", "3")
            assert len(told) == 1

    run_in_real_time(test())


def test_the_stop_command_needs_no_session(tmp_path: Path) -> None:
    """What a STOP has to import before it is sent counts, and zenoh is the most of it."""
    code = "import sys, daemon.commands.client.stop; print('zenoh' in sys.modules)"
    assert subprocess.check_output([sys.executable, "-c", code], text=True) == "False\n"
