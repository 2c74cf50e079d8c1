"""What a message asks to follow, and with which controller: checked, or refused with all faults."""

from pathlib import Path
from typing import Any

from config.controllers import Broyden, ControllerOptions, load_controller_options
from config.options import OptionsError
from config.trajectory import load_trajectory_options
from daemon.control.trajectories import Trajectory, make_trajectory
from daemon.control.waypoints import WaypointError
from daemon.remote.messages import Load
from daemon.service.refused import RefusedError


def asked_trajectory(command: Load) -> Trajectory:
    """The trajectory of a `load`; names of files are seen from where the daemon runs."""
    try:
        options = load_trajectory_options(command.trajectory)
        return make_trajectory(options, Path.cwd(), command.cycles)
    except (OptionsError, WaypointError, ValueError) as error:
        raise RefusedError("bad_trajectory", str(error)) from None


def asked_controller(options: dict[str, Any] | None) -> ControllerOptions:
    """The controller of a message; without any, the one that needs to know nothing."""
    if options is None:
        return Broyden(kind="broyden")
    try:
        return load_controller_options(options)
    except OptionsError as error:
        raise RefusedError("bad_controller", str(error)) from None
