"""A controller of somebody else's in a clean environment: wheel, project, its tests, its runs."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[3]
PIP = ("-m", "pip", "--disable-pip-version-check", "--quiet")


def done(words: list[str], folder: Path, **environment: str) -> str:
    """What it prints. It must end with 0."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    ended = subprocess.run(
        words, cwd=folder, env={**clean, **environment}, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, f"{words}: {ended.stdout}{ended.stderr}"
    return ended.stdout


@pytest.fixture
def environment(tmp_path: Path) -> Path:
    """A virtual environment with our wheel in it; what it needs is lent by this one."""
    source = tmp_path / "source"
    names = done(["git", "ls-files", "--cached", "--others", "--exclude-standard"], ROOT)
    for name in names.splitlines():
        if not name.startswith(("tests/", "docs/pictures")) and (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    build = ("wheel", "--no-deps", "--no-build-isolation", "-w", str(tmp_path / "dist"), ".")
    done([sys.executable, *PIP, *build], source)
    (wheel,) = (tmp_path / "dist").glob("*.whl")
    place = tmp_path / "environment"
    done([sys.executable, "-m", "venv", "--without-pip", str(place)], tmp_path)
    python = place / "bin" / "python"
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    # A path file of a lent folder is not read: the checkout stays out of it.
    lent = place / "lib" / version / "site-packages" / "lent.pth"
    lent.write_text(sysconfig.get_path("purelib") + "\n")
    install = ("install", "--no-deps", "--force-reinstall", "--no-build-isolation")
    done([sys.executable, *PIP, "--python", str(python), *install, str(wheel)], tmp_path)
    shutil.rmtree(source)
    return place


def test_a_made_project_runs_with_the_installed_wheel(environment: Path, tmp_path: Path) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    python, tentacled = environment / "bin" / "python", environment / "bin" / "tentacled"
    where = done([str(python), "-c", "import daemon; print(daemon.__file__)"], empty)
    assert where.startswith(str(environment))
    done([str(tentacled), "init", "controller", "arm_control"], empty)
    project = empty / "arm_control"
    install = ("install", "--no-deps", "--no-build-isolation", str(project))
    done([sys.executable, *PIP, "--python", str(python), *install], empty)
    listed = json.loads(done([str(tentacled), "plugins", "--json"], empty))["kinds"]
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
