"""All fuzz targets by name. Each takes any bytes and raises only where something is wrong."""

from collections.abc import Callable
from typing import Final

from tests.fuzz import fuzz_aurora, fuzz_can, fuzz_files, fuzz_risk

ALL: Final[dict[str, Callable[[bytes], None]]] = {
    name: target
    for module in (fuzz_aurora, fuzz_can, fuzz_files, fuzz_risk)
    for name, target in module.TARGETS.items()
}

SLOW: Final = 20
"""Targets that drive a whole device get so many times fewer inputs."""

WHOLE_DEVICES: Final = {
    "aurora_emulated_tracker",
    "emulated_drive",
    "robot_file",
    *fuzz_risk.TARGETS,
}
