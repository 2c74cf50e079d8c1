"""Why a client does not get what it wants: reasons in place of zenoh's silence."""

from typing import Final

from daemon.messages import Refusal
from daemon.remote.reason_groups import reason_lines

ANSWERS_WITHIN_S: Final = 5.0
ARMS_WITHIN_S: Final = 20.0
HOMES_WITHIN_S: Final = 600.0
"""Axes are slow, and go one after the other; each has its own time limit in the robot file."""
PREPARES_WITHIN_S: Final = 150.0
"""Distances from 300 000 triangles take half a minute on a busy computer."""
"""How long a client waits, if it is not told otherwise."""


class ClientError(RuntimeError):
    """Base of all. The text says what is wrong and what to do."""


class DaemonNotRunningError(ClientError):
    """Nobody is there."""


class AccessDeniedError(ClientError):
    """The daemon is there, and does not know this user or does not let it do that."""


class DisconnectedError(ClientError):
    """The daemon has gone, or the way to it."""


class TimedOutError(ClientError):
    """The daemon is there and has not answered in time."""


class VersionMismatchError(ClientError):
    """Client and daemon speak different versions of the messages."""


class BadAnswerError(ClientError):
    """What came back is not what the daemon answers."""


class LeaseLostError(ClientError):
    """The lease ran out, or somebody else has it."""


class RefusedError(ClientError):
    """The daemon has refused, and said why."""

    def __init__(self, refusal: Refusal) -> None:
        lines = [refusal.text or refusal.name, *reason_lines(refusal.reasons)]
        super().__init__("\n".join(lines))
        self.refusal = refusal
