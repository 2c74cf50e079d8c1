"""NMT (CiA 301, 7.2.8): commands of the master, and the state that a node's heartbeat tells."""

from enum import IntEnum
from typing import Final, NamedTuple

from drivers.canopen.codec.cob_ids import HIGHEST_NODE
from drivers.canopen.codec.error import CodecError


class NmtCommand(IntEnum):
    """What the master can tell a node. Unconfirmed: the heartbeat shows whether it was heard."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """The state in a heartbeat. Boot-up is sent once, on entering pre-operational."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class Heartbeat(NamedTuple):
    """A heartbeat, or a node's answer to guarding, which alternates `toggle`."""

    state: NmtState
    toggle: bool = False


_TOGGLE: Final = 0x80
_COMMANDS: Final = {int(command): command for command in NmtCommand}
_STATES: Final = {int(state): state for state in NmtState}


def encode_nmt_command(command: NmtCommand, node: int) -> bytes:
    """A command for `node`; 0 for all nodes. Raises CodecError."""
    if not 0 <= node <= HIGHEST_NODE:
        raise CodecError(f"NMT reaches node 1 to {HIGHEST_NODE}, or 0 for all, not {node}")
    return bytes((command, node))


def decode_nmt_command(data: bytes) -> tuple[NmtCommand, int]:
    """Command and node, 0 for all nodes. Raises CodecError."""
    if len(data) != 2:
        raise CodecError(f"an NMT command has 2 bytes, not {len(data)}: '{data.hex()}'")
    command = _COMMANDS.get(data[0])
    if command is None:
        raise CodecError(f"0x{data[0]:02X} is no NMT command")
    if data[1] > HIGHEST_NODE:
        raise CodecError(f"NMT command for node {data[1]}: there is none above {HIGHEST_NODE}")
    return command, data[1]


def encode_heartbeat(state: NmtState, toggle: bool = False) -> bytes:
    """The byte that a node sends."""
    return bytes((state | (_TOGGLE if toggle else 0),))


def decode_heartbeat(data: bytes) -> Heartbeat:
    """The state that a node tells. Raises CodecError."""
    if len(data) != 1:
        raise CodecError(f"a heartbeat has 1 byte, not {len(data)}: '{data.hex()}'")
    state = _STATES.get(data[0] & ~_TOGGLE)
    if state is None:
        raise CodecError(f"0x{data[0]:02X} is no NMT state")
    return Heartbeat(state, bool(data[0] & _TOGGLE))
