"""Whether another machine would compute the same: what its results depend on, by name."""

import hashlib
import platform
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

Facts = dict[str, str]

_PACKAGES: Final = ("tentacled", "numpy", "numba", "scipy", "msgspec", "pydantic")
_OURS: Final = ("config", "daemon", "drivers", "safety", "sim_backends")
_DATA: Final = ("models", "surfaces", "robots", "experiments", "studies")
"""Folders of `config` with what experiments name."""
_DIGITS: Final = 12


@cache
def facts() -> Facts:
    """Of this process. What differs in any of them computes something else, or may."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "missing"
    folders = [_folder(package) for package in _OURS]
    found["tentacled's code"] = _digest(
        [(folder, path) for folder in folders for path in folder.rglob("*.py")]
    )
    config = _folder("config")
    for name in _DATA:
        folder = config / name
        found[f"shipped {name}"] = _digest([(config, path) for path in folder.rglob("*")])
    return found


def differences(here: Facts, there: Facts) -> list[str]:
    """In words, one for each fact that is another one there."""
    names = [*here, *(name for name in there if name not in here)]
    return [
        f"{name} is {there.get(name, 'not told')} there and {here.get(name, 'not told')} here"
        for name in names
        if here.get(name) != there.get(name)
    ]


def _folder(package: str) -> Path:
    origin = import_module(package).__file__
    assert origin is not None  # each is a package with a file of its own
    return Path(origin).parent


def _digest(files: list[tuple[Path, Path]]) -> str:
    """Of names and contents, wherever they are installed."""
    whole = hashlib.sha256()
    named = {
        f"{folder.name}/{path.relative_to(folder).as_posix()}": path
        for folder, path in files
        if path.is_file() and "__pycache__" not in path.parts
    }
    for name, path in sorted(named.items()):
        whole.update(name.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return whole.hexdigest()[:_DIGITS]
