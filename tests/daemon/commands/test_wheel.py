"""A controller of somebody else's in a clean environment: wheel, project, its tests, its runs."""

import json
import sys
from pathlib import Path

import pytest

from tests.installed_wheel import PIP, done, installed_wheel

pytestmark = pytest.mark.long


def test_a_made_project_runs_with_the_installed_wheel(tmp_path: Path) -> None:
    environment = installed_wheel(tmp_path)
    empty = tmp_path / "empty"
    empty.mkdir()
    python, tentacled = environment / "bin" / "python", environment / "bin" / "tentacled"
    where = done([str(python), "-c", "import daemon; print(daemon.__file__)"], empty)
    assert where.startswith(str(environment))
    done([str(tentacled), "init", "controller", "arm_control"], empty)
    project = empty / "arm_control"
    install = ("install", "--no-deps", "--no-build-isolation", str(project))
    done([sys.executable, *PIP, "--python", str(python), *install], empty)
    listed = json.loads(done([str(tentacled), "plugins", "--json"], empty))["result"]["kinds"]
    assert ("arm_control", "arm_control 0.1.0", "") in {
        (one["name"], one["source"], one["problem"]) for one in listed
    }
    told = done([str(python), "-m", "pytest", "-q", "-p", "no:cacheprovider", "tests"], project)
    assert "2 passed" in told
    experiment = [str(tentacled), "experiment", "arm_control/circle.yaml", "--out", "out"]
    done([*experiment, "--no-report"], empty)
    result = json.loads((empty / "out" / "result.json").read_text())
    assert result["controller"] == "arm_control"
    assert result["cycles"][0]["mean_mm"] < 1.0
    done([*experiment[:-1], "live", "--no-report", "--real-time"], empty)
    assert json.loads((empty / "live" / "result.json").read_text())["controller"] == "arm_control"
