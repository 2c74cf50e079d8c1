"""A daemon that listens on a free port too, with certificates made for the test."""

import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from config.remote import Remote
from daemon.host.clock import MonotonicClock
from daemon.remote.certificates import CertificateFolder
from daemon.remote.client.address import LocalAddress, TlsAddress
from daemon.remote.server.server import RemoteOpenError, RemoteServer
from tests.daemon.remote.rig import ROBOT, FakeRobot, serving

USERS: Final = {"alice": "operator", "dora": "operator", "bob": "viewer"}
STRANGER: Final = "mallory"
"""Has a good certificate, but is not listed."""
_TRIES: Final = 5


def make_certificates(folder: Path, hosts: tuple[str, ...] = ("127.0.0.1",)) -> Path:
    """A folder with the certificates of everybody."""
    wall_time_ns = MonotonicClock().wall_time_ns()
    CertificateFolder(folder, wall_time_ns, 2).make(hosts, [*USERS, STRANGER])
    return folder


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


@dataclass(frozen=True)
class Served:
    """A daemon that can be reached both ways."""

    server: RemoteServer
    robot: FakeRobot
    port: int
    stop_port: int
    certificates: Path
    local: LocalAddress

    def remote(self, user: str, certificates: Path | None = None) -> TlsAddress:
        endpoint = f"127.0.0.1:{self.port}"
        stop = f"127.0.0.1:{self.stop_port}"
        return TlsAddress(ROBOT, endpoint, certificates or self.certificates, user, stop)


@asynccontextmanager
async def serving_all(folder: Path, certificates: Path) -> AsyncIterator[Served]:
    """With a unix socket and a TLS listener; another port where one was taken meanwhile."""
    for left in reversed(range(_TRIES)):
        port, stop_port = free_port(), free_port()
        settings = Remote.model_validate(
            {
                "tls": {
                    "endpoint": f"127.0.0.1:{port}",
                    "stop_endpoint": f"127.0.0.1:{stop_port}",
                    "certificates": str(certificates),
                },
                "users": USERS,
            }
        )
        opened = False
        try:
            async with serving(folder, settings=settings) as (server, robot):
                opened = True
                local = LocalAddress(ROBOT, folder / "zenoh.sock")
                yield Served(server, robot, port, stop_port, certificates, local)
                return
        except RemoteOpenError:
            if opened or not left:
                raise
