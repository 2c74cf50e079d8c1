"""Which PDOs each axis gets, and what they make of the bus budget.

Axis k of a node uses the node's PDO k+1 of the predefined connection set, whatever PDO numbers its
parameters stand under: a recording then explains itself. All other PDOs are switched off.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from struct import Struct
from typing import Final

from config.axis import Axis, Drive
from config.bus import Bus
from drivers.can.budget import BusTraffic, CyclicPdo
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.pdo import (
    PDOS_PER_AXIS,
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    TPDO_COMMUNICATION,
    TPDO_MAPPING,
    MappingEntry,
)
from drivers.cia402 import objects

RPDO_LAYOUT: Final = Struct("<Hi")
"""Controlword, target."""
TPDO_LAYOUT: Final = Struct("<Hih")
"""Statusword, actual position, actual torque."""

_MS: Final = 1000
_SLOW_CYCLE_S: Final = 0.004
"""On average a step waits for half a cycle: 2 ms are more than the whole step may take (1.5 ms)."""
_SHORTEST_STEP_S: Final = 0.015
"""Between two frames of the fastest tracker."""


@dataclass(frozen=True)
class PdoPlan:
    """One PDO of a node as it is to be set up."""

    communication: int
    """Index of its communication parameters."""
    mapping: int
    """Index of its mapping parameters."""
    can_id: int
    entries: tuple[MappingEntry, ...]
    deadline_ms: int = 0
    """Of an RPDO: where none comes for so long, the drive stops by itself; 0: it does not look."""


@dataclass(frozen=True)
class AxisPdos:
    """The two PDOs of an axis."""

    rpdo: PdoPlan
    tpdo: PdoPlan


def axis_pdos(drive: Drive) -> AxisPdos:
    """The PDOs of an axis: controlword and target out; status, position and torque in."""
    at, number = PDOS_PER_AXIS * drive.axis, drive.axis + 1

    def entry(index: int, bits: int) -> MappingEntry:
        return MappingEntry(objects.of_axis(index, drive.axis), 0, bits)

    return AxisPdos(
        PdoPlan(
            RPDO_COMMUNICATION + at,
            RPDO_MAPPING + at,
            cob_ids.rpdo(drive.node, number),
            (entry(objects.CONTROLWORD, 16), entry(objects.MODES[drive.mode].target, 32)),
            round(drive.goes_on_s * _MS),
        ),
        PdoPlan(
            TPDO_COMMUNICATION + at,
            TPDO_MAPPING + at,
            cob_ids.tpdo(drive.node, number),
            (
                entry(objects.STATUSWORD, 16),
                entry(objects.POSITION_ACTUAL, 32),
                entry(objects.TORQUE_ACTUAL, 16),
            ),
        ),
    )


def sends_steps_at_once(bus: Bus) -> bool:
    """Whether a new step is worth frames of its own: in a slow cycle its targets would wait."""
    return bus.cycle_period_s > _SLOW_CYCLE_S


def bus_traffic(name: str, bus: Bus, axes: Iterable[Axis]) -> BusTraffic:
    """What will go over bus `name`."""
    drives = [axis.drive for axis in axes if axis.drive.bus == name]
    heartbeats = {drive.node: drive.heartbeat_period_s for drive in drives}
    pdos = [CyclicPdo(RPDO_LAYOUT.size), CyclicPdo(TPDO_LAYOUT.size)] * len(drives)
    if sends_steps_at_once(bus):
        every = max(1, int(_SHORTEST_STEP_S / bus.cycle_period_s))
        pdos += [CyclicPdo(RPDO_LAYOUT.size, every)] * len(drives)
    return BusTraffic(
        bus.bitrate_bit_s,
        bus.cycle_period_s,
        pdos,
        [bus.master_heartbeat_period_s, *heartbeats.values()],
    )
