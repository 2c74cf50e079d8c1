"""What can be wrong with bytes, and what the device's own error and warning codes mean."""

from collections.abc import Mapping
from typing import NamedTuple


class CodecError(ValueError):
    """Bytes that are no command or reply of the Combined API. The only error of the codec."""

    def __init__(self, text: str, bad_crc: bool = False) -> None:
        super().__init__(text)
        self.bad_crc = bad_crc


class Meaning(NamedTuple):
    """What a code says, and what helps."""

    text: str
    remedy: str


_BUG = "report it with a recording: the driver should never cause this"
_RETRY = "it was repeated by itself; if it stays, shorten the cable or lower the baud rate"
_POWER = "switch the system control unit off and on; if it stays, have it serviced"
_HARDWARE = "check that control unit, field generator and sensor interfaces belong together"
_FIRMWARE = "update the firmware of control unit and sensor interfaces to one combined revision"
_TOOL = "unplug the tool and plug it in again; if it stays, the tool is faulty"
_PROGRAM = "program the tool's memory with the maker's tool software, or use another tool"

ERRORS: Mapping[int, Meaning] = {
    0x01: Meaning("the device does not know the command", _RETRY),
    0x02: Meaning("the command was too long", _RETRY),
    0x03: Meaning("the command was too short", _RETRY),
    0x04: Meaning("the command arrived with a wrong checksum", _RETRY),
    0x05: Meaning("the device ran out of time", "check the external frame synchronisation"),
    0x06: Meaning("the device does not take these line settings", "choose a lower baud_rate"),
    0x07: Meaning("wrong number of parameters", _BUG),
    0x08: Meaning("there is no such port handle", _TOOL),
    0x09: Meaning("the tool cannot be tracked in this way", _TOOL),
    0x0A: Meaning("there is no such LED", _BUG),
    0x0B: Meaning("the LED has no such state", _BUG),
    0x0C: Meaning("not possible in the device's present mode", _BUG),
    0x0D: Meaning("there is no tool at this handle", _TOOL),
    0x0E: Meaning("the tool is not initialised", _TOOL),
    0x0F: Meaning("the tool is not enabled", _TOOL),
    0x10: Meaning("the system is not initialised", _BUG),
    0x11: Meaning("the device cannot stop tracking", _POWER),
    0x12: Meaning("the device cannot start tracking", _HARDWARE),
    0x13: Meaning("the tool cannot be initialised: its memory is blank or faulty", _PROGRAM),
    0x14: Meaning("the field generator's characterisation is missing or does not fit", _HARDWARE),
    0x15: Meaning("the system cannot be initialised", _HARDWARE),
    0x16: Meaning("the device cannot start its diagnosis", _POWER),
    0x17: Meaning("the device cannot stop its diagnosis", _POWER),
    0x19: Meaning("the device cannot read its firmware revision", _POWER),
    0x1A: Meaning("internal error of the device", _POWER),
    0x1D: Meaning("the tool's memory was not found", _TOOL),
    0x1E: Meaning("the tool's memory cannot be read", _TOOL),
    0x1F: Meaning("the tool's memory cannot be written", _TOOL),
    0x20: Meaning("the tool's memory cannot be selected", _TOOL),
    0x22: Meaning("the tool is not made for the selected volume", "select another volume"),
    0x23: Meaning("a parameter is out of range", _BUG),
    0x24: Meaning("the volume cannot be selected", "select another volume"),
    0x25: Meaning("the device cannot tell its features", _POWER),
    0x28: Meaning("too many tools", "unplug tools"),
    0x29: Meaning("the firmware is corrupt", _FIRMWARE),
    0x2A: Meaning("the device is out of memory", _POWER),
    0x2B: Meaning("the port handle is not allocated", _TOOL),
    0x2C: Meaning("the tool was unplugged", "plug the tool in again"),
    0x2D: Meaning("no port handle is left", "unplug tools, or switch the control unit off and on"),
    0x2E: Meaning("the firmware revisions do not fit together", _FIRMWARE),
    0x2F: Meaning("the port is not described", _BUG),
    0x30: Meaning("the port is taken", _BUG),
    0x31: Meaning("the input or output line has no such state", _BUG),
    0x32: Meaning("the operation is not valid", _BUG),
    0x33: Meaning("the device does not have this feature", _FIRMWARE),
    0x34: Meaning("the device does not have this parameter", _FIRMWARE),
    0x35: Meaning("the parameter is of another type", _BUG),
    0x36: Meaning("the parameter's value is out of range", _BUG),
    0x37: Meaning("the parameter's index is out of range", _BUG),
    0x38: Meaning("the parameter's value has another size", _BUG),
    0x39: Meaning("the parameter cannot be written", _BUG),
    0x3A: Meaning("the answer is too long for the device", _BUG),
    0x3B: Meaning("the device cannot open a file", _POWER),
    0x3C: Meaning("the device cannot read a file", _POWER),
    0x3D: Meaning("the device cannot write a file", _POWER),
    0x3E: Meaning("the device's file system is full or faulty", _POWER),
    0x40: Meaning("the tool definition is faulty", _PROGRAM),
    0x41: Meaning("the tool definition is not for this device", _PROGRAM),
    0x42: Meaning("a component is not there", "plug it in; check the cables"),
    0xC2: Meaning("the command needs another mode of the line", _BUG),
    0xC3: Meaning("the device is off line", _POWER),
    0xC4: Meaning("the device is busy on another line", "end the other program"),
    0xC5: Meaning("binary replies need 8 data bits", _BUG),
    0xF4: Meaning("the flash memory cannot be erased", _POWER),
    0xF5: Meaning("the flash memory cannot be written", _POWER),
    0xF6: Meaning("the flash memory cannot be read", _POWER),
}

WARNINGS: Mapping[int, Meaning] = {
    0x01: Meaning("possible hardware fault", _POWER),
    0x02: Meaning("the tool breaks a rule of its geometry", _PROGRAM),
    0x03: Meaning("the tool may be taken for another one", _PROGRAM),
    0x04: Meaning("the tool breaks a rule and may be taken for another one", _PROGRAM),
    0x05: Meaning("the tool definition lacks a setting", _PROGRAM),
}


def error_meaning(code: int) -> Meaning:
    """What ERRORhh with this code says; a reserved code says that it is one."""
    return ERRORS.get(code, Meaning("reserved error code", "see the device's own manual"))


def warning_meaning(code: int) -> Meaning:
    """What WARNINGhh with this code says; a reserved code says that it is one."""
    return WARNINGS.get(code, Meaning("reserved warning code", "see the device's own manual"))
