"""The installed wheel for a user who may write in one empty folder only, without a terminal."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from daemon.commands.outcome.exit_codes import EXIT_OK, EXIT_UNAVAILABLE
from tests.installed_wheel import built_wheel, environment_with
from tests.ordinary_user import OWN_VERSION, interpreter, ordinary_user

pytestmark = pytest.mark.long

VERSIONS = ("3.11", "3.12", "3.13")
WITHIN_S = 600.0
EVERY_PYTHON = "TENTACLED_EVERY_PYTHON"

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


@pytest.fixture(scope="module")
def shared() -> Iterator[Path]:
    """That others can look into."""
    with TemporaryDirectory(prefix="wheel", dir="/tmp") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.fixture(scope="module")
def wheel(shared: Path) -> Path:
    return built_wheel(shared)


@pytest.fixture
def place() -> Iterator[Path]:
    with TemporaryDirectory(prefix="ro", dir="/tmp") as name:
        Path(name).chmod(0o755)
        yield Path(name)


@pytest.mark.parametrize("version", VERSIONS)
def test_every_command_does_its_work(version: str, wheel: Path, shared: Path, place: Path) -> None:
    if version != OWN_VERSION and not os.environ.get(EVERY_PYTHON):
        pytest.skip(f"{EVERY_PYTHON}=1 fetches all packages for Python {version}: minutes")
    user = ordinary_user()
    python = interpreter(version, shared)
    programs = environment_with(wheel, place, python) / "bin"
    home, empty = place / "home", place / "empty"
    for folder in (home, empty):
        folder.mkdir()
    home.chmod(0o555)
    if user is not None:
        shutil.chown(empty, user)
    environment = {
        **python.environment,
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
