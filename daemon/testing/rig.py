"""A real robot under test: a client of its daemon, which somebody else has started."""

from pathlib import Path

from config.documents.problems import ConfigError
from config.loader import load_robot
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.blocking_client import BlockingRobotClient
from daemon.remote.client.client_errors import ClientError
from daemon.robot.runtime_directory import default_runtime_directory


class RigError(Exception):
    """What is missing for a test to move a real robot."""


class RigClient(BlockingRobotClient):
    """Holds the robot's lease from its making until `close`, which stops the robot first."""

    def __init__(self, file: Path, typed: str) -> None:
        """typed: the robot's name, as whoever starts the tests has typed it. Raises RigError."""
        try:
            robot = load_robot(file).robot.robot
        except ConfigError as error:
            raise RigError(str(error)) from None
        if typed != robot:
            raise RigError(f"it moves {robot}: --tentacled-rig-yes {robot} is not given")
        try:
            super().__init__(LocalAddress.in_folder(default_runtime_directory(robot)))
            self.acquire()
        except ClientError as error:
            raise RigError(f"{robot}: {error}; start it with `tentacled run {file}`") from None

    def close(self) -> None:
        """Stop the robot, give the lease back, hang up."""
        if self.connected:
            self.stop()
        super().close()
