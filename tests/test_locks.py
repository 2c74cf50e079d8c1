"""The lock files install with every Python that the package promises."""

import tomllib
from importlib.metadata import distribution
from pathlib import Path

from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).parents[1]
PINNED = sorted(
    {
        line.partition("==")[0]
        for lock in ("requirements.lock", "requirements-test.lock")
        for line in (ROOT / lock).read_text().splitlines()
    }
)


def oldest_python() -> str:
    about = tomllib.loads((ROOT / "pyproject.toml").read_text())
    (oldest,) = SpecifierSet(about["project"]["requires-python"])
    return f"{oldest.version}.0"


def test_what_is_pinned_works_with_the_oldest_python_promised() -> None:
    oldest = oldest_python()
    for package in PINNED:
        (asked,) = distribution(package).metadata.get_all("Requires-Python") or [""]
        assert SpecifierSet(asked).contains(oldest), (
            f"{package} wants Python {asked}: cap it in pyproject.toml, then `make lock`"
        )
