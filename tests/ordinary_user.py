"""Somebody who is not root, and the Pythons of this machine that such a one can run."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final, NamedTuple

import pytest

NOBODY = 65534
OWN_VERSION = f"{sys.version_info.major}.{sys.version_info.minor}"
_NOT_COPIED = shutil.ignore_patterns("site-packages", "test", "__pycache__", "*.a", "share")


@cache
def ordinary_user() -> int | None:
    """Nobody, for root to be. None: we are ordinary ourselves, or our packages lie where nobody
    can read them and be lent them."""
    if os.getuid() != 0:
        return None
    packages = sysconfig.get_path("purelib")
    seen = subprocess.run(["ls", packages], user=NOBODY, cwd="/", capture_output=True)
    return NOBODY if seen.returncode == 0 else None


class Interpreter(NamedTuple):
    """A Python, and what has to stand in the environment of whatever runs it."""

    path: str
    version: str
    environment: Mapping[str, str]


OWN: Final = Interpreter(sys.executable, OWN_VERSION, {})


def interpreter(version: str, folder: Path) -> Interpreter:
    """A Python of this version that an ordinary user can run: one that is here, or a copy of it in
    `folder`, which others must be able to look into. Skips where there is none."""
    for python in _interpreters(version):
        if _works(found := Interpreter(python, version, {})):
            return found
    for python in _interpreters(version):
        copied = folder / f"python{version}"
        if not copied.exists():
            prefix = Path(python).resolve().parents[1]
            shutil.copytree(prefix, copied, symlinks=True, ignore=_NOT_COPIED)
        program = copied / "bin" / f"python{version}"
        libraries = {"LD_LIBRARY_PATH": str(copied / "lib")}  # it looks where it was made for
        if _works(found := Interpreter(str(program), version, libraries)):
            return found
    pytest.skip(f"there is no Python {version} here")


def _interpreters(version: str) -> Iterator[str]:
    """Every one of this version that may be here."""
    yield from filter(None, (shutil.which(f"python{version}", path="/usr/bin:/usr/local/bin"),))
    if version == OWN_VERSION:
        yield str(Path(sys.executable).resolve())
    for folder in sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*")):
        yield str(folder / "bin" / f"python{version}")


def _works(python: Interpreter) -> bool:
    """For an ordinary user."""
    environment = {**os.environ, **python.environment}
    words = [python.path, "-c", "import ssl, venv"]
    try:
        ended = subprocess.run(
            words, user=ordinary_user(), cwd="/", env=environment, capture_output=True
        )
    except OSError:
        return False
    return ended.returncode == 0
