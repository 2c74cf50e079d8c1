"""What can be wrong with a bus, in words an operator can act on."""

from typing import Final

from drivers.conditions import Condition

CANNOT_OPEN: Final = Condition(
    "bus_cannot_open",
    "the CAN interface cannot be opened",
    "check interface and channel in the robot file; on Linux: ip link show, and bring it up with "
    "ip link set can0 up type can bitrate 1000000 restart-ms 100",
)
TAKEN: Final = Condition(
    "bus_taken",
    "another program of this machine is the master of this bus",
    "it is named; a bus has one master: end that one, and the bus is opened by itself",
)
GONE: Final = Condition(
    "bus_gone",
    "the CAN interface has disappeared",
    "check the adapter's plug; the driver opens it again by itself when it is back",
)
DOWN: Final = Condition(
    "bus_down",
    "the CAN interface is down",
    "bring it up: ip link set can0 up",
)
OFF: Final = Condition(
    "bus_off",
    "the CAN controller is off the bus after too many errors",
    "check wiring, termination and bit rate; it comes back by itself if it was brought up with "
    "restart-ms 100",
)
PASSIVE: Final = Condition(
    "bus_error_passive",
    "the CAN controller sees many errors",
    "check wiring, termination and bit rate",
)
ERRORS: Final = Condition(
    "bus_errors",
    "the CAN adapter reports errors on the bus",
    "check wiring, termination and bit rate",
)
QUEUE_FULL: Final = Condition(
    "bus_queue_full",
    "the CAN interface takes no more frames",
    "nobody acknowledges, or its queue is short: check that the drives are powered, and "
    "ip link set can0 txqueuelen 128",
)
QUEUE_SHORT: Final = Condition(
    "bus_queue_short",
    "the CAN interface's queue is shorter than one cycle needs",
    "ip link set can0 txqueuelen 128",
)
OVERFLOW: Final = Condition(
    "bus_overflow",
    "frames were lost because the CAN interface or this machine was too slow",
    "lower the cycle rate, or use a faster adapter",
)
FOREIGN_MASTER: Final = Condition(
    "bus_foreign_master",
    "somebody else commands the drives on this bus",
    "a bus has one master: end the other program, or take its adapter off the bus",
)
FOREIGN_FRAMES: Final = Condition(
    "bus_foreign_frames",
    "somebody else sends on this bus",
    "take unknown nodes off the bus, or give them to a bus of their own",
)
OVERLOADED: Final = Condition(
    "bus_overloaded",
    "the bus carries more than 60 % of what it can",
    "lower the cycle rate, or spread the drives over two buses",
)
