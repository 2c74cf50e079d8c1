"""The page's web server: files, one stream for each page, and commands, behind the rules."""

import asyncio
import re
from collections.abc import Awaitable, Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import msgspec
from aiohttp import WSMsgType, web

from daemon.dashboard.experiments import ExperimentFiles
from daemon.dashboard.http_rules import (
    IMPORT_MAP,
    LARGEST_BODY_BYTES,
    Asked,
    Rules,
    may,
    security_headers,
)
from daemon.dashboard.metrics import metrics
from daemon.dashboard.page_socket import PageSocket
from daemon.dashboard.recorded_runs import RecordedRuns
from daemon.dashboard.robot_link import RobotLink
from daemon.dashboard.run_pages import RunPages
from daemon.dashboard.stop_lines import outcome_of
from daemon.dashboard.stop_process import StopProcess
from daemon.messages import Answer
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError, RefusedError

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]

_ROLE: Final = web.RequestKey("role", str)
_LARGEST_MESSAGE_BYTES: Final = 4096
_PAGE: Final = re.compile(r"[0-9a-f]{16,64}")
_STATIC: Final = Path(str(files("daemon.dashboard") / "static"))
_TYPES: Final = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_VERBS: Final[dict[str, Callable[[RobotClient], Awaitable[Answer]]]] = {
    "arm": lambda client: client.arm(),
    "home": lambda client: client.home(),
    "disarm": lambda client: client.disarm(),
    "start": lambda client: client.start(),
    "hold": lambda client: client.hold(),
    "resume": lambda client: client.resume(),
    "clear": lambda client: client.clear(),
}


