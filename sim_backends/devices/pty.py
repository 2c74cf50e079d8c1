"""A pseudo-terminal with an emulated device on its master side.

A pty passes bytes but neither breaks nor rates: the master can read the rate that the client has
set, and in packet mode it is told when the client flushes. The emulated devices make of that what
a wire would have made of it.
"""

import asyncio
import os
import termios
import tty
from collections.abc import Callable
from fcntl import ioctl
from pathlib import Path
from struct import pack

_READ_BYTES = 4096
_PACKET_DATA = 0
_BAUD_RATES = {
    getattr(termios, f"B{rate}"): rate
    for rate in (9600, 14400, 19200, 38400, 57600, 115200, 230400, 460800, 921600, 1000000)
    if hasattr(termios, f"B{rate}")
}
_OUTPUT_SPEED = 5


class Pty:
    """The device's end of a pty. Lives in the running event loop until closed.

    link: a name that leads to the pty while it is there, like those in /dev/serial/by-id.
    """

    def __init__(
        self,
        on_data: Callable[[bytes], None],
        on_flush: Callable[[], None] | None = None,
        link: Path | None = None,
    ) -> None:
        self._on_data = on_data
        self._on_flush = on_flush
        self._master, self._slave = os.openpty()
        # The slave stays open here: without it the master is hung up whenever a client leaves.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        ioctl(self._master, termios.TIOCPKT, pack("i", 1))
        self.path = Path(os.ttyname(self._slave))
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(self._master, self._readable)
        self._closed = False
        self._link = link
        if link is not None:
            link.parent.mkdir(parents=True, exist_ok=True)
            fresh = link.with_name(f".{link.name}.{os.getpid()}")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.path)
            fresh.replace(link)

    @property
    def client_baud_rate(self) -> int:
        """The rate that the client has set on its side; 0 for one that no device has."""
        return _BAUD_RATES.get(termios.tcgetattr(self._master)[_OUTPUT_SPEED], 0)

    def write(self, data: bytes) -> int:
        """Send to the client. Returns how many bytes it could still take: the rest is lost."""
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """Unplug: the client reads end-of-file or EIO from now on."""
        if not self._closed:
            self._closed = True
            self._remove_link()
            self._loop.remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)

    def _remove_link(self) -> None:
        """Unless another pty has taken it over."""
        link = self._link
        if link is not None and link.is_symlink() and link.readlink() == self.path:
            link.unlink(missing_ok=True)

    def _readable(self) -> None:
        try:
            packet = os.read(self._master, _READ_BYTES)
        except BlockingIOError:
            return
        if packet[:1] == bytes([_PACKET_DATA]):
            if len(packet) > 1:
                self._on_data(packet[1:])
        elif packet and packet[0] & termios.TIOCPKT_FLUSHREAD and self._on_flush is not None:
            self._on_flush()
