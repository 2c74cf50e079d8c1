"""What packages and programs of others may build on, by the names that stay.

Whatever is named here, its fields, methods and arguments are only added to while `API_VERSION`
stays; `docs/api.md` writes all of it down. Where it is defined may move. A name is imported when it
is first asked for: who needs a client does not wait for a plant.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

from config.documents.kinds import API_VERSION

if TYPE_CHECKING:
    from config.documents.kinds import Kind, KindError, KindOptions
    from config.emulation.plants import BodyExtent, PlantOptions
    from config.robot import Robot
    from config.tasks.controllers import TipFollowing
    from config.tasks.trajectory import Periodic, Pointed
    from daemon import messages
    from daemon.control.controller import Controller, ControllerError, Observation, Proposal
    from daemon.control.tip_following import TipFollower
    from daemon.recording.export.files import read_frame, read_frames
    from daemon.reference.trajectories import Cycle
    from daemon.remote.client.address import LocalAddress, TlsAddress
    from daemon.remote.client.blocking_client import BlockingRobotClient
    from daemon.remote.client.client import RobotClient
    from daemon.remote.client.client_errors import ClientError
    from daemon.robot.axes import AxisRanges
    from daemon.testing.labs import TestLab
    from daemon.testing.tracking_result import Figures, TrackingResult
    from drivers.pose import Pose
    from sim_backends.plants.plant import BodyState, Plant, PlantError, TipLoad

_HOMES: Final = {
    "Kind": "config.documents.kinds",
    "KindError": "config.documents.kinds",
    "KindOptions": "config.documents.kinds",
    "Robot": "config.robot",
    "Controller": "daemon.control.controller",
    "ControllerError": "daemon.control.controller",
    "Observation": "daemon.control.controller",
    "Proposal": "daemon.control.controller",
    "TipFollowing": "config.tasks.controllers",
    "TipFollower": "daemon.control.tip_following",
    "AxisRanges": "daemon.robot.axes",
    "Plant": "sim_backends.plants.plant",
    "PlantError": "sim_backends.plants.plant",
    "PlantOptions": "config.emulation.plants",
    "BodyExtent": "config.emulation.plants",
    "BodyState": "sim_backends.plants.plant",
    "TipLoad": "sim_backends.plants.plant",
    "Pose": "drivers.pose",
    "Pointed": "config.tasks.trajectory",
    "Periodic": "config.tasks.trajectory",
    "Cycle": "daemon.reference.trajectories",
    "RobotClient": "daemon.remote.client.client",
    "BlockingRobotClient": "daemon.remote.client.blocking_client",
    "LocalAddress": "daemon.remote.client.address",
    "TlsAddress": "daemon.remote.client.address",
    "ClientError": "daemon.remote.client.client_errors",
    "TestLab": "daemon.testing.labs",
    "TrackingResult": "daemon.testing.tracking_result",
    "Figures": "daemon.testing.tracking_result",
    "read_frame": "daemon.recording.export.files",
    "read_frames": "daemon.recording.export.files",
}

__all__ = [
    "API_VERSION",
    "AxisRanges",
    "BlockingRobotClient",
    "BodyExtent",
    "BodyState",
    "ClientError",
    "Controller",
    "ControllerError",
    "Cycle",
    "Figures",
    "Kind",
    "KindError",
    "KindOptions",
    "LocalAddress",
    "Observation",
    "Periodic",
    "Plant",
    "PlantError",
    "PlantOptions",
    "Pointed",
    "Pose",
    "Proposal",
    "Robot",
    "RobotClient",
    "TestLab",
    "TipFollower",
    "TipFollowing",
    "TipLoad",
    "TlsAddress",
    "TrackingResult",
    "messages",
    "read_frame",
    "read_frames",
]


def __getattr__(name: str) -> Any:
    if name == "messages":
        return import_module("daemon.messages")
    if name not in _HOMES:
        raise AttributeError(f"daemon.api has no {name}")
    return getattr(import_module(_HOMES[name]), name)
