"""Runs the blocks of a page as somebody would who reads it: in its order, in one empty folder."""

import os
import pty
import shutil
import signal
import subprocess
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from tests.docs.blocks import Block
from tests.installed_wheel import built_wheel, environment_with
from tests.ordinary_user import OWN_VERSION, interpreter, ordinary_user

READY_S: Final = 120.0
"""For a program in a terminal of its own to speak, and a robot to be ready."""
PATIENCE_S: Final = 30.0
"""For it to end."""
LONGEST_S: Final = 900.0
"""For one block."""
_LANGUAGES: Final = frozenset({"sh", "python", "c"})


class Terminal:
    """A program in a terminal of its own, and all that it has shown."""

    def __init__(
        self, line: str, folder: Path, environment: Mapping[str, str], user: int | None
    ) -> None:
        self._master, slave = pty.openpty()
        self.process = subprocess.Popen(
            ["bash", "-c", f"exec {line}"],
            cwd=folder,
            env=environment,
            user=user,
            stdin=subprocess.DEVNULL,
            stdout=slave,
            stderr=slave,
        )
        os.close(slave)
        self._shown: list[bytes] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def shown(self) -> str:
        return b"".join(self._shown).decode(errors="replace")

    def close(self) -> None:
        """Ctrl-C, and patience."""
        self.process.send_signal(signal.SIGINT)
        try:
            self.process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._reader.join()
        os.close(self._master)

    def _read(self) -> None:
        with suppress(OSError):  # the other end is closed
            while some := os.read(self._master, 4096):
                self._shown.append(some)


class Installed(NamedTuple):
    """What somebody has who wants to follow the pages."""

    programs: Path
    """The folder in which `tentacled` and `python` are."""
    environment: Mapping[str, str]


class Reader:
    """Somebody with a page, an empty folder, a home that nothing can be written to, and `tentacled`
    installed; an ordinary user, even where root lets them read."""

    def __init__(self, installed: Installed, folder: Path) -> None:
        programs = installed.programs
        self._programs = programs
        self._folder = folder / "work"
        self._user = ordinary_user()
        runtime, home = folder / "run", folder / "home"
        for made in (self._folder, runtime, home):
            made.mkdir()
        runtime.chmod(0o700)
        home.chmod(0o555)
        if self._user is not None:
            for own in (folder, self._folder, runtime):
                os.chown(own, self._user, -1)
        clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
        self._environment = {
            **clean,
            **installed.environment,
            "HOME": str(home),
            "PATH": f"{programs}:{os.environ['PATH']}",
            "PYTHONUNBUFFERED": "1",
            "XDG_RUNTIME_DIR": str(runtime),
            "VIRTUAL_ENV": str(programs.parent),
            "PIP_NO_BUILD_ISOLATION": "0",  # 0 is how pip is told: nothing is fetched
            "PIP_NO_DEPS": "1",
        }
        self._terminals: list[Terminal] = []
        self._scripts = 0

    def reads(self, block: Block) -> None:
        """Do what it says. Raises AssertionError with what was printed where that fails."""
        if block.mark == "background":
            for line in block.commands:
                self._open_terminal(line)
        elif block.language == "sh":
            self._run(["bash", "-euc", block.text], block)
        elif block.language == "c":
            source = self._written(block, "c")
            program = source.with_suffix("")
            self._run(["cc", "-Wall", "-Werror", "-o", str(program), str(source)], block)
        else:
            source = self._written(block, "py")
            tests = ["-m", "pytest", "-q", "-p", "no:cacheprovider"] * ("def test_" in block.text)
            self._run([str(self._programs / "python"), *tests, str(source)], block)

    def leaves(self) -> None:
        """Close all terminals, the last one first."""
        while self._terminals:
            self._terminals.pop().close()

    def _open_terminal(self, line: str) -> None:
        """Begin it, and look at it until it has spoken; a daemon's robot until it is ready."""
        terminal = Terminal(line, self._folder, self._environment, self._user)
        self._terminals.append(terminal)
        deadline_s = time.monotonic() + READY_S
        while not self._speaks(line, terminal):
            assert terminal.process.poll() is None, f"{line}: {terminal.shown}"
            assert time.monotonic() < deadline_s, f"{line}: {terminal.shown}"
            time.sleep(0.2)

    def _speaks(self, line: str, terminal: Terminal) -> bool:
        if line.startswith("tentacled emulate "):  # a first one compiles, and tells how far it is
            return "Ctrl-C ends it" in terminal.shown
        return bool(terminal.shown) and (not line.startswith("tentacled run ") or self._is_ready())

    def _is_ready(self) -> bool:
        told = subprocess.run(
            ["tentacled", "status", "--json"],
            env=self._environment,
            user=self._user,
            cwd=self._folder,
            capture_output=True,
            text=True,
            check=False,
        )
        return '"state":"ready"' in told.stdout.replace(" ", "")

    def _written(self, block: Block, ending: str) -> Path:
        self._scripts += 1
        path = self._folder / f"test_{self._scripts}.{ending}"
        path.write_text(block.text)
        return path

    def _run(self, words: Sequence[str], block: Block) -> None:
        ended = subprocess.run(
            words,
            cwd=self._folder,
            env=self._environment,
            user=self._user,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
        where = f"{block.page}:{block.line}"
        assert ended.returncode == 0, f"{where} ended with {ended.returncode}: {ended.stdout}"


@contextmanager
def installed_for_readers(version: str = OWN_VERSION) -> Iterator[Installed]:
    """`tentacled` with a Python of that version, in an environment that readers may write to: what
    they make is installed there."""
    with TemporaryDirectory(prefix="docs", dir="/tmp") as name:
        folder, user = Path(name), ordinary_user()
        folder.chmod(0o755)
        wheel, python = built_wheel(folder), interpreter(version, folder)
        environment = environment_with(wheel, folder, python)
        if user is not None:
            for own in (environment, *environment.rglob("*")):
                os.chown(own, user, -1, follow_symlinks=False)
        yield Installed(environment / "bin", python.environment)


@contextmanager
def reader(installed: Installed) -> Iterator[Reader]:
    """In a folder with a short name, for unix sockets, which is gone afterwards."""
    with TemporaryDirectory(prefix="page", dir="/tmp") as folder:
        one = Reader(installed, Path(folder))
        try:
            yield one
        finally:
            one.leaves()


def runnable(blocks: Iterable[Block], *, long: bool) -> list[Block]:
    """Those that can be run; long: also those that take minutes."""
    wanted = {"run", "background", *(["long"] if long else [])}
    found = [one for one in blocks if one.language in _LANGUAGES and one.mark in wanted]
    return [one for one in found if one.language != "c" or shutil.which("cc")]
