"""A name that only one process of this machine holds at a time.

It is the name of an abstract unix socket: there is no file whose folder somebody else could own,
every user of the machine meets the same names, and the kernel frees them when the process ends, by
whatever death. Beside it the holder binds a second name with its process identifier, which the
others find in /proc/net/unix; a socket that listens could say it too, but its backlog could be
filled by anybody.
"""

import os
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import blake2b
from pathlib import Path
from typing import Final

_SOCKETS: Final = Path("/proc/net/unix")
_PROCESSES: Final = Path("/proc")
_OURS: Final = "\0tentacled."
_MEANS: Final = ".is."
_DIGEST_BYTES: Final = 16  # names may be long, and an abstract one has 107 bytes
_LONGEST_COMMAND: Final = 120


@dataclass(frozen=True)
class Holder:
    """The process that has a name."""

    pid: int
    command: str
    """What it was started as; empty where that cannot be seen."""

    def __str__(self) -> str:
        if self.pid == os.getpid():
            return "this very process"
        return f"process {self.pid} ({self.command})" if self.command else f"process {self.pid}"


class NameTakenError(OSError):
    """Somebody has the name."""

    def __init__(self, name: str, holder: Holder | None) -> None:
        super().__init__(f"{name} is taken by {holder or 'another process'}")
        self.holder = holder


class ExclusiveName:
    """The name, held from its making until `release` or the end of the process."""

    def __init__(self, name: str) -> None:
        """Raises NameTakenError."""
        address = _address(name)
        self._sockets = [socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)]
        try:
            self._sockets[0].bind(address)
        except OSError:
            self.release()
            raise NameTakenError(name, holder_of(name)) from None
        with suppress(OSError):  # it says who we are, and nothing depends on it
            self._sockets.append(socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM))
            self._sockets[1].bind(f"{address}.{os.getpid()}")

    def release(self) -> None:
        """Let another have it. Safe to call twice."""
        for one in reversed(self._sockets):
            one.close()
        self._sockets.clear()


class OtherName:
    """Says that one name stands for another, until `release` or the end of the process.

    Whoever asks for the one asks for the other, so that a thing with several names has one holder.
    """

    def __init__(self, name: str, meaning: str) -> None:
        """Raises NameTakenError where just this has been said already."""
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            self._socket.bind(f"{_own_address(name)}{_MEANS}{_digest(meaning)}")
        except OSError:
            self._socket.close()
            raise NameTakenError(name, None) from None

    def release(self) -> None:
        """The name stands for itself again. Safe to call twice."""
        self._socket.close()


def is_taken(name: str) -> bool:
    """Whether somebody has the name now."""
    try:
        ExclusiveName(name).release()
    except NameTakenError:
        return True
    return False


def holder_of(name: str) -> Holder | None:
    """Who has the name, as far as that can be seen."""
    for pid in _said_behind(f"{_address(name)}."):
        if pid.isdigit():
            return Holder(int(pid), _command(int(pid)))
    return None


def _address(name: str) -> str:
    """Of the name, or of what it stands for."""
    own = _own_address(name)
    return next((f"{_OURS}{digest}" for digest in _said_behind(f"{own}{_MEANS}")), own)


def _own_address(name: str) -> str:
    return f"{_OURS}{_digest(name)}"


def _digest(name: str) -> str:
    return blake2b(name.encode(), digest_size=_DIGEST_BYTES).hexdigest()


def _said_behind(beginning: str) -> Iterator[str]:
    """How the addresses go on that begin like this, of all sockets that can be seen."""
    marked = f" @{beginning[1:]}"
    with suppress(OSError):
        for line in _SOCKETS.read_text(errors="replace").splitlines():
            _, found, rest = line.rpartition(marked)
            if found:
                yield rest


def _command(pid: int) -> str:
    """The command line of a process, ours as an operator would have typed them."""
    try:
        words = (_PROCESSES / str(pid) / "cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return ""
    arguments = [word for word in words.split("\0") if word]
    ours = [place for place, word in enumerate(arguments) if _is_ours(word)]
    if ours:
        arguments = ["tentacled", *arguments[ours[0] + 1 :]]
    command = " ".join(arguments)
    return command if len(command) <= _LONGEST_COMMAND else f"{command[:_LONGEST_COMMAND]} ..."


def _is_ours(word: str) -> bool:
    return (
        word == "daemon.commands.terminal.command_line"
        or Path(word).name == "tentacled"
        or word.endswith("daemon/commands/terminal/command_line.py")
    )
