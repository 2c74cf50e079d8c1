"""Indices of the objects that the master reads and writes (CiA 301 and CiA 402), and the modes of
operation: their numbers, and what a drive in each is sent."""

from dataclasses import dataclass
from typing import Final

# Of the node.
DEVICE_TYPE: Final = 0x1000
ERROR_HISTORY: Final = 0x1003
SYNC_COB_ID: Final = 0x1005
COMMUNICATION_CYCLE_PERIOD: Final = 0x1006
DEVICE_NAME: Final = 0x1008
GUARD_TIME: Final = 0x100C
STORE_PARAMETERS: Final = 0x1010
RESTORE_DEFAULTS: Final = 0x1011
EMERGENCY_COB_ID: Final = 0x1014
CONSUMER_HEARTBEAT: Final = 0x1016
PRODUCER_HEARTBEAT: Final = 0x1017
IDENTITY: Final = 0x1018
SYNC_COUNTER: Final = 0x1019
ERROR_BEHAVIOUR: Final = 0x1029

# Of axis 0; those of axis k stand at +0x800 k.
ABORT_CONNECTION_OPTION: Final = 0x6007
ERROR_CODE: Final = 0x603F
CONTROLWORD: Final = 0x6040
STATUSWORD: Final = 0x6041
QUICK_STOP_OPTION: Final = 0x605A
SHUTDOWN_OPTION: Final = 0x605B
DISABLE_OPERATION_OPTION: Final = 0x605C
FAULT_REACTION_OPTION: Final = 0x605E
MODE: Final = 0x6060
MODE_DISPLAY: Final = 0x6061
POSITION_ACTUAL: Final = 0x6064
FOLLOWING_ERROR_WINDOW: Final = 0x6065
FOLLOWING_ERROR_TIMEOUT: Final = 0x6066
MAX_TORQUE: Final = 0x6072
RATED_TORQUE: Final = 0x6076
TORQUE_ACTUAL: Final = 0x6077
TARGET_POSITION: Final = 0x607A
POSITION_RANGE_LIMIT: Final = 0x607B
HOME_OFFSET: Final = 0x607C
SOFTWARE_POSITION_LIMIT: Final = 0x607D
POLARITY: Final = 0x607E
MAX_PROFILE_VELOCITY: Final = 0x607F
PROFILE_VELOCITY: Final = 0x6081
PROFILE_ACCELERATION: Final = 0x6083
PROFILE_DECELERATION: Final = 0x6084
QUICK_STOP_DECELERATION: Final = 0x6085
GEAR_RATIO: Final = 0x6091
FEED_CONSTANT: Final = 0x6092
VELOCITY_FACTOR: Final = 0x6096
HOMING_METHOD: Final = 0x6098
HOMING_SPEEDS: Final = 0x6099
HOMING_ACCELERATION: Final = 0x609A
INTERPOLATION_PERIOD: Final = 0x60C2
TARGET_VELOCITY: Final = 0x60FF
SUPPORTED_MODES: Final = 0x6502

_AXIS_OFFSET: Final = 0x800
DEVICE_PROFILE_402: Final = 0x0192


def of_axis(index: int, axis: int) -> int:
    """Where object `index` of axis 0 stands for `axis`."""
    return index + _AXIS_OFFSET * axis


# Modes of operation.

HOMING_MODE: Final = 6


@dataclass(frozen=True)
class OperationMode:
    """One mode of operation."""

    number: int
    """0x6060."""
    text: str
    target: int
    """The object that carries the target: position or velocity, both 32 bits signed."""

    @property
    def is_velocity(self) -> bool:
        """Whether the target is a velocity."""
        return self.target == TARGET_VELOCITY


MODES: Final = {
    "pp": OperationMode(1, "profile position", TARGET_POSITION),
    "pv": OperationMode(3, "profile velocity", TARGET_VELOCITY),
    "csp": OperationMode(8, "cyclic synchronous position", TARGET_POSITION),
    "csv": OperationMode(9, "cyclic synchronous velocity", TARGET_VELOCITY),
}
CYCLIC_MODES: Final = ("csp", "csv")
"""Drives in these follow a stream of targets, one for each SYNC."""
