"""A virtual environment with our wheel in it, apart from the checkout."""

import os
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

from tests.ordinary_user import OWN, OWN_VERSION, Interpreter

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


def built_wheel(folder: Path) -> Path:
    """Our wheel, made in `folder`."""
    source = folder / "source"
    names = done(["git", "ls-files", "--cached", "--others", "--exclude-standard"], ROOT)
    for name in names.splitlines():
        if not name.startswith(("tests/", "docs/pictures")) and (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    build = ("wheel", "--no-deps", "--no-build-isolation", "-w", str(folder / "dist"), ".")
    done([sys.executable, *PIP, *build], source)
    shutil.rmtree(source)
    (wheel,) = (folder / "dist").glob("*.whl")
    return wheel


def environment_with(wheel: Path, folder: Path, python: Interpreter = OWN) -> Path:
    """A virtual environment in `folder` with that wheel. What it needs is lent by this one; for
    another version of Python it is fetched, with what tests need, which takes minutes."""
    place = folder / "environment"
    done([python.path, "-m", "venv", "--without-pip", str(place)], folder, **python.environment)
    into = [sys.executable, *PIP, "--python", str(place / "bin" / "python"), "install"]
    if python.version != OWN_VERSION:
        asked = ("pip", "setuptools>=77", f"tentacled[test] @ {wheel.as_uri()}")
        done([*into, *asked], folder, **python.environment)
        return place
    # A path file of a lent folder is not read: the checkout stays out of it.
    lent = place / "lib" / f"python{OWN_VERSION}" / "site-packages" / "lent.pth"
    lent.write_text(sysconfig.get_path("purelib") + "\n")
    done([*into, "--no-deps", "--force-reinstall", "--no-build-isolation", str(wheel)], folder)
    return place


def installed_wheel(folder: Path) -> Path:
    """A virtual environment in `folder` with our wheel, for the Python that runs this."""
    return environment_with(built_wheel(folder), folder)
