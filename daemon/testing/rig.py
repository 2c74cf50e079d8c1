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
            try:
                self.acquire()
            except BaseException:
                super().close()
                raise
        except ClientError as error:
            raise RigError(f"{robot}: {error}; start it with `tentacled run {file}`") from None

    def close(self) -> None:
        """Stop the robot, give the lease back, hang up.

        Whatever became of the stop: a lease that is kept on would let the robot go on too. Raises
        ClientError, and RigError where the drives have not said that they are off.
        """
        stopped = True
        try:
            if self.connected:
                stopped = self.stop().confirmed
        finally:
            super().close()
        if not stopped:
            raise RigError("the robot was stopped, and its drives have not said that they are off")
