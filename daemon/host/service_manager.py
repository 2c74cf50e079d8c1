"""What systemd is told, after sd_notify(3): that we are up, how we are, and that the loop is alive.

Datagrams on a socket that the environment names. Nothing of it ever waits: the queue of such a
socket holds ten datagrams, and where the service manager is busy what does not fit is left out.
"""

import os
import socket
from collections.abc import Mapping
from typing import Final

_FEEDS_PER_TIMEOUT: Final = 5
"""systemd asks for two; a machine that stands still for a cycle or two is no reason to end us."""
_LONGEST_STATUS: Final = 200


class ServiceManager:
    """Of this process; one that nobody has asked to tell anything says nothing."""

    def __init__(self, environment: Mapping[str, str] = os.environ) -> None:
        address = environment.get("NOTIFY_SOCKET", "")
        self._socket: socket.socket | None = None
        if address.startswith(("/", "@")):
            kind = socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            self._socket = socket.socket(socket.AF_UNIX, kind)
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._every_ns = _feed_every_ns(environment)
        self._due_ns = 0
        self._status = ""

    def ready(self) -> None:
        """Clients are heard, and devices are being set up."""
        self._tell("READY=1")

    def stopping(self) -> None:
        """On the way down."""
        self._tell("STOPPING=1")

    def status(self, text: str) -> None:
        """For `systemctl status`. Told when it changes."""
        text = " ".join(text.split())[:_LONGEST_STATUS]
        if text != self._status:
            self._status = text
            self._tell(f"STATUS={text}")

    def good_cycle(self, now_ns: int) -> None:
        """A bus cycle has been supervised and was sound: the only thing that feeds the watchdog."""
        if self._every_ns and now_ns >= self._due_ns:
            self._due_ns = now_ns + self._every_ns
            self._tell("WATCHDOG=1")

    def close(self) -> None:
        """May be repeated."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _tell(self, text: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto(text.encode(), self._address)
        except OSError:  # full, or gone: none of the loop's business
            return


def _feed_every_ns(environment: Mapping[str, str]) -> int:
    """0: nobody watches us."""
    whose = environment.get("WATCHDOG_PID", "")
    if whose and whose != str(os.getpid()):
        return 0
    try:
        timeout_us = int(environment.get("WATCHDOG_USEC", "0"))
    except ValueError:
        return 0
    return max(timeout_us, 0) * 1000 // _FEEDS_PER_TIMEOUT
