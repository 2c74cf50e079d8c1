"""Where a daemon is and as whom to go there; and why nobody was let in."""

import socket
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from daemon.messages import Answer, Refusal
from daemon.remote.access import TLS, client_config, client_tls, unix_endpoint
from daemon.remote.client.client_errors import (
    AccessDeniedError,
    ClientError,
    DaemonNotRunningError,
    TimedOutError,
)
from daemon.remote.client.stop_client import StopLine, stop_locally
from daemon.remote.discovery import STOP_SOCKET, read_daemon
from daemon.remote.wire import Format, WireError, decode

LOCAL_USER: Final = "local"
_KNOCK_WITHIN_S: Final = 3.0
_REFUSAL_BYTES: Final = 4096


@dataclass(frozen=True)
class LocalAddress:
    """A daemon on this machine, by its unix socket."""

    robot: str
    unix_socket: Path
    user: str = LOCAL_USER
    stop_socket: Path | None = None
    """Where every datagram is a STOP; None: beside the other one."""

    @classmethod
    def in_folder(cls, folder: Path) -> "LocalAddress":
        """The daemon that has `folder` as its runtime folder. Raises DaemonNotRunningError."""
        daemon = read_daemon(folder)
        if daemon is None:
            raise DaemonNotRunningError(f"no daemon is running in {folder}: `tentacled run`")
        if daemon.unix_socket is None:
            raise DaemonNotRunningError(
                f"the daemon in {folder} has no unix socket: reach it over tls, at {daemon.tls}"
            )
        stop = daemon.stop_socket
        return cls(
            daemon.robot, Path(daemon.unix_socket), stop_socket=None if stop is None else Path(stop)
        )

    def __str__(self) -> str:
        return f"{self.robot} at {self.unix_socket}"

    async def stop(self, request: str, within_s: float) -> Answer:
        """STOP by its own way. Raises ClientError."""
        path = self.stop_socket or self.unix_socket.with_name(STOP_SOCKET)
        return await stop_locally(path, request, within_s)

    def config(self, wait_s: float) -> dict[str, Any]:
        """For zenoh. Raises ValueError."""
        return client_config(unix_endpoint(self.unix_socket), None, wait_s)

    def why_not(self) -> ClientError:
        """Why a connection was not made. Blocks for a moment."""
        with socket.socket(socket.AF_UNIX) as knocking:
            knocking.settimeout(_KNOCK_WITHIN_S)
            try:
                knocking.connect(str(self.unix_socket))
            except PermissionError:
                return AccessDeniedError(
                    f"{self.unix_socket} may be opened by the daemon's own user only: be that "
                    "user, or set `remote: {group_may_connect: true}` in the robot file"
                )
            except (FileNotFoundError, ConnectionRefusedError):
                return DaemonNotRunningError(f"the daemon of {self} is not running")
            except OSError as error:
                return DaemonNotRunningError(f"the daemon of {self} cannot be reached: {error}")
        return TimedOutError(f"the daemon of {self} is there, but takes no connection")


@dataclass(frozen=True)
class TlsAddress:
    """A daemon on another machine. Both sides show certificates."""

    robot: str
    endpoint: str
    """host:port, as the daemon's certificate names the host."""
    certificates: Path
    """Folder with `ca.pem`, and `<user>.pem` and `<user>.key`."""
    user: str
    stop_endpoint: str | None = None
    """Where the daemon takes nothing but STOP; None: the port after the other one."""

    def __str__(self) -> str:
        return f"{self.robot} at {self.endpoint}"

    async def stop(self, request: str, within_s: float) -> Answer:
        """STOP by its own way. Raises ClientError."""
        async with self.stop_line() as line:
            return await line.stop(request, within_s)

    def stop_line(self) -> StopLine:
        """A connection that is there for nothing but STOP. Not connected yet."""
        host, _, port = self.endpoint.rpartition(":")
        return StopLine(
            self.stop_endpoint or f"{host}:{int(port) + 1}",
            self.certificates / "ca.pem",
            self.certificates / f"{self.user}.pem",
            self.certificates / f"{self.user}.key",
        )

    def config(self, wait_s: float) -> dict[str, Any]:
        """For zenoh. Raises ValueError where certificates are missing."""
        for name in ("ca.pem", f"{self.user}.pem", f"{self.user}.key"):
            if not (self.certificates / name).is_file():
                raise ValueError(f"there is no {self.certificates / name}")
        tls = client_tls(self.certificates.absolute(), self.user)
        return client_config(f"{TLS}/{self.endpoint}", tls, wait_s)

    def why_not(self) -> ClientError:
        """Why a connection was not made: zenoh does not say, so shake hands ourselves. Blocks."""
        import ssl  # only wanted here, and slow to import

        host, _, port = self.endpoint.rpartition(":")
        host = host.strip("[]")
        try:
            context = ssl.create_default_context(cafile=str(self.certificates / "ca.pem"))
            mine = self.certificates / f"{self.user}.pem"
            context.load_cert_chain(mine, self.certificates / f"{self.user}.key")
        except (ssl.SSLError, OSError) as error:
            return AccessDeniedError(
                f"the certificates in {self.certificates} are no good: {error}"
            )
        try:
            with socket.create_connection((host, int(port)), _KNOCK_WITHIN_S) as plain:
                return self._handshake(context.wrap_socket(plain, server_hostname=host))
        except ssl.SSLCertVerificationError as error:
            return AccessDeniedError(
                f"the certificate that {self.endpoint} shows is not believed: "
                f"{error.verify_message or error}"
            )
        except ssl.SSLError as error:
            return AccessDeniedError(f"{self.endpoint} has refused {mine}: {error.reason}")
        except TimeoutError:
            return TimedOutError(f"{self.endpoint} does not answer")
        except OSError as error:
            return DaemonNotRunningError(
                f"nobody listens at {self.endpoint} ({error.strerror or error}): is the daemon "
                "running, and `remote: {tls: ...}` in its robot file?"
            )

    def _handshake(self, connection: socket.socket) -> ClientError:
        """A refusal of our certificate comes only with the first bytes that are read."""
        with connection:
            connection.settimeout(_KNOCK_WITHIN_S)
            with suppress(TimeoutError):
                received = connection.recv(_REFUSAL_BYTES)
                mine = self.certificates / f"{self.user}.pem"
                with suppress(WireError):
                    text = decode(received, Refusal, Format.JSON).text
                    return AccessDeniedError(f"the daemon of {self}: {text}")
                return AccessDeniedError(f"{self.endpoint} has refused {mine}")
        return TimedOutError(f"the daemon of {self} is there, but takes no connection")


Address = LocalAddress | TlsAddress
