"""What the page's server tells of recordings: lists them, hands them out, replays and reports them.

They are read by processes of their own, never by the server: a STOP does not wait for them.
"""

import asyncio
import base64
import hashlib
import re
import sys
from asyncio.subprocess import DEVNULL, PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Final

import msgspec
from aiohttp import web

from daemon.dashboard.http_rules import security_headers
from daemon.dashboard.recorded_runs import RecordedRuns
from daemon.host.processes import end_with_parent
from daemon.recording.run_folder import REPORT_FILE

_AT_ONCE: Final = 2
"""Processes that read recordings, whoever asks for how many."""
_PIECE_BYTES: Final = 1 << 18
_TAKEN_WITHIN_S: Final = 30.0
"""Of one piece, by a browser: one that takes no more (asleep, or of a page that hangs) gives up the
place of a process to others."""
_REPORTED_WITHIN_S: Final = 120.0
_STYLE: Final = re.compile(rb"<style>(.*?)</style>", re.DOTALL)


class RunPages:
    """Answers what is asked about recordings."""

    def __init__(self, runs: RecordedRuns) -> None:
        self.runs = runs
        self._room = asyncio.Semaphore(_AT_ONCE)

    def routes(self) -> list[web.RouteDef]:
        """All of it only reads; reports are made by `make_report`."""
        return [
            web.get("/api/runs", self._list),
            web.get("/api/runs/{run}/replay", self._replay),
            web.get("/api/runs/{run}/report", self._report),
            web.get("/api/runs/{run}/files/{file}", self._download),
        ]

    async def make_report(self, name: str) -> str:
        """Write the report of a run. Returns why not; empty: it is there."""
        run = await asyncio.to_thread(self.runs.find, name)
        if run is None:
            return "there is no such run"
        async with self._reading("daemon.commands.terminal.command_line", "report", run) as process:
            try:
                async with asyncio.timeout(_REPORTED_WITHIN_S):
                    _, said = await process.communicate()
            except TimeoutError:
                return f"the report was not done in {_REPORTED_WITHIN_S:g} s"
        return said.decode(errors="replace").strip() if process.returncode else ""

    async def _list(self, request: web.Request) -> web.Response:
        del request
        told = await asyncio.to_thread(self.runs.offered)
        return web.Response(body=msgspec.json.encode(told), content_type="application/json")

    async def _replay(self, request: web.Request) -> web.StreamResponse:
        run = await asyncio.to_thread(self.runs.find, request.match_info["run"])
        if run is None:
            raise web.HTTPNotFound(reason="there is no such run")
        async with self._reading("daemon.dashboard.replay_pack", run) as process:
            assert process.stdout is not None and process.stderr is not None
            first = await process.stdout.read(_PIECE_BYTES)
            if not first:
                said = (await process.stderr.read()).decode(errors="replace").strip()
                raise web.HTTPUnprocessableEntity(reason=_one_line(said))
            response = web.StreamResponse(headers=security_headers())
            response.content_type = "application/octet-stream"
            await response.prepare(request)
            piece = first
            try:
                while piece:
                    async with asyncio.timeout(_TAKEN_WITHIN_S):
                        await response.write(piece)
                    piece = await process.stdout.read(_PIECE_BYTES)
                async with asyncio.timeout(_TAKEN_WITHIN_S):
                    await response.write_eof()
            except TimeoutError:
                if request.transport is not None:
                    request.transport.abort()
            return response

    async def _report(self, request: web.Request) -> web.StreamResponse:
        content = await self._content(request, REPORT_FILE)
        style = _STYLE.search(content)
        digest = hashlib.sha256(style[1] if style else b"").digest()
        policy = (
            "default-src 'none'; img-src data:; frame-ancestors 'none'; sandbox; "
            f"style-src 'sha256-{base64.b64encode(digest).decode()}'"
        )
        response = web.Response(body=content, content_type="text/html", charset="utf-8")
        response.headers.update({**security_headers(), "Content-Security-Policy": policy})
        return response

    async def _download(self, request: web.Request) -> web.StreamResponse:
        path = await self._path(request, request.match_info["file"])
        name = f"{path.parent.name}-{path.name}".replace('"', "")
        headers = {
            **security_headers(),
            "Content-Type": "application/octet-stream",
            "Content-Disposition": f'attachment; filename="{name}"',
        }
        return web.FileResponse(path, headers=headers)

    async def _content(self, request: web.Request, file: str) -> bytes:
        path = await self._path(request, file)
        return await asyncio.to_thread(path.read_bytes)

    async def _path(self, request: web.Request, file: str) -> Path:
        path = await asyncio.to_thread(self.runs.file, request.match_info["run"], file)
        if path is None:
            raise web.HTTPNotFound(reason="there is no such file of a run")
        return path

    @asynccontextmanager
    async def _reading(self, module: str, *words: object) -> AsyncIterator[Process]:
        """A process that ends with the question for it."""
        async with self._room:
            process = await asyncio.create_subprocess_exec(
                sys.executable,
                "-m",
                module,
                *map(str, words),
                stdin=DEVNULL,
                stdout=PIPE,
                stderr=PIPE,
                preexec_fn=end_with_parent,
            )
            try:
                yield process
            finally:
                with suppress(ProcessLookupError):
                    process.kill()
                await process.communicate()  # what is not read to its end stays open


def _one_line(said: str) -> str:
    """Of what a process has said last: a reason may hold no line breaks."""
    lines = said.splitlines()
    return lines[-1] if lines else "the recording cannot be read"
