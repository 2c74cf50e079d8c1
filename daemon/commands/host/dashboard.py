"""`tentacled dashboard`: the operator's page, for the robots whose daemons run on this machine."""

import argparse
import asyncio
import logging
import secrets
import socket
import ssl
from collections.abc import Callable, Sequence
from errno import EADDRINUSE
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import quote

from config.documents.problems import did_you_mean, in_words
from daemon.commands.outcome.failures import CommandError, UsageError
from daemon.commands.outcome.result import Result, tell
from daemon.commands.terminal.argument_types import port_number
from daemon.commands.terminal.event_log import add_log_argument, event_line, style_of, warning_line
from daemon.commands.terminal.remote_arguments import LOOPBACK, network_warnings
from daemon.host.logs import Log, logging_to_stderr
from daemon.host.stop_signals import StopSignals
from daemon.remote.access import OPERATOR
from daemon.remote.discovery import read_daemon, running_daemons
from daemon.robot.runtime_directory import runtime_root

if TYPE_CHECKING:
    from daemon.dashboard.recorded_runs import RecordedRuns
    from daemon.dashboard.server import PageServer

_LOOKS_EACH_S: Final = 1.0
_PORT: Final = 8420
_RUNS: Final = Path("runs")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "robots", nargs="*", metavar="ROBOT", help="names of robots (default: all that run here)"
    )
    parser.add_argument(
        "--runtime-dir", type=Path, metavar="DIR", help="of a daemon that is not found by itself"
    )
    parser.add_argument(
        "--port",
        type=port_number,
        metavar="N",
        help=f"default: {_PORT}, or any that is free where that is taken; 0: any that is free",
    )
    parser.add_argument(
        "--bind", default="127.0.0.1", metavar="ADDRESS", help="other than this machine: with --tls"
    )
    parser.add_argument(
        "--host", action="append", default=[], metavar="NAME", help="by which browsers may ask"
    )
    parser.add_argument(
        "--tls", nargs=2, type=Path, metavar=("CERTIFICATE", "KEY"), help="serve https"
    )
    parser.add_argument(
        "--no-token", action="store_true", help="a proxy before it lets only operators through"
    )
    parser.add_argument(
        "--experiments",
        type=Path,
        metavar="DIR",
        help="more experiment files than the shipped ones",
    )
    parser.add_argument(
        "--runs",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help=f"folders of recordings to list (default: {_RUNS}, and where the daemons here record)",
    )
    parser.add_argument(
        "--replay", type=Path, metavar="RUN", help="open this recording: a run's folder, or a file"
    )
    add_log_argument(parser)


def run(arguments: argparse.Namespace) -> Result:
    if arguments.bind not in LOOPBACK and (arguments.tls is None or arguments.no_token):
        raise UsageError("others than this machine are served with --tls and a token only")
    if arguments.replay is not None and not arguments.replay.exists():
        text = f"{arguments.replay}: there is no such file or folder"
        raise CommandError("no_input", text, place=str(arguments.replay))
    try:
        with logging_to_stderr("dashboard", style=style_of(arguments)) as log:
            warn = warning_line(log, arguments)
            asyncio.run(_serve(arguments, warn, log if arguments.log else None))
    except OSError as error:
        raise CommandError("unavailable", f"the page cannot be served: {in_words(error)}") from None
    return Result(None)


async def _serve(
    arguments: argparse.Namespace, warn: Callable[[str], None], log: Log | None
) -> None:
    """Raises OSError."""
    from aiohttp import web  # slow to come

    from daemon.dashboard.experiments import ExperimentFiles
    from daemon.dashboard.http_rules import LOOPBACK_HOSTS, VIEWER, Rules
    from daemon.dashboard.recorded_runs import RecordedRuns
    from daemon.dashboard.server import PageServer

    context = _context(arguments)  # before there is anything to be closed
    listening, port = _listening(arguments.bind, arguments.port)
    tokens = {} if arguments.no_token else {_token(): OPERATOR, _token(): VIEWER}
    hosts = (*LOOPBACK_HOSTS, *arguments.host)
    secure = arguments.tls is not None
    replay = arguments.replay
    runs = RecordedRuns(arguments.runs or [_RUNS], [] if replay is None else [replay])
    server = PageServer(
        Rules(port, hosts, tokens, secure), ExperimentFiles(arguments.experiments), runs
    )
    runner = web.AppRunner(server.app, access_log=None, shutdown_timeout=1.0)
    await runner.setup()
    finding = asyncio.create_task(_find(server, runs, arguments, log))
    try:
        await web.SockSite(runner, listening, ssl_context=context).start()
        for text in network_warnings(arguments.bind, port):
            warn(text)
        _tell(arguments, port, tokens)
        for text in absent(arguments.robots, _folders(arguments)):
            warn(text)
        await StopSignals().wait(None)
    finally:
        finding.cancel()
        await asyncio.gather(finding, return_exceptions=True)
        await runner.cleanup()


