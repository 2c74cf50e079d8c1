"""Commands of the emulated tracker about tools: handles, what is behind them, their memory."""

import re

from drivers.aurora.codec.fields import hex_number
from drivers.aurora.codec.replies import OKAY
from drivers.aurora.codec.tool_information import (
    Fields,
    HandleList,
    encode_port_handles,
    encode_tool_information,
)
from sim_backends.devices.aurora import identity
from sim_backends.devices.aurora.command_interface import (
    BECAME_UNOCCUPIED,
    BLANK_MEMORY,
    INVALID_HANDLE,
    INVALID_LED,
    INVALID_LED_STATE,
    INVALID_LINE_STATE,
    INVALID_PRIORITY,
    MEMORY_WRITE_FAILED,
    NO_TOOL,
    NOT_INITIALISED,
    OUT_OF_RANGE,
    PARAMETER_COUNT,
    CommandedTracker,
    CommandError,
    Reply,
)
from sim_backends.devices.aurora.rack import MEMORY_BYTES, Handle

_MEMORY_BLOCK_BYTES = 64


def led(device: CommandedTracker, arguments: str) -> Reply:
    """LED."""
    _handle(device, arguments)
    if arguments[2:3] not in ("1", "2", "3"):
        raise CommandError(INVALID_LED)
    if arguments[3:] not in ("B", "F", "S"):
        raise CommandError(INVALID_LED_STATE)
    return OKAY


def output_lines(device: CommandedTracker, arguments: str) -> Reply:
    """PSOUT."""
    _handle(device, arguments)
    if re.fullmatch(r"[NSPO]{3}", arguments[2:]) is None:
        raise CommandError(INVALID_LINE_STATE)
    return OKAY


def list_handles(device: CommandedTracker, arguments: str) -> Reply:
    """PHSR."""
    which = hex_number(arguments or "00", "PHSR")
    if which not in {item.value for item in HandleList}:
        raise CommandError(OUT_OF_RANGE)
    device.look_for_tools()
    return encode_port_handles(device.rack.listed(HandleList(which)))


def free(device: CommandedTracker, arguments: str) -> Reply:
    """PHF."""
    _handle(device, arguments)
    del device.rack.handles[int(arguments[:2], 16)]
    return OKAY


def initialise_tool(device: CommandedTracker, arguments: str) -> Reply:
    """PINIT."""
    handle = _handle(device, arguments)
    if handle.gone:
        raise CommandError(BECAME_UNOCCUPIED)
    if handle.socket.blank and not handle.socket.definition:
        raise CommandError(BLANK_MEMORY)
    handle.initialised, handle.enabled = True, False
    return OKAY


def enable_tool(device: CommandedTracker, arguments: str) -> Reply:
    """PENA."""
    handle = _initialised_handle(device, arguments)
    if arguments[2:].upper() not in ("S", "D"):
        raise CommandError(INVALID_PRIORITY)  # B is for button boxes, and there is none
    handle.enabled = True
    return OKAY


def disable_tool(device: CommandedTracker, arguments: str) -> Reply:
    """PDIS."""
    _initialised_handle(device, arguments).enabled = False
    return OKAY


def tell_tool(device: CommandedTracker, arguments: str) -> Reply:
    """PHINF."""
    handle = _handle(device, arguments)
    options = hex_number(arguments[2:] or "0001", "PHINF")
    known = 0
    for field in Fields:
        known |= field
    if options & ~known or not options:
        raise CommandError(OUT_OF_RANGE)
    serial = device.serial_of(handle)
    return encode_tool_information(identity.tool_information(handle, Fields(options), serial))


def upload_definition(device: CommandedTracker, arguments: str) -> Reply:
    """PVWR."""
    handle, address, data = _memory_block(device, arguments)
    handle.socket.definition[address] = data
    return OKAY


def wire_test_definition(device: CommandedTracker, arguments: str) -> Reply:
    """TTCFG."""
    _handle(device, arguments).socket.definition[0] = bytes(_MEMORY_BLOCK_BYTES)
    return OKAY


def search_memory(device: CommandedTracker, arguments: str) -> Reply:
    """PSRCH."""
    tool = _handle(device, arguments).socket.tool
    return f"1{tool.serial}{tool.port:08X}"


def select_memory(device: CommandedTracker, arguments: str) -> Reply:
    """PSEL."""
    _handle(device, arguments)
    hex_number(arguments[2:], "PSEL")
    return OKAY


def read_memory(device: CommandedTracker, arguments: str) -> Reply:
    """PPRD, PURD."""
    handle = _handle(device, arguments)
    address = _memory_address(arguments[2:])
    return handle.socket.memory[address : address + _MEMORY_BLOCK_BYTES].hex().upper()


def write_memory(device: CommandedTracker, arguments: str) -> Reply:
    """PPWR, PUWR."""
    handle, address, data = _memory_block(device, arguments)
    block = slice(address, address + _MEMORY_BLOCK_BYTES)
    if any(handle.socket.memory[block]):
        raise CommandError(MEMORY_WRITE_FAILED)  # each block can be written once
    handle.socket.memory[block] = data
    handle.socket.blank = False
    return OKAY


def _handle(device: CommandedTracker, arguments: str) -> Handle:
    handle = device.rack.handles.get(hex_number(arguments[:2], "handle"))
    if handle is None:
        raise CommandError(INVALID_HANDLE)
    return handle


def _initialised_handle(device: CommandedTracker, arguments: str) -> Handle:
    handle = _handle(device, arguments)
    if handle.gone:
        raise CommandError(NO_TOOL)
    if not handle.initialised:
        raise CommandError(NOT_INITIALISED)
    return handle


def _memory_address(text: str) -> int:
    address = hex_number(text, "memory address")
    if len(text) != 4 or address % _MEMORY_BLOCK_BYTES or address >= MEMORY_BYTES:
        raise CommandError(OUT_OF_RANGE)
    return address


def _memory_block(device: CommandedTracker, arguments: str) -> tuple[Handle, int, bytes]:
    handle, address = _handle(device, arguments), _memory_address(arguments[2:6])
    digits = arguments[6:]
    hex_number(digits, "memory block")
    if len(digits) != 2 * _MEMORY_BLOCK_BYTES:
        raise CommandError(PARAMETER_COUNT)
    return handle, address, bytes.fromhex(digits)
