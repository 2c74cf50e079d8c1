"""How much the bus carries."""

from dataclasses import dataclass


@dataclass(frozen=True)
class BusStatistics:
    """What the bus has seen since it began."""

    t_ns: int
    frames: int
    error_frames: int
    busy_ns: int

    def load_since(self, earlier: "BusStatistics") -> float:
        """Share of the time since `earlier` in which the bus was busy, 0 to 1."""
        return (self.busy_ns - earlier.busy_ns) / max(1, self.t_ns - earlier.t_ns)
