"""What a report of a defect should name: of which version everything is."""

import platform
import sys
from importlib.metadata import PackageNotFoundError, version
from typing import Any, Final

from daemon.commands.outcome.result import program_version

_PACKAGES: Final = ("eclipse-zenoh", "numba", "numpy", "scipy", "python-can", "mcap", "msgspec")


def versions() -> dict[str, Any]:
    """By name; None: not installed."""
    from config.documents.kinds import API_VERSION

    return {
        "tentacled": program_version(),
        "api_version": API_VERSION,
        "python": sys.version.split()[0],
        "platform": platform.platform(),
        "packages": {name: _version(name) for name in _PACKAGES},
    }


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None
