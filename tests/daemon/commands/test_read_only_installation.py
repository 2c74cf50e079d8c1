"""The installed wheel for a user who may write in one empty folder only, without a terminal."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from daemon.commands.outcome.exit_codes import EXIT_OK, EXIT_UNAVAILABLE
from tests.installed_wheel import PIP, done, installed_wheel

pytestmark = pytest.mark.long

NOBODY = 65534
VERSIONS = ("3.11", "3.12", "3.13")
WITHIN_S = 600.0
EVERY_PYTHON = "TENTACLED_EVERY_PYTHON"
OWN = f"{sys.version_info.major}.{sys.version_info.minor}"

COMMANDS = {
    "--version": EXIT_OK,
    "--help": EXIT_OK,
    "check builtin:soft_arm": EXIT_OK,
    "check builtin:rectangle": EXIT_OK,
    "plugins": EXIT_OK,
    "doctor": EXIT_OK,
    "schema": EXIT_OK,
    "completion bash": EXIT_OK,
    "man --write man": EXIT_OK,
    "init robot mine": EXIT_OK,
    "check mine/robot.yaml": EXIT_OK,
    "environment box --out box.stl --triangles 12": EXIT_OK,
    "certificates keys --operator alice": EXIT_OK,
    "service --write service": EXIT_OK,
    "explore builtin:soft_arm --out data.npz --waypoints 2 --run run": EXIT_OK,
    "report run": EXIT_OK,
    "export run": EXIT_OK,
    "recover run": EXIT_OK,
    "status": EXIT_UNAVAILABLE,
    "stop": EXIT_UNAVAILABLE,
}
"""What needs no other process, with how it ends."""


def interpreters(version: str) -> Iterator[str]:
    """Every one of this version that may be here."""
    yield from filter(None, (shutil.which(f"python{version}", path="/usr/bin:/usr/local/bin"),))
    if version == OWN:
        yield str(Path(sys.executable).resolve())
    for folder in sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*")):
        yield str(folder / "bin" / "python")


def works_for(python: str, user: int | None) -> bool:
    try:
        ended = subprocess.run([python, "-c", "import ssl"], user=user, capture_output=True)
    except OSError:
        return False
    return ended.returncode == 0


def chosen(version: str) -> tuple[str, int | None]:
    """An interpreter, and the user to run it: nobody where that can be, else ourselves."""
    wanted = [NOBODY, None] if os.getuid() == 0 else [None]
    for user in wanted:
        for python in interpreters(version):
            if works_for(python, user):
                return python, user
    pytest.skip(f"there is no Python {version} here")


@pytest.fixture(scope="module")
def wheel() -> Iterator[Path]:
    with TemporaryDirectory(prefix="wheel", dir="/tmp") as name:
        installed_wheel(Path(name))
        (found,) = (Path(name) / "dist").glob("*.whl")
        yield found


@pytest.fixture
def place() -> Iterator[Path]:
    """That others can look into."""
    with TemporaryDirectory(prefix="ro", dir="/tmp") as name:
        Path(name).chmod(0o755)
        yield Path(name)


def installed(python: str, version: str, wheel: Path, place: Path) -> Path:
    """Its programs. What it needs is lent by this environment, or fetched for another version."""
    made = place / "environment"
    done([python, "-m", "venv", "--without-pip", str(made)], place)
    into = [sys.executable, *PIP, "--python", str(made / "bin" / "python"), "install"]
    if version == OWN:
        lent = made / "lib" / f"python{version}" / "site-packages" / "lent.pth"
        lent.write_text(sysconfig.get_path("purelib") + "\n")
        done([*into, "--no-deps", "--force-reinstall", str(wheel)], place)
        return made / "bin"
    fetched = subprocess.run([*into, str(wheel)], capture_output=True, text=True, cwd=place)
    if fetched.returncode:
        pytest.skip(f"its packages cannot be had for Python {version}: {fetched.stderr[-300:]}")
    return made / "bin"


@pytest.mark.parametrize("version", VERSIONS)
def test_every_command_does_its_work(version: str, wheel: Path, place: Path) -> None:
    if version != OWN and not os.environ.get(EVERY_PYTHON):
        pytest.skip(f"{EVERY_PYTHON}=1 fetches all packages for Python {version}: minutes")
    python, user = chosen(version)
    programs = installed(python, version, wheel, place)
    home, empty = place / "home", place / "empty"
    for folder in (home, empty):
        folder.mkdir()
    home.chmod(0o555)
    if user is not None:
        shutil.chown(empty, user)
    environment = {
        "HOME": str(home),
        "PATH": f"{programs}:/usr/bin:/bin",
        "LANG": "C.UTF-8",
        "TMPDIR": str(empty),
    }
    for words, code in COMMANDS.items():
        ended = subprocess.run(
            [str(programs / "tentacled"), *words.split()],
            cwd=empty,
            env=environment,
            user=user,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            start_new_session=True,  # and with it no terminal to be opened by anybody
        )
        assert ended.returncode == code, f"{words}: {ended.stdout}{ended.stderr}"
        assert "Traceback" not in ended.stderr
        assert "\x1b" not in ended.stdout + ended.stderr, f"{words}: colours without a terminal"
    told = subprocess.run(
        [str(programs / "tentacled"), "status", "--json"],
        cwd=empty,
        env=environment,
        user=user,
        capture_output=True,
        text=True,
    )
    assert json.loads(told.stdout)["error"]["kind"] == "unavailable"
    if user is not None:  # root may write anywhere
        assert not list(home.iterdir())
