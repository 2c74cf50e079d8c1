"""Floods of the remote interface, each as a program of its own: FLOOD FOLDER PORT STOP_PORT.

`python -m tests.experiments.floods ...` says `here` when it floods, and goes on until it is ended.
"""

import json
import selectors
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import zenoh

from daemon.remote.client.address import LocalAddress, TlsAddress
from daemon.remote.keys import Keys

ROBOT: Final = "soft_arm"
VIEWER: Final = "bob"
_ASKED_HZ: Final = 2000
_SESSIONS: Final = 31
_CONNECTS: Final = 1800
_IDLE: Final = 60
_TRY_AGAIN_S: Final = 0.02


def ask_state(folder: Path, port: int, stop_port: int) -> None:
    """A viewer who asks for the state two thousand times a second."""
    session, keys = _session(folder, port, stop_port), Keys(ROBOT)
    nothing: Any = zenoh.handlers.Callback(lambda _: None, indirect=False)
    print("here", flush=True)
    due_s = time.monotonic()
    while True:
        due_s += 10.0 / _ASKED_HZ
        for _ in range(10):
            session.get(keys.telemetry("state"), nothing)
        time.sleep(max(due_s - time.monotonic(), 0.0))


def open_sessions(folder: Path, port: int, stop_port: int) -> None:
    """A viewer with as many sessions as he can get, who goes on trying for more."""
    sessions: list[zenoh.Session] = []
    told = False
    while True:
        if len(sessions) < _SESSIONS:
            with suppress(zenoh.ZError):
                sessions.append(_session(folder, port, stop_port))
                continue
        if not told:
            told = True
            print("here", flush=True)
        time.sleep(_TRY_AGAIN_S)


def connect(folder: Path, port: int, stop_port: int) -> None:
    """Connections to both ports that never say anything, made anew as they are hung up on."""
    del folder
    ports = cycle([("127.0.0.1", port), ("127.0.0.1", stop_port)])
    _keep_open(_CONNECTS, lambda: socket.create_connection(next(ports), 5.0))


def idle_locally(folder: Path, port: int, stop_port: int) -> None:
    """Connections to the unix socket that never say anything."""
    del port, stop_port

    def one() -> socket.socket:
        connection = socket.socket(socket.AF_UNIX)
        connection.settimeout(5.0)
        connection.connect(str(folder / "zenoh.sock"))
        return connection

    _keep_open(_IDLE, one)


FLOODS: Final[dict[str, Callable[[Path, int, int], None]]] = {
    "state asked 2000/s": ask_state,
    "31 sessions": open_sessions,
    "1800 connects": connect,
    "60 idle locally": idle_locally,
}


def _keep_open(count: int, make: Callable[[], socket.socket]) -> None:
    selector = selectors.DefaultSelector()
    told = False
    while True:
        while len(selector.get_map()) < count:
            try:
                connection = make()
            except OSError:
                break
            connection.setblocking(False)
            selector.register(connection, selectors.EVENT_READ)
        if not told:
            told = True
            print("here", flush=True)
        for key, _ in selector.select(_TRY_AGAIN_S):
            selector.unregister(key.fileobj)
            assert isinstance(key.fileobj, socket.socket)
            key.fileobj.close()


def _session(folder: Path, port: int, stop_port: int) -> zenoh.Session:
    address = remote(folder, port, stop_port, VIEWER)
    return zenoh.open(zenoh.Config.from_json5(json.dumps(address.config(0.0))))


def remote(folder: Path, port: int, stop_port: int, user: str) -> TlsAddress:
    """The daemon in `folder`, as `user` reaches it over the network."""
    stop = f"127.0.0.1:{stop_port}"
    return TlsAddress(ROBOT, f"127.0.0.1:{port}", folder / "certificates", user, stop)


def local(folder: Path) -> LocalAddress:
    """The same for who is on its machine."""
    return LocalAddress.in_folder(folder)


if __name__ == "__main__":
    FLOODS[sys.argv[1]](Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
