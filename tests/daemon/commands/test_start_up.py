"""Whoever asks for help waits for nothing: what is slow to come is imported when it is wanted."""

import subprocess
import sys

import pytest

HEAVY = (
    *("numpy", "scipy", "numba", "torch", "matplotlib", "zenoh", "pydantic", "msgspec", "rich"),
    *("can", "canopen", "serial", "aiohttp", "cryptography", "trimesh", "mcap", "yaml", "asyncio"),
)
ONLY_A_CLIENT = ("numpy", "scipy", "numba", "torch", "matplotlib", "pydantic", "canopen", "trimesh")
"""What talks to a daemon has no use for these."""


def imported(words: str, names: tuple[str, ...]) -> set[str]:
    """Which of these are there once its help has been shown."""
    code = (
        "import sys\n"
        "from daemon.commands.terminal.command_line import main\n"
        "try:\n"
        f"    main([*{words.split()!r}, '--help'])\n"
        "except SystemExit:\n"
        f"    print(*[name for name in {names!r} if name in sys.modules], file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "usage: tentacled" in done.stdout
    return set(done.stderr.split())


def test_the_list_of_commands_needs_nothing_that_is_slow_to_come() -> None:
    assert imported("", HEAVY) == set()


@pytest.mark.parametrize(
    "command", ["report", "export", "recover", "environment", "completion", "man", "doctor"]
)
def test_what_reads_files_imports_what_it_needs_when_it_reads_them(command: str) -> None:
    assert imported(command, HEAVY) == set()


@pytest.mark.parametrize(
    "command",
    ["status", "lease", "arm", "home", "load", "start", "teleoperate", "stop", "dashboard"],
)
def test_what_talks_to_a_daemon_needs_no_plant_and_no_schema(command: str) -> None:
    assert imported(command, ONLY_A_CLIENT) == set()


@pytest.mark.parametrize("command", ["mdn", "risk", "plan", "explore", "pretrain", "kinematics"])
def test_what_learns_imports_no_torch_for_its_help(command: str) -> None:
    assert imported(command, ("torch", "matplotlib", "zenoh", "numba")) == set()
