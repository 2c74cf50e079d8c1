"""What can be wrong with a node or a drive, in words an operator can act on."""

from typing import Final

from drivers.conditions import Condition

ABSENT: Final = Condition(
    "node_absent",
    "the node does not answer",
    "check its power, its plug, its node ID and its bit rate",
)
LOST: Final = Condition(
    "node_lost",
    "the node's heartbeat has stopped",
    "check its power and its plug; it is set up anew by itself when it is back",
)
RESET: Final = Condition(
    "node_reset",
    "the node has restarted by itself",
    "its settings were gone and are being written again; check its power supply",
)
NOT_OPERATIONAL: Final = Condition(
    "node_not_operational",
    "the node has left the operational state by itself",
    "it has lost our heartbeat or found an error; it is set up anew by itself",
)
WRONG_DEVICE: Final = Condition(
    "node_wrong_device",
    "the node is not the device that the robot file names",
    "check node IDs, and vendor_id and product_code in the robot file",
)
NUMBER_TWICE: Final = Condition(
    "node_number_twice",
    "more than one node answers to this number",
    "give each drive a number of its own; another program that asks it meanwhile looks the same",
)
BAD_EDS: Final = Condition(
    "node_bad_eds",
    "the node's EDS file cannot be used",
    "get the EDS file from the drive's maker and name it in the robot file",
)
SETTING_REFUSED: Final = Condition(
    "node_setting_refused",
    "the node does not take a setting, or takes it and shows another",
    "the object and both values are named; the drive may need other limits, or another EDS file",
)
SAFETY_MISSING: Final = Condition(
    "node_safety_missing",
    "the node has no object for one of its own safety reactions",
    "know what it will not do by itself, and rely on the hardware for it",
)
SETTINGS_CHANGED: Final = Condition(
    "node_settings_changed",
    "settings of the node are not, or may not be, what they were set to",
    "the object is named; find out who writes to it; the node is set up anew by itself when its "
    "drives are off and nobody else commands them",
)
SDO_SILENT: Final = Condition(
    "node_sdo_silent",
    "the node does not answer requests",
    "check its power and its plug; if it still beats, switch it off and on",
)
PDO_SILENT: Final = Condition(
    "node_pdo_silent",
    "the node beats but does not send its state",
    "check that nobody else changes its PDOs; it is set up anew by itself",
)
PDO_MALFORMED: Final = Condition(
    "node_pdo_malformed",
    "the node sends its state in another form than it was told to",
    "check that nobody else changes its PDOs",
)
EMERGENCIES_UNHEARD: Final = Condition(
    "node_emergencies_unheard",
    "the node tells its errors (EMCY) where nobody listens, or not at all",
    "give 0x1014 its usual value, 0x80 and the node number, with the maker's software; which fault "
    "it has is read from the drive all the same",
)
EMERGENCY: Final = Condition(
    "drive_emergency",
    "the drive reports an error",
    "the code is named; its manual says more",
)
FAULT: Final = Condition(
    "drive_fault",
    "the drive has switched itself off",
    "remove the cause, then reset the fault",
)
FOLLOWING_ERROR: Final = Condition(
    "drive_following_error",
    "the axis does not follow its target",
    "look for something that blocks it; check its load, and its following error in the robot file",
)
WARNING: Final = Condition(
    "drive_warning",
    "the drive warns",
    "look at its display or its manual before it becomes a fault",
)
LIMIT_ACTIVE: Final = Condition(
    "drive_limit_active",
    "the drive holds back because of one of its own limits",
    "check travel, velocity and torque limits",
)
MODE_REFUSED: Final = Condition(
    "drive_mode_refused",
    "the drive is in another mode of operation than it was told",
    "check that it has this mode; old drives take pp or pv in the robot file",
)
NO_VOLTAGE: Final = Condition(
    "drive_no_voltage",
    "the drive has lost its motor voltage",
    "check the supply, the safe-torque-off input and the emergency stop circuit",
)
UNWILLING: Final = Condition(
    "drive_unwilling",
    "the drive does not go into the state it is told to",
    "its state is named; look for an open enable input or brake, or a fault at its display",
)
CYCLIC_MODE_NOT_LISTED: Final = Condition(
    "drive_mode_not_listed",
    "the drive does not list the mode it was told to use",
    "some products do not list all they have; watch whether it follows",
)
COUNTS_DIFFER: Final = Condition(
    "drive_counts_differ",
    "the drive counts in other units than the robot file says",
    "it goes further and faster, or less far, than it is told: correct 0x6091, 0x6092 and 0x6096 "
    "with the maker's software, or counts_per_turn and velocity_unit_counts_s in the robot file",
)
