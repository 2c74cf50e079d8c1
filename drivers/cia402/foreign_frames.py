"""Frames on the bus that neither we nor our nodes have sent: another master, or unknown nodes.

What a master says, nobody but us may say on our bus. Another one makes drives step twice, reset or
lose their limits, and from what they then do alone nobody could tell why.
"""

from collections.abc import Callable, Iterable
from struct import Struct
from typing import Final

from drivers.can.conditions import FOREIGN_FRAMES, FOREIGN_MASTER
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.nmt import NmtCommand
from drivers.conditions import Conditions

ENDS_AFTER_NS: Final = 1_000_000_000
"""So long nothing of the kind: any master's SYNC and heartbeat come more often."""

_LSS_COMMAND: Final = 0x7E5
_PDO_NUMBERS: Final = range(1, cob_ids.PREDEFINED_PDOS + 1)
_NODES: Final = range(cob_ids.LOWEST_NODE, cob_ids.HIGHEST_NODE + 1)

# What an SDO client asks for, in the top three bits of the first byte.
_SDO_ADDRESS: Final = Struct("<BHB")
_SPECIFIER: Final = 0xE0
_WRITES: Final = (0x20, 0xC0)
"""Downloads: expedited or in segments, and in blocks."""
_READS: Final = (0x40, 0xA0)

OnWrite = Callable[[int, int, int], None]
"""Somebody else writes to a node: which one, index and subindex."""


class ForeignFrames:
    """Keeps the conditions of one bus that tell of others on it."""

    def __init__(
        self,
        bus: str,
        master_node: int,
        rpdo_ids: Iterable[int],
        conditions: Conditions,
        on_write: OnWrite,
    ) -> None:
        """rpdo_ids: of our drives, wherever they were put. on_write: hears of every SDO write."""
        self._bus = bus
        self._conditions = conditions
        self._on_write = on_write
        self._master_ns: int | None = None
        self._others_ns: int | None = None
        """When each kind was last heard; None: not since it was last quiet."""
        self._explained = _what_masters_say(master_node, rpdo_ids)

    @property
    def master_present(self) -> bool:
        """Whether somebody else commands on this bus, as far as has been heard."""
        return self._master_ns is not None

    def received(self, can_id: int, data: bytes, t_ns: int) -> None:
        """A frame that no handler of ours wants."""
        explain = self._explained.get(can_id)
        if explain is None:
            self._others_ns = t_ns
            detail = f"identifier 0x{can_id:X}"
            self._conditions.set(FOREIGN_FRAMES, self._bus, t_ns, detail)
            return
        self._master_ns = t_ns
        self._conditions.set(FOREIGN_MASTER, self._bus, t_ns, explain(data))
        node = can_id - cob_ids.sdo_request(cob_ids.LOWEST_NODE) + cob_ids.LOWEST_NODE
        written = _written_object(data)
        if node in _NODES and written is not None:
            self._on_write(node, *written)

    def watch(self, t_ns: int) -> None:
        """What has not been heard for a while is over. Called again and again."""
        if self._master_ns is not None and t_ns - self._master_ns > ENDS_AFTER_NS:
            self._master_ns = None
            self._conditions.clear(FOREIGN_MASTER, self._bus, t_ns)
        if self._others_ns is not None and t_ns - self._others_ns > ENDS_AFTER_NS:
            self._others_ns = None
            self._conditions.clear(FOREIGN_FRAMES, self._bus, t_ns)

    def forget(self) -> None:
        """The link is gone: what was heard over it says nothing of the next one."""
        self._master_ns = self._others_ns = None


_Explain = Callable[[bytes], str]


def _what_masters_say(master_node: int, rpdo_ids: Iterable[int]) -> dict[int, _Explain]:
    """By identifier, how to say in words what it carries."""
    explained: dict[int, _Explain] = {
        cob_ids.NMT: _nmt,
        cob_ids.SYNC: lambda _: "SYNC",
        _LSS_COMMAND: lambda _: "LSS command",
        cob_ids.heartbeat(master_node): lambda _: f"heartbeat of master node {master_node}",
    }
    for node in _NODES:
        explained[cob_ids.sdo_request(node)] = _sdo_to(node)
        for number in _PDO_NUMBERS:
            explained[cob_ids.rpdo(node, number)] = _text(f"set-point for node {node}")
    for can_id in rpdo_ids:
        explained[can_id] = _text(f"set-point, identifier 0x{can_id:X}")
    return explained


def _text(text: str) -> _Explain:
    return lambda _: text


def _nmt(data: bytes) -> str:
    if len(data) < 2:
        return f"NMT command {data.hex()}"
    known = {command.value: command.name.lower().replace("_", " ") for command in NmtCommand}
    command = known.get(data[0], f"0x{data[0]:02X}")
    to = "all nodes" if data[1] == cob_ids.ALL_NODES else f"node {data[1]}"
    return f"NMT command '{command}' to {to}"


def _sdo_to(node: int) -> _Explain:
    def explain(data: bytes) -> str:
        written = _written_object(data)
        if written is not None:
            return f"SDO write to 0x{written[0]:04X}:{written[1]:02X} of node {node}"
        reads = data[:1] and data[0] & _SPECIFIER in _READS
        return f"SDO {'read' if reads else 'request'} of node {node}"

    return explain


def _written_object(data: bytes) -> tuple[int, int] | None:
    """Index and subindex, where the frame begins to write an object."""
    if len(data) < _SDO_ADDRESS.size:
        return None
    command, index, subindex = _SDO_ADDRESS.unpack_from(data)
    return (index, subindex) if command & _SPECIFIER in _WRITES else None
