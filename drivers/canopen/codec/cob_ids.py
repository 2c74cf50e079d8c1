"""The predefined connection set (CiA 301, 7.3.3): which identifier carries what.

Masters should look identifiers up, not take them apart: a PDO can be given any other identifier.
"""

from typing import Final

from drivers.canopen.codec.error import CodecError

NMT: Final = 0x000
SYNC: Final = 0x080
TIME: Final = 0x100

ALL_NODES: Final = 0
LOWEST_NODE: Final = 1
HIGHEST_NODE: Final = 127
PREDEFINED_PDOS: Final = 4

_EMERGENCY: Final = 0x080
_TPDO: Final = 0x180
_RPDO: Final = 0x200
_SDO_RESPONSE: Final = 0x580
_SDO_REQUEST: Final = 0x600
_HEARTBEAT: Final = 0x700


def emergency(node: int) -> int:
    """EMCY, node to all."""
    return _EMERGENCY + _checked(node)


def tpdo(node: int, number: int) -> int:
    """Transmit PDO 1 to 4, node to master."""
    return _TPDO + _pdo(node, number)


def rpdo(node: int, number: int) -> int:
    """Receive PDO 1 to 4, master to node."""
    return _RPDO + _pdo(node, number)


def sdo_response(node: int) -> int:
    """SDO, server (node) to client."""
    return _SDO_RESPONSE + _checked(node)


def sdo_request(node: int) -> int:
    """SDO, client to server (node)."""
    return _SDO_REQUEST + _checked(node)


def heartbeat(node: int) -> int:
    """Heartbeat, boot-up and node guarding, of any node, the master's own included."""
    return _HEARTBEAT + _checked(node)


def _checked(node: int) -> int:
    if not LOWEST_NODE <= node <= HIGHEST_NODE:
        raise CodecError(f"a node ID is {LOWEST_NODE} to {HIGHEST_NODE}, not {node}")
    return node


def _pdo(node: int, number: int) -> int:
    if not 1 <= number <= PREDEFINED_PDOS:
        raise CodecError(
            f"PDO {number} has no predefined identifier: only 1 to {PREDEFINED_PDOS} do"
        )
    return 0x100 * (number - 1) + _checked(node)
