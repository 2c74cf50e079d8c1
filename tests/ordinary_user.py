"""Somebody who is not root, and the Pythons of this machine that such a one can run."""

import os
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Iterator
from functools import cache
from pathlib import Path

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


def interpreter(version: str, folder: Path) -> str:
    """A Python of this version that an ordinary user can run: one that is here, or a copy of it in
    `folder`, which others must be able to look into. Skips where there is none."""
    for python in _interpreters(version):
        if _works_for_ordinary_users(python):
            return python
    for python in _interpreters(version):
        copied = folder / f"python{version}"
        if not copied.exists():
            prefix = Path(python).resolve().parents[1]
            shutil.copytree(prefix, copied, symlinks=True, ignore=_NOT_COPIED)
        if _works_for_ordinary_users(str(copied / "bin" / f"python{version}")):
            return str(copied / "bin" / f"python{version}")
    pytest.skip(f"there is no Python {version} here")


def _interpreters(version: str) -> Iterator[str]:
    """Every one of this version that may be here."""
    yield from filter(None, (shutil.which(f"python{version}", path="/usr/bin:/usr/local/bin"),))
    if version == OWN_VERSION:
        yield str(Path(sys.executable).resolve())
    for folder in sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*")):
        yield str(folder / "bin" / f"python{version}")


@cache
def _works_for_ordinary_users(python: str) -> bool:
    try:
        ended = subprocess.run(
            [python, "-c", "import ssl, venv"], user=ordinary_user(), cwd="/", capture_output=True
        )
    except OSError:
        return False
    return ended.returncode == 0
