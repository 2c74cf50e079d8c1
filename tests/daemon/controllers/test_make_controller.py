"""Controllers are imported when they are asked for, or all of them before anything moves."""

import subprocess
import sys

import pytest

from config.documents.kinds import CONTROLLERS, entries

NAMES = [name for name, entry in entries(CONTROLLERS).items() if entry.shipped]

NEWLY_IMPORTED = """
import sys
from config.tasks.controllers import load_controller_options
from config.loader import load_robot
from daemon.controllers.make_controller import import_all, make_controller
from tests import SHIPPED_ROBOTS, SOFT_ARM
robot = load_robot(SOFT_ARM).robot
tubes = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml").robot
if {before}:
    import_all()
known = set(sys.modules)
for kind in {kinds}:
    options = {{"kind": kind}}
    if kind == "learned_kinematics":  # knows nothing by itself
        options["model"] = "builtin:concentric_tubes_pose.npz"
    its_robot = tubes if "model" in options else robot
    make_controller(load_controller_options(options), its_robot, seed=1)
came = set(sys.modules) - known
print(*sorted(name for name in came if name.startswith(("daemon.", "scipy."))))
"""


def newly_imported(kinds: list[str], before: bool) -> list[str]:
    """Modules that came with the making of controllers, in a fresh process."""
    program = NEWLY_IMPORTED.format(before=before, kinds=kinds)
    command = [sys.executable, "-c", program]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()


def test_after_all_were_imported_making_one_imports_nothing() -> None:
    assert newly_imported(NAMES, before=True) == []


@pytest.mark.parametrize("kind", ["broyden", "constant_curvature"])
def test_a_controller_that_learns_nothing_comes_without_what_learns(kind: str) -> None:
    came = newly_imported([kind], before=False)
    assert f"daemon.controllers.{kind}" in came
    assert not [
        name for name in came if name.startswith(("daemon.learning.lwpr.model", "scipy.linalg"))
    ]
