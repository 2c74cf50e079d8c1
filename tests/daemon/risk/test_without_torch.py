"""Torch is for training only: whoever runs a robot has it neither installed nor loaded."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_UNAVAILABLE

ROOT = Path(__file__).parents[3]
LEARN = {
    "daemon.workbench.body_model.training.network",
    "daemon.workbench.body_model.training.training",
}
"""They import torch; so what imports them is for training only."""
SOURCES = [
    path
    for floor in ("config", "safety", "drivers", "sim_backends", "daemon")
    for path in sorted((ROOT / floor).rglob("*.py"))
]


def imports_at_once(path: Path) -> set[str]:
    """Modules that a file imports when it is itself imported."""
    found: set[str] = set()
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def test_only_what_trains_imports_torch() -> None:
    for path in SOURCES:
        named = path.relative_to(ROOT).as_posix()
        torch = {name for name in imports_at_once(path) if name.split(".")[0] == "torch"}
        module = named.removesuffix(".py").replace("/", ".")
        assert not torch or module in LEARN, f"{named} imports torch"


def test_nothing_that_serves_a_robot_imports_what_trains() -> None:
    modules = {
        path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."): imports_at_once(path)
        for path in SOURCES
    }
    reached, left = (
        set(),
        ["daemon.commands.host.run", "daemon.risk.model_file", "daemon.commands.workbench.mdn"],
    )
    left += [name for name in modules if name.startswith(("daemon.service", "daemon.loop"))]
    while left:
        name = left.pop()
        if name in modules and name not in reached:
            reached.add(name)
            left += modules[name]
    assert len(reached) > 50
    assert not reached & LEARN


BLOCKED = """
import sys
sys.modules["torch"] = None
from daemon.commands.terminal.command_line import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("word", ["train", "sweep", "evaluate"])
def test_without_torch_the_commands_say_how_to_get_it(word: str, tmp_path: Path) -> None:
    robot = ROOT / "config" / "robots" / "tendon_arm.yaml"
    words = ["mdn", word, str(robot), "clouds.npz", "--out", str(tmp_path / "out")]
    if word == "evaluate":
        words += ["--model", "model.npz"]
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, *words], capture_output=True, text=True, check=False
    )
    assert done.returncode == EXIT_UNAVAILABLE
    assert "pip install '.[training]'" in done.stderr
    assert not list(tmp_path.iterdir())
