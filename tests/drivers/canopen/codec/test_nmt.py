"""NMT commands and heartbeats."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import (
    Heartbeat,
    NmtCommand,
    NmtState,
    decode_heartbeat,
    decode_nmt_command,
    encode_heartbeat,
    encode_nmt_command,
)

COMMANDS = [
    ("0105", NmtCommand.START, 5),
    ("0200", NmtCommand.STOP, 0),
    ("807f", NmtCommand.ENTER_PRE_OPERATIONAL, 127),
    ("8101", NmtCommand.RESET_NODE, 1),
    ("8201", NmtCommand.RESET_COMMUNICATION, 1),
]

HEARTBEATS = [
    ("00", NmtState.BOOT_UP, False),
    ("04", NmtState.STOPPED, False),
    ("05", NmtState.OPERATIONAL, False),
    ("7f", NmtState.PRE_OPERATIONAL, False),
    ("85", NmtState.OPERATIONAL, True),
]


@pytest.mark.parametrize(("data", "command", "node"), COMMANDS)
def test_commands(data: str, command: NmtCommand, node: int) -> None:
    assert encode_nmt_command(command, node).hex() == data
    assert decode_nmt_command(bytes.fromhex(data)) == (command, node)


@pytest.mark.parametrize(("data", "state", "toggle"), HEARTBEATS)
def test_heartbeats(data: str, state: NmtState, toggle: bool) -> None:
    assert encode_heartbeat(state, toggle).hex() == data
    assert decode_heartbeat(bytes.fromhex(data)) == Heartbeat(state, toggle)


@pytest.mark.parametrize("data", ["", "01", "010203", "0305", "0180", "ff01"])
def test_no_command(data: str) -> None:
    with pytest.raises(CodecError):
        decode_nmt_command(bytes.fromhex(data))


@pytest.mark.parametrize("node", [-1, 128])
def test_no_command_for_such_a_node(node: int) -> None:
    with pytest.raises(CodecError, match="node"):
        encode_nmt_command(NmtCommand.START, node)


@given(st.binary(max_size=8))
def test_any_bytes_are_a_heartbeat_or_an_error(data: bytes) -> None:
    try:
        heartbeat = decode_heartbeat(data)
    except CodecError:
        assert len(data) != 1 or data[0] & 0x7F not in (0, 4, 5, 0x7F)
    else:
        assert encode_heartbeat(*heartbeat) == data
