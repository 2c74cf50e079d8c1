"""Who may send and see what, over real sessions: role by role, key by key, message by message."""

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

import pytest
import zenoh

from daemon.host.clock import run_in_real_time
from daemon.messages import COMMANDS, Acquire, Stop, Tip, WhoAmI, verb
from daemon.remote.client.address import Address
from daemon.remote.client.client_errors import ClientError, RefusedError
from daemon.remote.keys import ANY_ROBOT_ALIVE
from daemon.remote.wire import decode, encode
from tests.daemon.remote.over_tls import STRANGER, Served, make_certificates, serving_all
from tests.daemon.remote.rig import ROBOT, Raw, publish_until, raw, setpoint, tip, until

KEY = f"tentacled/{ROBOT}"
VERBS = [verb(kind) for kind in COMMANDS]
TELEMETRY = ["state", "tip", "axes", "risk", "loop", "event", "body"]
OPERATORS = ["local", "alice", "dora"]
EVERYBODY = [*OPERATORS, "bob"]


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_certificates(tmp_path_factory.mktemp("certificates") / "all")


def address(served: Served, user: str) -> Address:
    return served.local if user == "local" else served.remote(user)


async def heard_by(client: Raw, served: Served, key: str) -> list[bytes]:
    """Listen to a telemetry key until the daemon knows it."""
    came = client.hear(key)
    await publish_until(served.server, tip(), lambda: came)
    came.clear()
    return came


async def in_order(served: Served, watcher: Raw, came: list[bytes], number: int) -> None:
    """Wait until what was sent before has arrived, if it ever does: `number` is seen after it."""
    served.server.publish(tip(number))
    await until(lambda: any(decode(message, Tip).sequence == number for message in came))


