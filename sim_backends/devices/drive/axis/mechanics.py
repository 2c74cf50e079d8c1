"""What an emulated axis is made of: motor, encoder, end stops and switches."""

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True)
class AxisMechanics:
    """One axis. Positions in encoder counts, from an origin that no drive knows."""

    counts_per_turn: int = 4000
    rated_torque_nmm: float = 400.0
    start_counts: float = 0.0
    low_stop_counts: float = -inf
    high_stop_counts: float = inf
    low_switch_counts: float | None = None
    """The negative limit switch is closed here and below; None: there is none."""
    high_switch_counts: float | None = None
    """The positive limit switch is closed here and above; None: there is none."""
    absolute_encoder: bool = False
    """Whether the encoder knows its place when it is switched on; else it begins with 0 there."""
    index_counts: float = 0.0
    """The encoder's index pulse is here, and every turn from here."""

    @property
    def low_switch(self) -> float:
        """Where the negative limit switch closes."""
        return -inf if self.low_switch_counts is None else self.low_switch_counts

    @property
    def high_switch(self) -> float:
        """Where the positive limit switch closes."""
        return inf if self.high_switch_counts is None else self.high_switch_counts
