"""All that can be wrong with the tracker, in words, and what helps."""

from drivers.conditions import Condition

PORT_MISSING = Condition(
    "port_missing",
    "the tracker's serial port does not exist",
    "plug in the tracker and switch it on; see /dev/serial/by-id for the name to put in the file",
)
PORT_DENIED = Condition(
    "port_denied",
    "no permission to open the tracker's serial port",
    "add yourself to the group of the port (usually dialout), then log out and in again",
)
PORT_BUSY = Condition(
    "port_busy",
    "another program holds the tracker's serial port",
    "end the other program; `fuser -v PORT` names it",
)
PORT_UNUSABLE = Condition(
    "port_unusable",
    "the tracker's serial port cannot be used",
    "check that the port in the file is the tracker's; unplug the adapter and plug it in again",
)
LINK_LOST = Condition(
    "link_lost",
    "the tracker's serial port went away while in use",
    "plug the cable in again; it is reopened by itself",
)
NO_ANSWER = Condition(
    "no_answer",
    "the port is open, but nothing answers at any baud rate, nor after a break",
    "switch the tracker on; check that the port is the tracker's and the cable is not a null modem",
)
WRONG_FAMILY = Condition(
    "wrong_family",
    "the device answers, but is not an Aurora",
    "put the Aurora's own port into the robot file",
)
RATE_REFUSED = Condition(
    "rate_refused",
    "the tracker cannot be used at the configured baud rate",
    "choose a lower baud_rate; above 115200 needs combined firmware 009 or newer, 921600 needs USB",
)
DEVICE_ERROR = Condition(
    "device_error",
    "the tracker refuses a command that it should carry out",
    "see the detail; if it stays, switch the tracker off and on",
)
BAD_REPLIES = Condition(
    "bad_replies",
    "the tracker's answers to a command stay unreadable",
    "check cable and adapter; lower the baud rate",
)
SILENT = Condition(
    "silent",
    "the tracker does not answer",
    "nothing to do if it returns; else check its power and its cable",
)
FROZEN = Condition(
    "frozen",
    "the tracker answers, but repeats one frame",
    "check the external frame synchronisation; else switch the tracker off and on",
)
CRC_ERRORS = Condition(
    "crc_errors",
    "bytes between tracker and computer get damaged",
    "shorten the cable or keep it away from motors; lower the baud rate; try hardware_handshake",
)
FRAMES_MISSED = Condition(
    "frames_missed",
    "more than one frame in twenty does not get through",
    "raise the baud rate; unplug unused tools; set the USB adapter's latency timer to 1 ms",
)
DEVICE_WARNING = Condition(
    "device_warning",
    "the tracker carried out a command, but has a remark",
    "see the detail",
)
DEVICE_RESET = Condition(
    "device_reset",
    "the tracker has restarted",
    "check its power supply if nobody did this; it is set up again by itself",
)
FIELD_GENERATOR_UNPLUGGED = Condition(
    "field_generator_unplugged",
    "the field generator is not connected",
    "plug the field generator into the system control unit",
)
CONFIGURATION_CHANGED = Condition(
    "configuration_changed",
    "a sensor interface was added or removed",
    "nothing to do: the tools are looked for again",
)
ALERT = Condition(
    "alert",
    "a component of the tracker reports a fault",
    "see the detail; switch the tracker off and on, and have it serviced if it stays",
)
TOOL_ABSENT = Condition(
    "tool_absent",
    "no plugged-in tool fits the description in the robot file",
    "plug the tool in, or correct its serial number or port in the file",
)
TOOL_NOT_PROGRAMMED = Condition(
    "tool_not_programmed",
    "a tool's memory is blank or faulty, so it cannot be tracked",
    "program it with the maker's tool software, or use another tool",
)
TOOL_REFUSED = Condition(
    "tool_refused",
    "the tracker cannot set up a tool",
    "unplug the tool and plug it in again; if it stays, the tool is faulty",
)
TOOL_UNIDENTIFIED = Condition(
    "tool_unidentified",
    "a tool reports no serial number",
    "unplug the tool and plug it in again; or name it by its port in the file",
)
TOOL_MISSING = Condition(
    "tool_missing",
    "the sensor is plugged in, but its pose cannot be measured",
    "keep metal away; check the sensor's lead; bring it into the measurement volume",
)
TOOL_DISABLED = Condition(
    "tool_disabled",
    "the tracker no longer follows this sensor",
    "plug the tool in again",
)
OUT_OF_VOLUME = Condition(
    "out_of_volume",
    "the sensor is outside the measurement volume: its accuracy is not specified",
    "move the robot or the field generator closer together",
)
PARTIALLY_OUT_OF_VOLUME = Condition(
    "partially_out_of_volume",
    "one of the sensor's two coils is outside the measurement volume",
    "move the robot or the field generator closer together",
)
SENSOR_FAULT = Condition(
    "sensor_fault",
    "the sensor or its lead is damaged, too close to the field generator, or disturbed",
    "see the detail; move it away from the field generator, else replace the tool",
)
IMPLAUSIBLE_POSE = Condition(
    "implausible_pose",
    "the tracker gave a pose that cannot be one",
    "nothing to do if it stays single; else switch the tracker off and on",
)

CONDITIONS = tuple(value for value in globals().values() if isinstance(value, Condition))
"""All of them, for lists and tests."""
