"""The daemon's side, over real sessions: every question gets an answer, whatever it is."""

import asyncio
import json
from pathlib import Path
from typing import Any

import msgspec
import pytest

from config.remote import Remote
from daemon.host.clock import run_in_real_time
from daemon.messages import (
    COMMANDS,
    Acquire,
    Arm,
    Command,
    Event,
    Load,
    Refusal,
    Setpoint,
    SetpointRefused,
    Status,
    Stop,
    Tip,
    WhoAmI,
)
from daemon.remote.client.address import LocalAddress
from daemon.remote.discovery import (
    SecondDaemonError,
)
from daemon.remote.server.server import RemoteOpenError, RemoteServer
from daemon.remote.wire import decode, decode_one_of, encode, encoding_of
from daemon.service.lease import Lease
from tests.daemon.remote.rig import (
    ROBOT,
    FakeRobot,
    Raw,
    publish_until,
    raw,
    serving,
    setpoint,
    tip,
    until,
)

KEY = f"tentacled/{ROBOT}"


def event(text: str = "something") -> Event:
    return Event(sequence=1, t_ns=2, kind="note", name="note", subject="", present=True, text=text)


async def heard(client: Raw, server: RemoteServer, key: str, message: Tip | Event) -> list[bytes]:
    """Listen until the daemon knows it."""
    came = client.hear(key)
    await publish_until(server, message, lambda: came)
    return came


def test_what_is_published_is_heard_and_its_last_value_answered(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, _), raw(address(tmp_path)) as client:
            (reply,) = await client.get(f"{KEY}/tip")
            assert reply.refusal.name == "nothing_yet"
            came = await heard(client, server, f"{KEY}/tip", tip(4))
            assert decode(came[0], Tip) == tip(4)
            (reply,) = await client.get(f"{KEY}/tip")
            assert decode(reply.payload, Tip) == tip(4)
            assert reply.encoding == "application/msgpack;tentacled.tip/1"

    run_in_real_time(test())


