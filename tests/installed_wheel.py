"""A virtual environment with our wheel in it, apart from the checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

ROOT = Path(__file__).parents[1]
PIP = ("-m", "pip", "--disable-pip-version-check", "--quiet")


def done(words: list[str], folder: Path, **environment: str) -> str:
    """What it prints. It must end with 0."""
    clean = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    ended = subprocess.run(
        words, cwd=folder, env={**clean, **environment}, capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, f"{words}: {ended.stdout}{ended.stderr}"
    return ended.stdout


def installed_wheel(tmp_path: Path) -> Path:
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