@pytest.mark.parametrize("user", EVERYBODY)
def test_everybody_who_is_listed_sees_all_telemetry_and_knows_his_role(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with serving_all(tmp_path, certificates) as served:
            served.server.publish(tip(7))
            async with raw(address(served, user)) as client:
                (reply,) = await client.get(f"{KEY}/whoami/{user}")
                role = decode(reply.payload, WhoAmI).role
                assert role == ("operator" if user in OPERATORS else "viewer")
                for name in TELEMETRY:
                    (reply,) = await client.get(f"{KEY}/{name}")
                    assert name in ("state", "tip") or reply.refusal.name == "nothing_yet"
                assert len(await client.get(f"{KEY}/schema/*")) > len(COMMANDS)
                await heard_by(client, served, f"{KEY}/tip")
                alive = client.session.liveliness().get(ANY_ROBOT_ALIVE, timeout=20.0)
                keys = await asyncio.to_thread(
                    lambda: [str(reply.ok.key_expr) for reply in alive if reply.ok]
                )
                assert keys == [f"{KEY}/alive"]

    run_in_real_time(test())


@pytest.mark.parametrize("user", EVERYBODY)
def test_a_user_commands_under_his_own_name_only_and_a_viewer_not_at_all(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            raw(address(served, user)) as client,
        ):
            for other in [*EVERYBODY, STRANGER]:
                for word in VERBS:
                    replies = await client.get(f"{KEY}/cmd/{other}/{word}", encode(Stop()))
                    assert bool(replies) == (other == user and user in OPERATORS), (other, word)
                if other != user:
                    assert await client.get(f"{KEY}/whoami/{other}") == []
            commanded = [("stop", user)] if user in OPERATORS else []
            assert [(verb(c), who) for who, c in served.robot.carried_out] == commanded

    run_in_real_time(test())


@pytest.mark.parametrize("user", EVERYBODY)
def test_set_points_count_under_the_own_name_only_and_a_viewers_never(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            raw(address(served, user)) as client,
            raw(served.local) as watcher,
        ):
            came = await heard_by(watcher, served, f"{KEY}/tip")
            for number, other in enumerate(EVERYBODY):
                client.stream(other, setpoint(100 * number))
                await asyncio.sleep(0.01)
            (reply,) = await client.get(f"{KEY}/state")  # on the same way, behind the set-points
            assert not reply.refused
            await in_order(served, watcher, came, 99)
            who = [who for who, _ in served.robot.setpoints]
            assert who == ([user] if user in OPERATORS else [])

    run_in_real_time(test())


@pytest.mark.parametrize("user", EVERYBODY)
def test_nobody_can_put_telemetry_of_his_own_making(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            raw(address(served, user)) as client,
            raw(served.local) as watcher,
        ):
            await heard_by(watcher, served, f"{KEY}/tip")
            came = {name: watcher.hear(f"{KEY}/{name}") for name in TELEMETRY}
            for name in TELEMETRY:
                for number in range(10):
                    client.session.put(f"{KEY}/{name}", encode(tip(1000 + number)))
                    client.session.delete(f"{KEY}/{name}")
            await client.get(f"{KEY}/state")  # on the same way, behind what was put
            await watcher.get(f"{KEY}/state")
            for name, messages in came.items():
                assert not any(decode(one, Tip).sequence >= 1000 for one in messages), name

    run_in_real_time(test())


@pytest.mark.parametrize("user", EVERYBODY)
def test_nobody_can_answer_in_the_daemons_place_or_listen_to_others_commands(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with (
            serving_all(tmp_path, certificates) as served,
            raw(address(served, user)) as spy,
            raw(served.remote("dora")) as victim,
        ):
            asked: list[str] = []
            heard = spy.hear("**")

            def reply(query: zenoh.Query) -> None:
                asked.append(str(query.key_expr))
                with query:
                    query.reply_err(b"spoofed")

            for key in ("**", f"{KEY}/**", f"{KEY}/cmd/dora/stop", f"{KEY}/state", f"{KEY}/x"):
                callback = zenoh.handlers.Callback(reply, indirect=False)
                spy.session.declare_queryable(
                    key, callback, complete=True, allowed_origin=zenoh.Locality.REMOTE
                )
            token = spy.session.liveliness().declare_token("tentacled/other/alive")
            await spy.get(f"{KEY}/whoami/{user}")  # on the same way, behind what was declared
            for _ in range(5):
                assert (await victim.ask("dora", Acquire()))[0].payload != b"spoofed"
                assert (await victim.ask("dora", Stop()))[0].answer
                victim.stream("dora", setpoint(1))
                assert not (await victim.get(f"{KEY}/state"))[0].refused
                assert await victim.get(f"{KEY}/x") == []
            alive = victim.session.liveliness().get(ANY_ROBOT_ALIVE, timeout=20.0)
            keys = await asyncio.to_thread(
                lambda: [str(one.ok.key_expr) for one in alive if one.ok]
            )
            assert keys == [f"{KEY}/alive"]
            await until(lambda: served.robot.setpoints)
            assert (asked, heard) == ([], [])
            token.undeclare()  # type: ignore[no-untyped-call]

    run_in_real_time(test())


def test_a_good_certificate_of_somebody_who_is_not_listed_gets_nothing(
    tmp_path: Path, certificates: Path
) -> None:
    async def test() -> None:
        async with serving_all(tmp_path, certificates) as served:
            stranger = served.remote(STRANGER)
            config = zenoh.Config.from_json5(json.dumps(stranger.config(0.0)))
            with pytest.raises(zenoh.ZError):
                await asyncio.to_thread(zenoh.open, config)
            with pytest.raises(ClientError):
                await stranger.stop("", 20.0)
            assert "does not know the user" in str(await asyncio.to_thread(stranger.why_not))
            assert (served.robot.carried_out, served.robot.stopped_ns) == ([], [])

    run_in_real_time(test())


@pytest.mark.parametrize("user", EVERYBODY)
def test_stop_by_its_own_way_is_for_who_may_command(
    tmp_path: Path, certificates: Path, user: str
) -> None:
    async def test() -> None:
        async with serving_all(tmp_path, certificates) as served:
            if user in OPERATORS:
                assert (await address(served, user).stop("9", 20.0)).request == "9"
                assert len(served.robot.stopped_ns) == 1
                assert [(verb(c), who) for who, c in served.robot.carried_out] == [("stop", user)]
            else:
                with pytest.raises(RefusedError) as refused:
                    await address(served, user).stop("9", 20.0)
                assert refused.value.refusal.name == "not_permitted"
                assert served.robot.stopped_ns == []

    run_in_real_time(test())


@pytest.mark.parametrize("attempt", ["no certificate", "no tls", "foreign", "foreign authority"])
def test_who_cannot_show_a_good_certificate_is_not_let_in(
    tmp_path: Path, certificates: Path, attempt: str
) -> None:
    async def test() -> None:
        foreign = make_certificates(tmp_path / "foreign")
        async with serving_all(tmp_path / "run", certificates) as served:
            configs: dict[str, Callable[[], dict[str, object]]] = {
                "no certificate": lambda: _without_certificate(served),
                "no tls": lambda: _plain(served),
                "foreign": lambda: _foreign(served, foreign),
                "foreign authority": lambda: served.remote("alice", foreign).config(0.0),
            }
            config = zenoh.Config.from_json5(json.dumps(configs[attempt]()))
            with pytest.raises(zenoh.ZError):
                await asyncio.to_thread(zenoh.open, config)
            async with raw(served.remote("alice")) as client:
                assert (await client.ask("alice", Stop()))[0].answer

    run_in_real_time(test())


def _without_certificate(served: Served) -> dict[str, object]:
    config = served.remote("alice").config(0.0)
    tls = config["transport"]["link"]["tls"]
    for name in ("connect_certificate", "connect_private_key", "enable_mtls"):
        del tls[name]
    return config


def _plain(served: Served) -> dict[str, object]:
    config = served.remote("alice").config(0.0)
    config["connect"]["endpoints"] = [f"tcp/127.0.0.1:{served.port}"]
    config["transport"]["link"]["protocols"] = ["tcp", "tls"]
    return config


def _foreign(served: Served, folder: Path) -> dict[str, object]:
    """The right authority believed, but the own certificate signed by another one."""
    config = served.remote("alice", folder).config(0.0)
    config["transport"]["link"]["tls"]["root_ca_certificate"] = str(served.certificates / "ca.pem")
    return config
