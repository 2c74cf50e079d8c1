"""Where an emulated lab leaves its ports, and how a robot file's `lab:` names find them."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:  # `tentacled stop` must be quick, and needs no schema
    from config.robot import Robot

CONTROL_SOCKET: Final = "control.sock"
LAB_FILE: Final = "lab.json"


def default_runtime_directory(robot: str) -> Path:
    """The folder for `robot`'s ports where the operator names none."""
    return runtime_root() / robot


def lab_directories() -> list[Path]:
    """The folders where labs have been started by default."""
    return sorted(path.parent for path in runtime_root().glob(f"*/{LAB_FILE}"))


def uses_lab(robot: "Robot") -> bool:
    """Whether the robot file names anything of an emulated lab."""
    from config.bus import LAB

    names = [robot.tracker.port, *(bus.channel for bus in robot.buses.values())]
    return any(name.startswith(LAB) for name in names)


def with_lab_ports(robot: "Robot", directory: Path) -> "Robot":
    """The robot as it runs beside a lab: `lab:` names are paths in `directory`, and it is patient.

    What is not emulated stays as the robot file says.
    """
    from config.bus import LAB
    from config.patience import patient

    robot = patient(robot)

    def path(name: str) -> str:
        return str(directory / name.removeprefix(LAB)) if name.startswith(LAB) else name

    tracker = robot.tracker.model_copy(update={"port": path(robot.tracker.port)})
    buses = {
        name: bus.model_copy(update={"channel": path(bus.channel)})
        for name, bus in robot.buses.items()
    }
    return robot.model_copy(update={"tracker": tracker, "buses": buses})


def runtime_root() -> Path:
    """Where the folders of all robots are by default."""
    base = os.environ.get("XDG_RUNTIME_DIR")
    return Path(base) / "tentacled" if base else Path(f"/tmp/tentacled-{os.getuid()}")
