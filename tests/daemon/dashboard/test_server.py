"""The page over real HTTP and a real wire, and every rule of it by a plain client."""

import asyncio
import json
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import NamedTuple

import aiohttp
import pytest
from aiohttp import web

from daemon.dashboard.experiments import ExperimentFiles
from daemon.dashboard.http_rules import LARGEST_BODY_BYTES, LOOPBACK_HOSTS, Rules, security_headers
from daemon.dashboard.recorded_runs import RecordedRuns
from daemon.dashboard.robot_link import HEARD_WITHIN_S, RobotLink
from daemon.dashboard.server import PageServer
from daemon.host.clock import run_in_real_time
from daemon.messages import Acquire, Answer, Command, Hold, Load, Refusal, Release
from tests.daemon.remote.rig import ROBOT, FakeRobot, serving, tip, until

OPERATOR, VIEWER = "operator-token", "viewer-token"
PAGE, OTHER = "a" * 32, "b" * 32


class Served(NamedTuple):
    http: aiohttp.ClientSession
    base: str
    link: RobotLink
    robot: FakeRobot
    cookie: str
    server: PageServer

    def sent(self, token: str = OPERATOR, **headers: str) -> dict[str, str]:
        cookie = {"Cookie": f"{self.cookie}={token}"} if token else {}
        return {
            "Origin": self.base,
            **cookie,
            **{k.replace("_", "-"): v for k, v in headers.items()},
        }

    async def post(self, path: str, token: str = OPERATOR, **body: object) -> tuple[int, str]:
        url, headers = self.base + path, self.sent(token)
        async with self.http.post(url, json={"robot": ROBOT, **body}, headers=headers) as got:
            return got.status, await got.text()

    async def do(self, verb: str, page: str = PAGE, **more: object) -> dict[str, object]:
        status, text = await self.post("/api/do", OPERATOR, verb=verb, page=page, **more)
        assert status == 200, text
        told: dict[str, object] = json.loads(text)
        return told

    def stream(self, page: str = PAGE, **headers: str) -> "aiohttp.client._WSRequestContextManager":
        url = f"{self.base}/ws?robot={ROBOT}&page={page}"
        return self.http.ws_connect(url, headers=self.sent(**headers))


@asynccontextmanager
async def served(folder: Path, lease_s: float = 2.0) -> AsyncIterator[Served]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = int(listening.getsockname()[1])
        rules = Rules(port, LOOPBACK_HOSTS, {OPERATOR: "operator", VIEWER: "viewer"})
        server = PageServer(rules, ExperimentFiles(folder), RecordedRuns([folder / "runs"]))
        robot = FakeRobot(lease_s)
        async with serving(folder, robot) as (remote, _):
            link = RobotLink(ROBOT, folder)
            server.serve(link)
            linking = asyncio.create_task(link.run())
            runner = web.AppRunner(server.app, access_log=None, shutdown_timeout=0.2)
            await runner.setup()
            await web.SockSite(runner, listening).start()

            async def tell() -> None:
                number = 0
                while True:
                    number += 1
                    remote.publish(tip(number))
                    remote.publish(robot.status())
                    await asyncio.sleep(0.03)

            telling = asyncio.create_task(tell())
            jar = aiohttp.DummyCookieJar()
            try:
                async with aiohttp.ClientSession(cookie_jar=jar) as http:
                    await until(lambda: not link.problem)
                    base = f"http://127.0.0.1:{port}"
                    yield Served(http, base, link, robot, rules.cookie, server)
            finally:
                telling.cancel()
                linking.cancel()
                await asyncio.gather(telling, linking, return_exceptions=True)
                await runner.cleanup()


