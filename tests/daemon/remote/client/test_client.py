"""The client: what it asks is done, and what is not done has a reason with a type."""

import asyncio
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from daemon.host.clock import run_in_real_time
from daemon.messages import Acquire, Answer, Load, SetpointRefused, Tip
from daemon.remote.client.address import LocalAddress, TlsAddress
from daemon.remote.client.blocking_client import BlockingRobotClient
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import (
    AccessDeniedError,
    BadAnswerError,
    ClientError,
    DaemonNotRunningError,
    DisconnectedError,
    RefusedError,
    TimedOutError,
    VersionMismatchError,
)
from daemon.remote.client.connection import Connection
from tests.daemon.remote.over_tls import STRANGER, free_port, make_certificates, serving_all
from tests.daemon.remote.rig import (
    ROBOT,
    FakeRobot,
    publish_until,
    serving,
    setpoint,
    tip,
    until,
)


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("certificates") / "all")


def local(folder: Path, robot: str = ROBOT) -> LocalAddress:
    return LocalAddress(robot, folder / "zenoh.sock")


def test_a_client_does_everything_that_an_operator_does(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(LocalAddress.in_folder(tmp_path)) as client,
        ):
            assert (client.me.role, client.me.simulated) == ("operator", True)
            assert (await client.status()).state == "STANDBY"
            assert await client.whoami() == client.me
            await client.acquire()
            for command in (
                client.arm(),
                client.load({"kind": "circle"}, cycles=3),
                client.start(),
                client.hold(),
                client.resume(),
                client.teleoperate(),
                client.disarm(),
                client.clear(),
                client.inject("tracker.missing=1s"),
                client.stop(),
                client.release(),
            ):
                assert isinstance(await command, Answer)
            assert " ".join(robot.verbs()) == (
                "arm load start hold resume teleoperate disarm clear inject stop release"
            )
            assert client.connected

    run_in_real_time(test())


