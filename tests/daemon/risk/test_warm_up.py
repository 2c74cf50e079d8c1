"""What a source of the risk has compiled when it is made is all that a control step needs."""

import subprocess
import sys
from pathlib import Path

import pytest

from daemon.risk.mesh_file import write_mesh
from daemon.risk.model_file import write_model
from daemon.workbench.body_model.evaluation.shapes import box
from tests.daemon.risk.test_body_risk_source import ABOUT, write_robot
from tests.safety.risk.test_body_risk import arrays

ROOT = Path(__file__).parents[3]
STEPS = """
import sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from config.loader import load_robot
from daemon.host.clock import MonotonicClock
from daemon.risk.body_risk_source import make_risk_source
from safety.risk_source import GIVEN_TIP

def compiled():
    return {
        f"{module.__name__}.{name}": len(kernel.signatures)
        for module in list(sys.modules.values())
        if module.__name__.split(".")[0] in ("safety", "daemon")
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher)
    }

source = make_risk_source(load_robot(Path("robot.yaml")), MonotonicClock())
before = compiled()
decided = set()
t_ns = 0
for off_mm in (0.0, 3.0, 60.0, -60.0):
    for x in (0.0, 2.0, 3.0):
        t_ns += 25_000_000
        here, there = [x, 0.0, 0.0, 0.0], [x + 0.3, 0.0, 0.0, 0.0]
        source.compare([here, there], [10.0 * x - off_mm, 0.0, 200.0], t_ns, [0.0, 0.0, 1.0])
        reading = source.assess(here, there, t_ns)
        if reading.answers is not None:
            decided.add(reading.answers.decided_by)
            source.assess(there, here, t_ns)
        source.went(t_ns)
        source.minute_risk(t_ns)
        source.clearance(here, 0.05)
assert GIVEN_TIP in decided and len(decided) > 1, decided
print(sorted(set(compiled().items()) - set(before.items())))
"""


@pytest.mark.slow
def test_no_kernel_is_left_to_be_compiled_in_a_step(tmp_path: Path) -> None:
    write_model(tmp_path / "arm.npz", arrays(), ABOUT)
    write_mesh(tmp_path / "block.stl", box((40.0, 60.0, 60.0), (60.0, 0.0, 200.0), 4))
    write_robot(tmp_path, {"model": "arm.npz", "surface": {"mesh": "block.stl", "grid_mm": 2.0}})
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{STEPS}"]
    ended = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.strip() == "[]"