def test_the_token_comes_once_in_the_address_and_is_a_cookie_from_then_on(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            assert (await page.http.get(page.base + "/")).status == 401
            assert (await page.http.get(page.base + "/?token=wrong")).status == 401
            got = await page.http.get(f"{page.base}/?token={OPERATOR}", allow_redirects=False)
            cookie = got.headers["Set-Cookie"]
            assert got.status == 303 and got.headers["Location"] == "/"
            assert page.cookie in cookie and "HttpOnly" in cookie and "SameSite=Strict" in cookie
            got = await page.http.get(page.base + "/", headers=page.sent())
            assert got.status == 200 and "STOP" in await got.text()
            assert "unsafe" not in got.headers["Content-Security-Policy"]
            for path in (
                "/api/robots",
                "/metrics",
                "/static/main.js",
                f"/api/experiments?robot={ROBOT}",
            ):
                assert (await page.http.get(page.base + path)).status == 401, path
                assert (await page.http.get(page.base + path, headers=page.sent())).status == 200

    run_in_real_time(test())


def test_a_browser_that_has_watched_becomes_an_operator_s_by_the_operator_s_address(
    tmp_path: Path,
) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            for before, token in ((VIEWER, OPERATOR), (OPERATOR, VIEWER)):
                url = f"{page.base}/?token={token}"
                got = await page.http.get(url, headers=page.sent(before), allow_redirects=False)
                assert got.status == 303 and got.headers["Location"] == "/"
                assert f"{page.cookie}={token};" in got.headers["Set-Cookie"]
            url = f"{page.base}/?token=wrong"
            got = await page.http.get(url, headers=page.sent(VIEWER), allow_redirects=False)
            assert got.status == 303 and "Set-Cookie" not in got.headers

    run_in_real_time(test())


def test_other_hosts_origins_kinds_and_sizes_are_refused_on_the_wire(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            get, evil = page.base + "/", "http://evil.example"
            assert (await page.http.get(get, headers=page.sent(Host="evil.example"))).status == 403
            assert (await page.http.get(get, headers=page.sent() | {"Origin": evil})).status == 403
            with pytest.raises(aiohttp.WSServerHandshakeError, match="403"):
                await page.http.ws_connect(
                    f"{page.base}/ws?robot={ROBOT}&page={PAGE}",
                    headers=page.sent() | {"Origin": evil},
                )
            stop, body = page.base + "/api/stop", json.dumps({"robot": ROBOT})
            plain = page.sent(Content_Type="text/plain")
            assert (await page.http.post(stop, data=body, headers=plain)).status == 415
            for method in ("DELETE", "PUT", "GET"):
                got = await page.http.request(method, stop, headers=page.sent())
                assert got.status == 405, method
            big = page.sent(Content_Type="application/json")
            got = await page.http.post(stop, data=b" " * (LARGEST_BODY_BYTES + 1), headers=big)
            assert got.status == 413
            assert (await page.post("/api/stop", token=""))[0] == 401
            for path in ("/static/../server.py", "/static/%2e%2e/server.py", "/static//etc/passwd"):
                assert (await page.http.get(page.base + path, headers=page.sent())).status == 404
            assert page.robot.stopped_ns == []

    run_in_real_time(test())


def test_a_page_that_says_too_much_at_once_is_not_listened_to(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page, page.stream() as stream:
            await stream.send_str("x" * 5000)
            async with asyncio.timeout(5.0):
                while (await stream.receive()).type is aiohttp.WSMsgType.BINARY:
                    pass
            assert stream.close_code == aiohttp.WSCloseCode.MESSAGE_TOO_BIG

    run_in_real_time(test())


def test_no_answer_is_without_the_headers_that_protect_the_page(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            wanted = security_headers()
            for path, sent, status in (
                ("/", page.sent(), 200),
                ("/static/main.js", page.sent(), 200),
                ("/api/robots", page.sent(), 200),
                ("/nothing", page.sent(), 404),
                ("/api/robots", {}, 401),
                ("/", page.sent(Host="evil.example"), 403),
                ("/?token=" + OPERATOR, {}, 303),
            ):
                got = await page.http.get(page.base + path, headers=sent, allow_redirects=False)
                assert got.status == status, path
                for name in ("Content-Security-Policy", "X-Content-Type-Options"):
                    assert got.headers.get(name) == wanted[name], (path, name)

    run_in_real_time(test())


def test_stop_needs_no_control_and_is_told_by_viewers_too(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            for token in (VIEWER, OPERATOR):
                status, text = await page.post("/api/stop", token=token)
                told = json.loads(text)
                assert status == 200 and told["outcome"] == "confirmed" and told["took_ms"] < 2000
            assert len(page.robot.stopped_ns) == 2
            assert (await page.post("/api/do", token=VIEWER, verb="take", page=PAGE))[0] == 403

    run_in_real_time(test())


def test_stop_has_a_line_of_its_own_that_is_open_before_it_is_wanted(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            url = f"{page.base}/stop"
            for headers, status in (
                (page.sent() | {"Origin": "http://evil.example"}, "403"),
                (page.sent(""), "401"),
            ):
                with pytest.raises(aiohttp.WSServerHandshakeError, match=status):
                    await page.http.ws_connect(url, headers=headers)
            async with page.http.ws_connect(url, headers=page.sent(VIEWER)) as line:
                await line.send_str("heart")
                await line.send_str(json.dumps({"robot": "nobody", "n": 1}))
                told = json.loads((await line.receive()).data)
                assert (told["n"], told["outcome"]) == (1, "no answer")
                assert page.robot.stopped_ns == []
                await line.send_str(json.dumps({"robot": ROBOT, "n": 2}))
                told = json.loads((await line.receive()).data)
                if "outcome" not in told:
                    assert told == {"n": 2, "sent": True}
                    told = json.loads((await line.receive()).data)
                assert (told["n"], told["outcome"]) == (2, "confirmed")
                assert len(page.robot.stopped_ns) == 1

    run_in_real_time(test())


def test_a_stop_that_nobody_answers_says_so(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            page.link._client, page.link.folder = None, tmp_path / "gone"
            told = json.loads((await page.post("/api/stop"))[1])
            assert told["outcome"] == "no answer" and told["text"]

    run_in_real_time(test())


def test_commands_are_for_the_page_in_control_and_another_can_take_over(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page:
            assert "take control first" in str((await page.do("arm"))["text"])
            assert (await page.do("take"))["ok"] and (await page.do("arm"))["ok"]
            refused = await page.do("take", OTHER)
            assert not refused["ok"] and "another page" in str(refused["text"])
            assert (await page.do("take", OTHER, over=True))["ok"]
            assert isinstance(page.robot.carried_out[-1][1], Hold), "what moves is held first"
            assert not (await page.do("arm"))["ok"] and (await page.do("arm", OTHER))["ok"]
            assert not (await page.do("nonsense", OTHER))["ok"]

    run_in_real_time(test())


def test_the_lease_lives_by_the_page_s_heart_and_ends_with_it(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 0.8) as page:
            now_ns = page.robot.clock.now_ns
            async with page.stream() as stream:
                assert (await page.do("take"))["ok"]
                for _ in range(20):
                    await stream.send_str("heart")
                    await asyncio.sleep(0.1)
                assert page.robot.lease.holder(now_ns()) == "local", "2 s of a lease of 0.8 s"
                # The socket stays open and is read, as of a tab that hangs.
                await until(lambda: page.robot.lease.holder(now_ns()) is None)

    run_in_real_time(test())


def test_nobody_but_the_page_s_heart_renews_the_lease(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 2.0) as page, page.stream() as stream:
            whole, asked = page.robot.handle, 0

            async def counted(user: str, command: Command) -> Answer | Refusal:
                nonlocal asked
                asked += isinstance(command, Acquire)
                return await whole(user, command)

            page.robot.handle = counted  # type: ignore[method-assign]
            assert (await page.do("take"))["ok"]
            for _ in range(10):
                await stream.send_str("heart")
                await asyncio.sleep(0.1)
            assert asked > 1, "each beat may renew it"
            await asyncio.sleep(2 * HEARD_WITHIN_S)
            by_heart = asked
            await asyncio.sleep(1.3)  # a client that renews by itself does so five times a lease
            assert asked == by_heart, "the server's client keeps no lease alive by itself"

    run_in_real_time(test())


def test_a_page_that_is_closed_gives_control_back(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page:
            async with page.stream() as stream:
                assert (await page.do("take"))["ok"]
                await stream.send_str("heart")
            await until(lambda: page.link.control.page == "")
            await until(lambda: page.robot.lease.holder(page.robot.clock.now_ns()) is None)

    run_in_real_time(test())


def test_what_a_page_that_leaves_gives_back_is_not_the_next_one_s(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path, 60.0) as page:
            assert (await page.do("take"))["ok"]
            whole, asked = page.robot.handle, asyncio.Event()

            async def slow(user: str, command: Command) -> Answer | Refusal:
                if isinstance(command, Release):
                    asked.set()
                    await asyncio.sleep(0.3)
                return await whole(user, command)

            page.robot.handle = slow  # type: ignore[method-assign]
            leaving = asyncio.create_task(page.do("give"))
            await asked.wait()
            assert (await page.do("take", OTHER))["ok"]
            await leaving
            assert (await page.do("arm", OTHER))["ok"], "it is in control and the daemon knows it"

    run_in_real_time(test())


def test_a_page_is_told_the_newest_and_buttons_for_itself(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page, page.stream() as stream:
            seen: dict[str, object] = {}
            while not {"tip", "status", "buttons"} <= seen.keys():
                seen |= json.loads((await stream.receive()).data)
            assert seen["problem"] == "" and seen["role"] == "operator" and not seen["in_control"]
            assert isinstance(seen["age_s"], float) and seen["age_s"] < 1.0

    run_in_real_time(test())


def test_several_robots_are_served_and_each_is_stopped_by_its_name(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            (tmp_path / "other").mkdir()
            page.server.serve(RobotLink("other_arm", tmp_path / "other"))
            got = await page.http.get(page.base + "/api/robots", headers=page.sent())
            told = {robot["name"]: robot for robot in await got.json()}
            assert told.keys() == {ROBOT, "other_arm"} and told["other_arm"]["problem"]
            stopped = json.loads((await page.post("/api/stop", robot="other_arm"))[1])
            assert stopped["outcome"] == "no answer" and page.robot.stopped_ns == []
            assert (await page.post("/api/stop", robot="nobody"))[0] == 404

    run_in_real_time(test())


def test_an_experiment_is_loaded_with_its_own_numbers_or_others(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(_OWN)

    async def test() -> None:
        async with served(tmp_path) as page:
            url = f"{page.base}/api/experiments?robot={ROBOT}"
            (told,) = await (await page.http.get(url, headers=page.sent())).json()
            named = {parameter["name"]: parameter for parameter in told["parameters"]}
            assert told["name"] == "mine" and named["radius_mm"]["value"] == 20.0
            assert named["plane"]["choices"] == ["xy", "xz", "yz"] and "kind" not in named
            assert (await page.do("take"))["ok"]
            assert (await page.do("load", experiment="mine"))["ok"]
            changed = {"radius_mm": 5, "cycles": 3}
            assert (await page.do("load", experiment="mine", parameters=changed))["ok"]
            loaded = [c for _, c in page.robot.carried_out if isinstance(c, Load)]
            assert [c.trajectory["radius_mm"] for c in loaded] == [20, 5]
            assert loaded[1].trajectory["cycles"] == 3
            assert loaded[1].controller == {"kind": "broyden"}
            refused = await page.do("load", experiment="mine", parameters={"file": "/etc/passwd"})
            assert not refused["ok"] and "no file" in str(refused["text"])
            for numbers in ([1], "x", {"kind": "waypoints"}):
                answer = await page.do("load", experiment="mine", parameters=numbers)
                assert answer["ok"] is not isinstance(numbers, dict), "what is no map is none"
            assert {
                c.trajectory["kind"] for _, c in page.robot.carried_out if isinstance(c, Load)
            } == {"circle"}

    run_in_real_time(test())


_OWN = """\
experiment: mine
robot: elsewhere/little_arm.yaml
trajectory: {kind: circle, center_mm: [0, 0, 190], radius_mm: 20, cycle_s: 30}
controller: {kind: broyden}
"""


def test_a_replay_is_found_behind_the_token(tmp_path: Path) -> None:
    async def test() -> None:
        async with served(tmp_path) as page:
            for token in (f"token={OPERATOR}&", ""):
                headers = {} if token else page.sent()
                url = f"{page.base}/?{token}replay=arm-1%2F..%26x"
                got = await page.http.get(url, headers=headers, allow_redirects=False)
                if token:
                    assert got.headers["Location"] == "/?replay=arm-1%2F..%26x"
                else:
                    assert got.status == 200

    run_in_real_time(test())
