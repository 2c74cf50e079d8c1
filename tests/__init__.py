"""Tests, which may import everything."""

from importlib.resources import files
from pathlib import Path
from typing import Final

from daemon.host.compilation import forgive_caches

# Of tests, benchmarks and experiments alike: what was compiled of another version is forgiven.
forgive_caches()

SHIPPED_ROBOTS: Final = Path(str(files("config") / "robots"))
SOFT_ARM: Final = SHIPPED_ROBOTS / "soft_arm.yaml"