def test_the_state_is_the_newest_there_is_and_may_be_had_as_json(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            robot.state = "HOLD"
            by_encoding = await client.get(f"{KEY}/state", encoding="application/json")
            by_parameter = await client.get(f"{KEY}/state?encoding=json")
            for reply in by_encoding + by_parameter:
                assert reply.encoding == "application/json;tentacled.status/1"
                status = json.loads(reply.payload)
                assert (status["type"], status["state"]) == ("status/1", "HOLD")
            (reply,) = await client.get(f"{KEY}/state")
            assert decode(reply.payload, Status).state == "HOLD"

    run_in_real_time(test())


def test_a_command_may_be_json_by_its_encoding_or_by_its_key(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            said, packed = b' {"type": "stop/1"}', msgspec.msgpack.encode({"type": "acquire/1"})
            command = b'{"type": "acquire/1", "request": "7"}'
            key = f"{KEY}/cmd/local/acquire"
            for asked, payload, encoding in (
                (f"{key}?encoding=json", command, ""),
                (key, command, "application/json"),
                (f"{key}?encoding=json", packed, ""),
                (f"{key}?encoding=json", packed, "application/msgpack"),
            ):
                robot.lease = Lease(60.0)
                (reply,) = await client.get(asked, payload, encoding)
                assert json.loads(reply.payload)["type"] == "answer/1", reply
            (reply,) = await client.get(f"{key}?encoding=json", said)
            assert "'acquire/1' belongs here" in json.loads(reply.payload)["text"]

    run_in_real_time(test())


def test_schemas_are_served_one_by_one_and_all_together(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as _, raw(address(tmp_path)) as client:
            (reply,) = await client.get(f"{KEY}/schema/tip")
            assert json.loads(reply.payload)["properties"]["type"]["enum"] == ["tip/1"]
            everything = await client.get(f"{KEY}/schema/*")
            titles = {json.loads(reply.payload)["title"] for reply in everything}
            assert {"Status", "Tip", "Setpoint", "Arm", "Answer", "Refusal"} <= titles
            (reply,) = await client.get(f"{KEY}/schema/nothing")
            assert reply.refusal.name == "bad_key"

    run_in_real_time(test())


def test_whoever_comes_by_the_socket_is_an_operator(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as _, raw(address(tmp_path)) as client:
            (reply,) = await client.get(f"{KEY}/whoami/local")
            assert decode(reply.payload, WhoAmI) == WhoAmI(
                robot=ROBOT, version="1.2.3", role="operator", simulated=True
            )
            assert await client.get(f"{KEY}/whoami/alice") == []

    run_in_real_time(test())


def test_a_command_is_carried_out_and_answered(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            (reply,) = await client.ask("local", Arm(request="1"))
            assert reply.refusal.name == "no_lease"
            assert reply.refusal.request == "1"
            (reply,) = await client.ask("local", Acquire())
            token = reply.answer.token
            (reply,) = await client.ask("local", Arm(request="2", token=token))
            assert (reply.answer.request, reply.answer.state) == ("2", "ARMED")
            assert robot.carried_out == [("local", Arm(request="2", token=token))]
            as_json = b'{"type":"hold/1","request":"3","token":"' + token.encode() + b'"}'
            (reply,) = await client.get(f"{KEY}/cmd/local/hold", as_json, "application/json")
            assert json.loads(reply.payload)["request"] == "3"

    run_in_real_time(test())


@pytest.mark.parametrize(
    ("verb", "payload", "name", "text"),
    [
        ("arm", b"", "bad_payload", "the payload is empty"),
        ("arm", b"\xc1", "bad_payload", "this is no application/msgpack"),
        ("arm", encode(Stop()), "bad_payload", "'arm/1' belongs here, not 'stop/1'"),
        ("arm", msgspec.msgpack.encode({"type": "arm/2"}), "bad_version", "version 1 of 'arm'"),
        ("arm", encode(Arm(token="x" * 5000)), "bad_payload", "bytes are more than"),
        ("fly", encode(Arm()), "bad_key", "there is no such command"),
        ("*", encode(Arm()), "bad_key", "there is no such command"),
        (
            "load",
            encode(Load(trajectory={"mm": [float("nan")]})),
            "bad_payload",
            "nan is not a finite number at $.trajectory.mm[0]",
        ),
    ],
)
def test_what_is_no_command_is_refused_and_says_why(
    tmp_path: Path, verb: str, payload: bytes, name: str, text: str
) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            (reply,) = await client.get(f"{KEY}/cmd/local/{verb}", payload)
            assert reply.refusal.name == name
            assert text in reply.refusal.text
            assert robot.carried_out == []

    run_in_real_time(test())


@pytest.mark.parametrize("key", [f"{KEY}/**", "**", f"{KEY}/cmd/**", f"{KEY}/cmd/*/*", f"{KEY}/*"])
def test_a_wildcard_commands_nothing_and_reads_nothing(tmp_path: Path, key: str) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            robot.state = "RUNNING"
            assert await client.get(key, encode(Stop())) == []
            assert await client.get(key) == []
            assert (robot.state, robot.carried_out) == ("RUNNING", [])

    run_in_real_time(test())


def test_a_handler_that_breaks_says_so_and_the_next_command_works(tmp_path: Path) -> None:
    async def test() -> None:
        told: list[dict[str, Any]] = []
        asyncio.get_running_loop().set_exception_handler(lambda _, context: told.append(context))
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            robot.fails = True
            (reply,) = await client.ask("local", Stop(request="1"))
            assert reply.refusal.name == "internal"
            assert reply.refusal.text == "RuntimeError: the handler is broken"
            assert "the handler is broken" in str(told[0]["exception"])
            robot.fails = False
            (reply,) = await client.ask("local", Stop(request="2"))
            assert reply.answer.request == "2"

    run_in_real_time(test())


def test_a_stop_does_not_wait_for_a_command_that_takes_for_ever(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            robot.slow_until = asyncio.Event()
            token = (await client.ask("local", Acquire()))[0].answer.token
            load = Load(trajectory={}, token=token)
            waiting = [asyncio.create_task(client.ask("local", load)) for _ in range(30)]
            await until(lambda: any(task.done() for task in waiting))
            (reply,) = await client.ask("local", Stop(request="s"))
            assert reply.answer.request == "s"
            robot.slow_until.set()
            replies = [(await task)[0] for task in waiting]
            assert all(reply.refusal.name == "busy" for reply in replies if reply.refused)
            assert any(reply.refused for reply in replies)
            assert robot.verbs().count("load") == sum(not reply.refused for reply in replies)

    run_in_real_time(test())


def test_set_points_come_in_and_bad_ones_are_published_with_the_reason(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, robot), raw(address(tmp_path)) as client:
            came = await heard(client, server, f"{KEY}/event", event())
            client.stream("local", setpoint(5))
            await until(lambda: robot.setpoints)
            assert robot.setpoints == [("local", setpoint(5))]
            client.stream("local", setpoint(5))
            stale = await refusal(came)
            assert stale == SetpointRefused(
                sequence=5, reason="not newer than the last", user="local"
            )
            client.stream("local", setpoint(6, x_mm=float("nan")))
            assert "nan is not a finite number at $.position_mm[0]" in (await refusal(came)).reason
            client.session.put(client.keys.setpoint("local"), b"")
            assert (await refusal(came)).reason == "the payload is empty"
            client.session.put(client.keys.setpoint("local"), b"x" * 2000)
            assert "2000 bytes are more than 1024" in (await refusal(came)).reason
            assert len(robot.setpoints) == 1
            (reply,) = await client.get(f"{KEY}/event")
            assert decode(reply.payload, Event) == event()

    async def refusal(came: list[bytes]) -> SetpointRefused:
        def newest() -> SetpointRefused | None:
            while came:
                message = decode_one_of(came.pop(0), (Event, SetpointRefused))
                if isinstance(message, SetpointRefused):
                    return message
            return None

        found: list[SetpointRefused] = []

        def look() -> bool:
            message = newest()
            if message is not None:
                found.append(message)
            return message is not None

        await until(look)
        await asyncio.sleep(0.02)  # what comes quicker than any client should send is thinned out
        return found[0]

    run_in_real_time(test())


def test_a_stream_of_bad_set_points_does_not_become_a_stream_of_events(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, robot), raw(address(tmp_path)) as client:
            came = await heard(client, server, f"{KEY}/event", event())
            client.stream("local", setpoint(1_000_000))
            await until(lambda: robot.setpoints)
            came.clear()
            loop = asyncio.get_running_loop()
            start_s = loop.time()
            for number in range(100):
                client.stream("local", setpoint(number))
                await asyncio.sleep(0.005)
            await until(lambda: came)
            assert len(came) <= 3 + (loop.time() - start_s) / 0.5

    run_in_real_time(test())


def test_a_set_point_that_breaks_the_handler_is_refused(tmp_path: Path) -> None:
    class Breaking(FakeRobot):
        def setpoint(self, user: str, setpoint: Setpoint) -> SetpointRefused | None:
            raise RuntimeError("broken")

    async def test() -> None:
        asyncio.get_running_loop().set_exception_handler(lambda *_: None)
        async with serving(tmp_path, Breaking()) as (server, _), raw(address(tmp_path)) as client:
            came = await heard(client, server, f"{KEY}/event", event())
            came.clear()
            client.stream("local", setpoint(1))
            await until(lambda: any(b"internal" in message for message in came))

    run_in_real_time(test())


def test_a_second_daemon_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot):
            with pytest.raises(SecondDaemonError, match="a daemon is running in"):
                async with serving(tmp_path):
                    pass
            async with raw(address(tmp_path)) as client:
                assert (await client.ask("local", Stop()))[0].answer
                assert robot.verbs() == ["stop"]
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            assert (await client.ask("local", Stop()))[0].answer

    run_in_real_time(test())


def test_closing_refuses_what_is_in_hand_leaves_nothing_behind_and_may_be_repeated(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        folder = tmp_path / "run"
        async with serving(folder) as (server, robot), raw(address(folder)) as client:
            robot.slow_until = asyncio.Event()
            token = (await client.ask("local", Acquire()))[0].answer.token
            waiting = asyncio.create_task(
                client.ask("local", Load(trajectory={}, token=token, request="7"))
            )
            await until(lambda: server._desk._in_hand["local"])
            await server.close()
            (reply,) = await waiting
            assert (reply.refusal.name, reply.refusal.request) == ("closing", "7")
            await until(lambda: not list(folder.iterdir()), "an empty folder")
            await server.close()
            server.publish(tip())

    run_in_real_time(test())


def test_publishing_before_and_after_is_no_error(tmp_path: Path) -> None:
    async def test() -> None:
        server = RemoteServer(
            ROBOT, Remote(), tmp_path, FakeRobot(), simulated=True, version="1.2.3"
        )
        server.publish(tip())
        await server.close()
        server.publish(tip())

    run_in_real_time(test())


def test_what_cannot_be_opened_is_told_and_leaves_the_folder_free(tmp_path: Path) -> None:
    async def test() -> None:
        deep = tmp_path / ("x" * 100)
        with pytest.raises(RemoteOpenError, match="must be shorter"):
            async with serving(deep):
                pass
        missing = Remote.model_validate(
            {
                "tls": {"endpoint": "127.0.0.1:7448", "certificates": str(tmp_path)},
                "users": {"alice": "operator"},
            }
        )
        with pytest.raises(RemoteOpenError, match=r"there is no .*ca.pem"):
            async with serving(tmp_path / "run", settings=missing):
                pass
        async with serving(tmp_path / "run"):
            pass

    run_in_real_time(test())


def test_the_longest_path_that_a_socket_may_have_works(tmp_path: Path) -> None:
    async def test() -> None:
        left = 107 - len(str(tmp_path / "x" / "zenoh.sock"))
        folder = tmp_path / ("x" * (left + 1))
        async with serving(folder) as _, raw(address(folder)) as client:
            assert len(str(folder / "zenoh.sock")) == 107
            assert (await client.ask("local", Stop()))[0].answer

    run_in_real_time(test())


def test_without_socket_and_users_there_is_nothing_to_open(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path / "run", settings=Remote(unix_socket=False)) as (server, _):
            server.publish(tip())
            assert not (tmp_path / "run").exists()

    run_in_real_time(test())


def test_a_refusal_tells_the_state_the_robot_was_in(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, robot), raw(address(tmp_path)) as client:
            server.publish(robot.status())
            (reply,) = await client.get(f"{KEY}/cmd/local/arm", b"")
            assert reply.refusal.state == "STANDBY"
            assert reply.encoding == encoding_of(Refusal)

    run_in_real_time(test())


def address(folder: Path) -> LocalAddress:
    return LocalAddress(ROBOT, folder / "zenoh.sock")


def test_commands_of_all_kinds_reach_the_handler(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            token = (await client.ask("local", Acquire()))[0].answer.token
            for kind in COMMANDS:
                if kind is not Acquire:
                    (reply,) = await client.ask("local", _made(kind, token))
                    assert not reply.refused, reply.refusal
                if kind.__name__ == "Release":
                    token = (await client.ask("local", Acquire()))[0].answer.token
            assert len(robot.carried_out) == len(COMMANDS) - 1

    def _made(kind: type[Command], token: str) -> Command:
        part = {"name": "a.stl", "sha256": "", "size_bytes": 1, "offset": 0, "data": b"x"}
        content: dict[str, Any] = {"token": token, "trajectory": {}, "fault": "x.y=1", **part}
        content["to_mm"] = [1.0, 2.0, 3.0]
        fields = set(kind.__struct_fields__)
        return kind(**{key: value for key, value in content.items() if key in fields})

    run_in_real_time(test())


def test_set_points_that_nobody_can_write_again_are_refused_and_not_reported(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, robot), raw(address(tmp_path)) as client:
            told: list[object] = []
            asyncio.get_running_loop().set_exception_handler(lambda _, what: told.append(what))
            came = await heard(client, server, f"{KEY}/event", event())
            for number in range(200):
                text = json.dumps({**JSON_SETPOINT, "sequence": 2**64 + number})
                client.session.put(client.keys.setpoint("local"), text, encoding="application/json")
                await asyncio.sleep(0.001)
            await until(lambda: any(b"so many digits" in message for message in came))
            client.stream("local", setpoint(1))
            await until(lambda: robot.setpoints)
            assert told == []

    run_in_real_time(test())


def test_an_error_that_comes_again_and_again_is_reported_now_and_then(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (_, robot), raw(address(tmp_path)) as client:
            told: list[object] = []
            asyncio.get_running_loop().set_exception_handler(lambda _, what: told.append(what))
            robot.fails = True
            for _ in range(50):
                (reply,) = await client.ask("local", Arm())
                assert reply.refusal.name == "internal"
            assert len(told) == 1

    run_in_real_time(test())


def test_what_cannot_be_written_does_not_stop_who_publishes_it(tmp_path: Path) -> None:
    async def test() -> None:
        async with serving(tmp_path) as (server, _):
            told: list[object] = []
            asyncio.get_running_loop().set_exception_handler(lambda _, what: told.append(what))
            server.publish(SetpointRefused(sequence=2**70, reason="it is too large"))
            assert len(told) == 1

    run_in_real_time(test())


JSON_SETPOINT = {
    "type": "setpoint/1",
    "token": "",
    "position_mm": [0.0, 0.0, 190.0],
    "valid_s": 0.2,
}
