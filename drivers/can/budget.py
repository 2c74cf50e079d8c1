"""How much of a bus a configuration will use, before anything is sent on it.

Worst-case frame lengths throughout. Two figures count: the load over a long time, and how full the
fullest cycle gets, when every PDO is due and a foreign frame came first. A cycle that is nearly
full leaves late frames to the next one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

from drivers.can.frame import worst_case_bits

WARN_LOAD: Final = 0.60
REFUSE_LOAD: Final = 0.80
"""Of the bit rate. What is left is for repeated frames and for what nobody has planned."""
WARN_CYCLE: Final = 0.80
REFUSE_CYCLE: Final = 1.00
"""Of a cycle: fuller than full, late frames pile up."""

_SDO_PER_S: Final = 20.0
_EMERGENCIES_PER_S: Final = 1.0
"""Settings and diagnosis while it runs: so many transfers, and one emergency. Chosen."""


@dataclass(frozen=True)
class CyclicPdo:
    """A PDO that goes out every `every_n_syncs`-th SYNC."""

    data_bytes: int
    every_n_syncs: int = 1


@dataclass(frozen=True)
class BusTraffic:
    """What will go over one bus."""

    bitrate_bit_s: int
    cycle_period_s: float
    pdos: Sequence[CyclicPdo]
    heartbeat_periods_s: Sequence[float]
    """Of every node, the master included."""


@dataclass(frozen=True)
class BusBudget:
    """Shares of what the bus can carry, 0 to 1 and beyond."""

    load: float
    """Over a long time."""
    fullest_cycle: float
    """In the worst cycle."""

    @property
    def refused(self) -> bool:
        """Whether the bus must not be run so."""
        return self.load > REFUSE_LOAD or self.fullest_cycle > REFUSE_CYCLE

    @property
    def warned(self) -> bool:
        """Whether the operator should hear of it."""
        return self.load > WARN_LOAD or self.fullest_cycle > WARN_CYCLE

    def __str__(self) -> str:
        return f"load {self.load:.1%}, fullest cycle {self.fullest_cycle:.1%}"


def bus_budget(traffic: BusTraffic) -> BusBudget:
    """The budget of one bus."""
    sync_bits = worst_case_bits(0)
    bits_per_s = (
        (sync_bits + _cyclic_bits(traffic.pdos)) / traffic.cycle_period_s
        + sum(worst_case_bits(1) / period for period in traffic.heartbeat_periods_s)
        + 2 * _SDO_PER_S * worst_case_bits(8)
        + _EMERGENCIES_PER_S * worst_case_bits(8)
    )
    fullest = sync_bits + sum(worst_case_bits(pdo.data_bytes) for pdo in traffic.pdos)
    blocking = worst_case_bits(8)
    return BusBudget(
        bits_per_s / traffic.bitrate_bit_s,
        (fullest + blocking) / (traffic.cycle_period_s * traffic.bitrate_bit_s),
    )


def _cyclic_bits(pdos: Iterable[CyclicPdo]) -> float:
    return sum(worst_case_bits(pdo.data_bytes) / pdo.every_n_syncs for pdo in pdos)