def test_a_refusal_comes_with_all_that_the_daemon_says(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            with pytest.raises(RefusedError, match="acquire the lease first") as caught:
                await client.arm()
            assert caught.value.refusal.name == "no_lease"

    run_in_real_time(test())


def test_the_lease_is_renewed_as_long_as_the_client_is_there_and_then_runs_out(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with serving(tmp_path, FakeRobot(lease_s=4.0)) as (_, robot):
            async with await RobotClient.connect(local(tmp_path)) as client:
                await client.acquire()
                first = robot.lease.expires_in_s(robot.clock.now_ns())
                assert first is not None
                await asyncio.sleep(4.5)
                assert client.lease_lost is None
                await client.arm()
                async with await RobotClient.connect(local(tmp_path)) as other:
                    with pytest.raises(RefusedError, match="local has it"):
                        await other.acquire()
            await until(lambda: robot.lease.holder(robot.clock.now_ns()) is None)

    run_in_real_time(test())


def test_messages_come_in_their_order_and_the_newest_win(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (server, _),
            await RobotClient.connect(local(tmp_path)) as client,
            client.subscribe(["tip"], depth=4) as tips,
        ):
            await publish_until(server, tip(), lambda: tips._waiting)
            await client.status()
            for number in range(100, 140):
                server.publish(tip(number))
            await client.status()  # on the same way, behind the tips
            await until(lambda: tips.missed > 30)
            got = [await anext(tips) for _ in range(4)]
            assert all(isinstance(message, Tip) for message in got)
            assert [message.sequence for message in got if isinstance(message, Tip)] == [
                136,
                137,
                138,
                139,
            ]

    run_in_real_time(test())


def test_the_end_of_the_daemon_ends_a_stream_and_its_return_begins_it_again(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, _):
            client = await RobotClient.connect(local(tmp_path))
            tips = client.subscribe(["tip"])
            await publish_until(server, tip(1), lambda: tips._waiting)
            assert await anext(tips) == tip(1)
        with pytest.raises(DisconnectedError):
            async with asyncio.timeout(20):
                while True:
                    await anext(tips)
        assert not client.connected
        with pytest.raises(DisconnectedError):
            await client.status()
        with pytest.raises(DisconnectedError):
            client.send_setpoint([1.0, 2.0, 3.0])
        async with serving(tmp_path) as (server, _):
            await until(lambda: client.connected, "the connection")
            await publish_until(server, tip(2), lambda: tips._waiting)
            assert await anext(tips) == tip(2)
            await client.stop()
        await client.close()

    run_in_real_time(test())


def test_set_points_are_numbered_and_signed_and_refusals_can_be_seen(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(local(tmp_path)) as client,
            client.subscribe(["event"]) as events,
        ):
            token = (await client.acquire()).token
            for number in (1, 2):
                client.send_setpoint([1.0, 2.0, 100.0], velocity_mm_s=[0.0, 0.0, 0.0])
                await until(lambda n=number: len(robot.setpoints) == n)  # type: ignore[misc]
            sent = [message for _, message in robot.setpoints]
            assert [message.sequence for message in sent] == [1, 2]
            assert {message.token for message in sent} == {token}
            while True:
                client.send_setpoint([1.0, float("inf"), 100.0])
                try:
                    async with asyncio.timeout(1.0):
                        refused = await anext(events)
                    break
                except TimeoutError:
                    continue
            assert isinstance(refused, SetpointRefused)
            assert refused.reason == "inf is not a finite number at $.position_mm[1]"

    run_in_real_time(test())


def fails(address: LocalAddress | TlsAddress, kind: type[ClientError], text: str) -> None:
    async def test() -> None:
        with pytest.raises(kind, match=text):
            async with await RobotClient.connect(address):
                pass

    run_in_real_time(test())


def test_without_a_daemon_the_client_says_so(tmp_path: Path) -> None:
    fails(local(tmp_path), DaemonNotRunningError, "is not running")
    with pytest.raises(DaemonNotRunningError, match="no daemon is running in"):
        LocalAddress.in_folder(tmp_path)


def test_a_socket_that_a_killed_daemon_has_left_is_no_daemon(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as left:
        left.bind(str(tmp_path / "zenoh.sock"))
    fails(local(tmp_path), DaemonNotRunningError, "is not running")


def test_a_folder_without_socket_says_where_else_to_go(tmp_path: Path, certificates: Path) -> None:
    (tmp_path / "daemon.json").write_text(
        '{"robot":"r","pid":1,"version":"1","simulated":true,"unix_socket":null,"tls":"h:7448"}'
    )
    with pytest.raises(DaemonNotRunningError, match="reach it over tls, at h:7448"):
        LocalAddress.in_folder(tmp_path)


def test_a_daemon_that_falls_silent_has_not_forgotten_the_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def silent(*_: object) -> list[object]:
        return []

    async def test() -> None:
        async with serving(tmp_path):
            connection = await Connection.connect(local(tmp_path))
            await connection.whoami()
            with monkeypatch.context() as patch:
                patch.setattr(Connection, "_get", silent)
                with pytest.raises(DisconnectedError, match="no answer to tentacled"):
                    await connection.whoami()
            await connection.close()

    run_in_real_time(test())


def test_the_reason_of_each_failure_over_tls(tmp_path: Path, certificates: Path) -> None:
    async def reason(address: TlsAddress, kind: type[ClientError], text: str) -> None:
        with pytest.raises(kind, match=text):
            await RobotClient.connect(address)

    async def test() -> None:
        foreign = make_certificates(tmp_path / "foreign")
        mixed = make_certificates(tmp_path / "mixed")
        (mixed / "ca.pem").write_bytes((certificates / "ca.pem").read_bytes())
        async with serving_all(tmp_path / "run", certificates) as served:
            mine = served.remote("alice")
            await reason(served.remote("nobody"), AccessDeniedError, "there is no .*nobody.pem")
            await reason(
                served.remote("alice", foreign), AccessDeniedError, "is not believed: .*certificate"
            )
            await reason(served.remote("alice", mixed), AccessDeniedError, "refused .*alice.pem")
            await reason(served.remote(STRANGER), AccessDeniedError, "not know the user 'mallory'")
            elsewhere = TlsAddress(ROBOT, f"localhost:{served.port}", certificates, "alice")
            await reason(elsewhere, AccessDeniedError, "is not believed: .*[Hh]ostname")
            nowhere = TlsAddress(ROBOT, f"127.0.0.1:{free_port()}", certificates, "alice")
            await reason(nowhere, DaemonNotRunningError, "nobody listens at")
            other = TlsAddress("other_arm", mine.endpoint, certificates, "alice")
            await reason(other, DaemonNotRunningError, "the one of little_arm, not of other_arm")
            (mixed / "alice.key").write_text("broken")
            await reason(served.remote("alice", mixed), AccessDeniedError, "are no good")

    run_in_real_time(test())


def test_a_viewer_is_told_that_a_viewer_may_not_command(tmp_path: Path, certificates: Path) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            await RobotClient.connect(served.remote("bob")) as viewer,
        ):
            assert viewer.me.role == "viewer"
            assert (await viewer.status()).robot == ROBOT
            for attempt in (viewer.acquire, viewer.arm, viewer.stop):
                with pytest.raises(AccessDeniedError, match="'bob' is a viewer"):
                    await attempt()

    run_in_real_time(test())


class Impostor:
    """A daemon of another kind, to see what the client makes of its answers."""

    def __init__(self, folder: Path, answer: Callable[[zenoh.Query], None]) -> None:
        config = zenoh.Config()
        config.insert_json5("mode", '"peer"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", f'["unixsock-stream/{folder / "zenoh.sock"}"]')
        self.session = zenoh.open(config)
        callback = zenoh.handlers.Callback(answer, indirect=False)
        self.session.declare_queryable(f"tentacled/{ROBOT}/**", callback)

    def __enter__(self) -> "Impostor":
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize(
    ("payload", "kind", "text"),
    [
        (b'{"type":"whoami/2"}', VersionMismatchError, "version 1 of 'whoami' is spoken here"),
        (b'{"type":"status/1"}', BadAnswerError, "'whoami/1' belongs here"),
        (b"hello", BadAnswerError, "this is no application/json"),
    ],
)
def test_answers_of_another_version_or_kind_are_told(
    tmp_path: Path, payload: bytes, kind: type[ClientError], text: str
) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(query.key_expr, payload, encoding="application/json")

    with Impostor(tmp_path, answer):
        fails(local(tmp_path), kind, text)


def test_a_command_that_an_older_daemon_does_not_understand_is_told(tmp_path: Path) -> None:
    def answer(query: zenoh.Query) -> None:
        text = b'{"type":"refusal/1","request":"","state":"","name":"bad_version","text":"v1"}'
        with query:
            query.reply_err(text, encoding="application/json")

    with Impostor(tmp_path, answer):
        fails(local(tmp_path), VersionMismatchError, "the daemon is of another version: v1")


def test_an_answer_that_does_not_come_is_a_timeout(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path) as (_, robot),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            robot.slow_until = asyncio.Event()
            await client.acquire()
            with pytest.raises(TimedOutError, match=r"within 0\.3 s"):
                await client.send(Load(trajectory={}), within_s=0.3)
            assert (await client.stop()).confirmed

    run_in_real_time(test())


def test_the_blocking_client_does_the_same(tmp_path: Path) -> None:
    """From another thread, with no event loop in sight."""

    def program() -> list[object]:
        with BlockingRobotClient(LocalAddress.in_folder(tmp_path)) as client:
            seen: list[object] = [client.me.role, client.status().state]
            try:
                client.arm()
            except RefusedError as error:
                seen.append(error.refusal.name)
            client.acquire()
            seen.append(client.arm().state)
            seen.append(next(client.messages(["tip"])))
            client.send_setpoint([1.0, 2.0, 100.0])
            client.load({"kind": "circle"})
            client.start()
            client.hold()
            client.resume()
            client.teleoperate()
            client.inject("x.y")
            client.clear()
            client.disarm()
            client.release()
            seen.append(client.stop().confirmed)
            assert client.connected
        client.close()
        return seen

    async def test() -> None:
        async with serving(tmp_path) as (server, robot):
            running = asyncio.create_task(asyncio.to_thread(program))
            await publish_until(server, tip(3), lambda: running.done())
            assert await running == ["operator", "STANDBY", "no_lease", "ARMED", tip(3), True]
            assert robot.verbs()[-1] == "stop"

    run_in_real_time(test())


def test_the_blocking_client_fails_with_the_same_reasons(tmp_path: Path) -> None:
    with pytest.raises(DaemonNotRunningError):
        BlockingRobotClient(local(tmp_path))


def test_importing_the_client_brings_nothing_heavy_along() -> None:
    modules = (
        "daemon.remote.client.client, daemon.remote.client.blocking_client, "
        "daemon.commands.client.stop"
    )
    heavy = "numpy scipy torch matplotlib numba pydantic rich yaml cryptography mcap"
    code = f"import sys, {modules}; print(sorted(set({heavy!r}.split()) & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout.strip() == "[]"


def test_messages_from_nowhere_are_not_offered(tmp_path: Path) -> None:
    async def test() -> None:
        async with (
            serving(tmp_path),
            await RobotClient.connect(local(tmp_path)) as client,
        ):
            with pytest.raises(ValueError, match="'cmd' is not published"):
                client.subscribe(["cmd"])
            assert Acquire().token == setpoint(1).token == ""

    run_in_real_time(test())