class PageServer:
    """Serves the robots that it is told of."""

    def __init__(
        self, rules: Rules, experiments: ExperimentFiles, runs: RecordedRuns | None = None
    ) -> None:
        """runs: recordings that may be replayed and fetched."""
        self.links: dict[str, RobotLink] = {}
        self._rules = rules
        self._experiments = experiments
        self._runs = RunPages(RecordedRuns() if runs is None else runs)
        self._stops = StopProcess()
        self._files = _read_static()
        self.app = web.Application(client_max_size=LARGEST_BODY_BYTES, middlewares=[self._guarded])
        self.app.add_routes(
            [
                web.get("/", self._index),
                web.get("/static/{name:.+}", self._static),
                web.get("/ws", self._stream),
                web.get("/stop", self._stops.take),
                web.get("/api/me", self._me),
                web.get("/api/robots", self._robots),
                web.get("/api/experiments", self._list_experiments),
                web.get("/api/controllers", self._controllers),
                web.get("/api/surroundings.stl", self._mesh),
                web.get("/metrics", self._metrics),
                web.post("/api/stop", self._stop),
                web.post("/api/do", self._do),
                web.post("/api/report", self._report),
                *self._runs.routes(),
            ]
        )
        self.app.on_startup.append(self._started)
        self.app.on_cleanup.append(self._ended)

    def serve(self, link: RobotLink) -> None:
        """One robot more."""
        self.links[link.name] = link
        self._stops.robots({name: one.folder for name, one in self.links.items()})

    async def _started(self, app: web.Application) -> None:
        del app
        await self._stops.start()

    async def _ended(self, app: web.Application) -> None:
        del app
        await self._stops.close()

    @web.middleware
    async def _guarded(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        asked = Asked(
            request.method,
            request.path,
            {name.lower(): value for name, value in request.headers.items()},
            dict(request.cookies),
            request.headers.get("Upgrade", "").lower() == "websocket",
        )
        refused = self._rules.refusal(asked)
        role = self._rules.role(asked)
        if refused is not None:
            return _plain(refused.status, refused.text)
        arrives = request.method == "GET" and request.path == "/"
        if arrives and (role is None or self._known(request)):
            return self._let_in(request)
        if role is None:
            return _plain(401, "open the address that `tentacled dashboard` has printed")
        request[_ROLE] = role
        try:
            response = await handler(request)
        except web.HTTPException as error:
            return _plain(error.status, error.reason)
        if not response.prepared:
            for name, value in security_headers().items():
                response.headers.setdefault(name, value)
        return response

    def _known(self, request: web.Request) -> bool:
        """Whether a token in the address gives a role: it counts before that of a cookie."""
        return self._rules.role_of(request.query.get("token", "")) is not None

    def _let_in(self, request: web.Request) -> web.Response:
        """The token comes once in the address, and is a cookie from then on."""
        if not self._known(request):
            return _plain(401, "open the address that `tentacled dashboard` has printed")
        token = request.query["token"]
        response = web.Response(
            status=303, headers={**security_headers(), "Location": _home(request)}
        )
        response.set_cookie(
            self._rules.cookie,
            token,
            httponly=True,
            samesite="Strict",
            secure=self._rules.secure,
            path="/",
        )
        return response

    # Files.

    async def _index(self, request: web.Request) -> web.StreamResponse:
        if "token" in request.query:
            return web.Response(status=303, headers={"Location": _home(request)})
        return self._file("index.html")

    async def _static(self, request: web.Request) -> web.StreamResponse:
        return self._file(request.match_info["name"])

    def _file(self, name: str) -> web.Response:
        content = self._files.get(name)
        if content is None:
            return _plain(404, "there is no such file")
        kind = _TYPES.get(Path(name).suffix, "text/plain")
        return web.Response(body=content, content_type=kind, charset="utf-8")

    # Telling.

    async def _me(self, request: web.Request) -> web.Response:
        return _json({"role": request[_ROLE]})

    async def _robots(self, request: web.Request) -> web.Response:
        del request
        told = [
            {
                "name": name,
                "problem": link.problem,
                "state": link.status.state if link.status else "",
            }
            for name, link in sorted(self.links.items())
        ]
        return _json(told)

    async def _list_experiments(self, request: web.Request) -> web.Response:
        return _json(self._experiments.offered(self._link(request.query.get("robot")).name))

    async def _controllers(self, request: web.Request) -> web.Response:
        return _json(self._experiments.controllers(self._link(request.query.get("robot")).name))

    async def _mesh(self, request: web.Request) -> web.Response:
        mesh = self._link(request.query.get("robot")).surroundings[1]
        return web.Response(body=mesh, content_type="model/stl")

    async def _metrics(self, request: web.Request) -> web.Response:
        del request
        text = metrics((name, link.status) for name, link in sorted(self.links.items()))
        return web.Response(text=text, content_type="text/plain")

    async def _stream(self, request: web.Request) -> web.StreamResponse:
        link, page = self._link(request.query.get("robot")), _page(request.query.get("page"))
        socket = web.WebSocketResponse(max_msg_size=_LARGEST_MESSAGE_BYTES, heartbeat=5.0)
        await socket.prepare(request)
        assert request.transport is not None
        told = PageSocket(socket, link, page, request[_ROLE])
        feeding = asyncio.create_task(told.feed(request.transport))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    told.hear(message.data)
        finally:
            feeding.cancel()
            await asyncio.gather(feeding, return_exceptions=True)
            await link.give_control(page)
        return socket

    # Doing.

    async def _stop(self, request: web.Request) -> web.Response:
        asked = await _body(request)
        return _json(await outcome_of(self._link(asked.get("robot")).stop()))

    async def _do(self, request: web.Request) -> web.Response:
        asked = await _body(request)
        verb, page = str(asked.get("verb")), _page(asked.get("page"))
        link = self._link(asked.get("robot"))
        if not may(request[_ROLE], verb):
            return _plain(403, "viewers only watch")
        try:
            return _json(await self._done(link, page, verb, asked))
        except RefusedError as error:
            reasons = [{"text": r.text, "remedy": r.remedy} for r in error.refusal.reasons]
            return _json({"ok": False, "text": error.refusal.text, "reasons": reasons})
        except (ClientError, PermissionError, ValueError) as error:
            return _json({"ok": False, "text": str(error)})

    async def _report(self, request: web.Request) -> web.Response:
        asked = await _body(request)
        if not may(request[_ROLE], "report"):
            return _plain(403, "viewers only watch")
        why = await self._runs.make_report(str(asked.get("run")))
        return _json({"ok": not why, "text": why})

    async def _done(
        self, link: RobotLink, page: str, verb: str, asked: dict[str, Any]
    ) -> dict[str, Any]:
        if verb == "take":
            if link.control.page not in ("", page) and not asked.get("over"):
                return {"ok": False, "text": "another page is in control"}
            why = await link.take_control(page)
            return {"ok": not why, "text": why}
        if verb == "give":
            await link.give_control(page)
            return {"ok": True, "text": ""}
        if verb == "load":
            named, parameters = str(asked.get("experiment")), asked.get("parameters")
            numbers = parameters if isinstance(parameters, dict) else None
            found = self._experiments.load(link.name, named, numbers)
            if found is None:
                return {"ok": False, "text": "there is no such experiment for this robot"}
            answer = await link.do(page, lambda client: client.load(*found))
        elif verb == "teleoperate":
            controller = self._experiments.controller(link.name, str(asked.get("controller", "")))
            answer = await link.do(page, lambda client: client.teleoperate(controller))
        elif verb in _VERBS:
            answer = await link.do(page, _VERBS[verb])
        else:
            return {"ok": False, "text": f"there is no '{verb}' here"}
        return {"ok": True, "text": answer.text, "state": answer.state}

    def _link(self, name: object) -> RobotLink:
        if not isinstance(name, str) or name not in self.links:
            raise web.HTTPNotFound(reason="there is no such robot here")
        return self.links[name]


def _home(request: web.Request) -> str:
    """The page, with the recording that is to be replayed and without the token."""
    replay = request.query.get("replay", "")
    return f"/?replay={quote(replay, safe='')}" if replay else "/"


async def _body(request: web.Request) -> dict[str, Any]:
    try:
        asked = msgspec.json.decode(await request.read())
    except msgspec.DecodeError:
        raise web.HTTPBadRequest(reason="this is no JSON") from None
    if not isinstance(asked, dict):
        raise web.HTTPBadRequest(reason="a request is a map")
    return asked


def _page(name: object) -> str:
    if not isinstance(name, str) or not _PAGE.fullmatch(name):
        raise web.HTTPBadRequest(reason="a page has a number of its own")
    return name


def _json(told: object) -> web.Response:
    return web.Response(body=msgspec.json.encode(told), content_type="application/json")


def _plain(status: int, text: str) -> web.Response:
    return web.Response(status=status, text=text, headers=security_headers())


def _read_static() -> dict[str, bytes]:
    """All files by their names: what is not among them cannot be asked for, whatever the path."""
    found = {
        path.relative_to(_STATIC).as_posix(): path.read_bytes()
        for path in sorted(_STATIC.rglob("*"))
        if path.is_file()
    }
    found["index.html"] = found["index.html"].replace(b"IMPORT_MAP", IMPORT_MAP.encode())
    return found