def _tell(arguments: argparse.Namespace, port: int, tokens: dict[str, str]) -> None:
    scheme = "https" if arguments.tls is not None else "http"
    host = arguments.host[0] if arguments.host else "localhost"
    address = f"{scheme}://{host}:{port}/"
    replay = "" if arguments.replay is None else f"replay={quote(arguments.replay.resolve().name)}"
    if tokens:
        pages = {
            role: f"{address}?token={token}{replay and '&'}{replay}"
            for token, role in tokens.items()
        }
        text = "\n".join(f"{role}: {page}" for role, page in pages.items())
    else:
        pages = {"anybody": f"{address}{replay and '?'}{replay}"}
        text = f"{pages['anybody']}  (whoever reaches it commands)"
    tell("dashboard", {"port": port, "pages": pages, "state": "ready"}, text)


def _folders(arguments: argparse.Namespace) -> list[Path]:
    own = [] if arguments.runtime_dir is None else [arguments.runtime_dir]
    return [*running_daemons(runtime_root()), *own]


def absent(robots: Sequence[str], folders: Sequence[Path]) -> list[str]:
    """A line about each of `robots` that no daemon in `folders` has."""
    daemons = [daemon for folder in folders if (daemon := read_daemon(folder)) is not None]
    there = {daemon.robot for daemon in daemons}
    return [
        f"no daemon runs {name} here{did_you_mean(name, there)}: the page shows it when one does"
        for name in robots
        if name not in there
    ]


def _token() -> str:
    return secrets.token_urlsafe(24)


def _context(arguments: argparse.Namespace) -> ssl.SSLContext | None:
    if arguments.tls is None:
        return None
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(*arguments.tls)
    except OSError as error:  # it does not say which file
        error.filename = str(arguments.tls[0])
        raise
    return context


def _listening(address: str, port: int | None) -> tuple[socket.socket, int]:
    """port: None where any will do. Raises OSError."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listening = socket.create_server((address, _PORT if port is None else port), family=family)
    except OSError as error:
        if port is not None or error.errno != EADDRINUSE:
            raise
        listening = socket.create_server((address, 0), family=family)
    return listening, int(listening.getsockname()[1])


async def _find(
    server: "PageServer",
    runs: "RecordedRuns",
    arguments: argparse.Namespace,
    log: Log | None = None,
) -> None:
    """Daemons that come are picked up; those that go are waited for."""
    from daemon.dashboard.robot_link import RobotLink

    links: list[asyncio.Task[None]] = []
    try:
        while True:
            for folder in _folders(arguments):
                found = read_daemon(folder)
                wanted = found is not None and (
                    not arguments.robots or found.robot in arguments.robots
                )
                known = None if found is None else server.links.get(found.robot)
                if known is not None and known.problem and known.folder != folder:
                    known.folder = folder  # it has come back elsewhere
                    server.serve(known)
                if found is not None and wanted and known is None:
                    tell = None if log is None else event_line(log, found.robot)
                    link = RobotLink(found.robot, folder, tell)
                    server.serve(link)
                    if log is not None:
                        log.tell(logging.INFO, "dashboard", f"{found.robot} found in {folder}")
                    links.append(asyncio.create_task(link.run()))
            for link in server.links.values():
                if link.status is not None and link.status.recording is not None:
                    runs.add_root(Path(link.status.recording).parent)
            await asyncio.sleep(_LOOKS_EACH_S)
    finally:
        for task in links:
            task.cancel()
        await asyncio.gather(*links, return_exceptions=True)
