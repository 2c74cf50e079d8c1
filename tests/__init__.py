"""Tests, which may import everything."""

from importlib.resources import files
from pathlib import Path
from typing import Final

SHIPPED_ROBOTS: Final = Path(str(files("config") / "robots"))
SOFT_ARM: Final = SHIPPED_ROBOTS / "soft_arm.yaml"
