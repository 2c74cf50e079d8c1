"""The running daemon and the lab import no more than they run."""

import subprocess
import sys

import pytest

NEVER = (
    *("torch", "matplotlib", "trimesh", "filterpy"),
    *("scipy.stats", "scipy.optimize", "scipy.interpolate", "scipy.spatial"),
)
CODE = """
import sys
from daemon.commands.host import {command}
{more}
print(",".join(name for name in {never!r} if name in sys.modules))
"""
WARM = "from daemon.controllers.make_controller import warm_up; warm_up()"


@pytest.mark.parametrize(("command", "more"), [("run", WARM), ("emulate", "")])
def test_what_nobody_needs_at_run_time_is_not_imported(command: str, more: str) -> None:
    code = CODE.format(command=command, more=more, never=NEVER)
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
