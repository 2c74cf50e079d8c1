"""A gate, the risk that it is told, and axes that follow it, for the tests of the gate."""

from collections.abc import Callable, Sequence

from safety.gate import Decision, Gate, Measured
from safety.limits import CountLimits
from safety.risk_source import Nearest, RiskReading

# 500 counts per step at the highest velocity; from step to step 125 more, or less.
LIMITS = CountLimits(
    lowest=0, highest=100_000, max_velocity=20_000, max_acceleration=200_000, max_lag=2_000
)
STEP_NS = 25_000_000
COUNTS_PER_UNIT = 2000.0
THRESHOLD = 0.05
LATEST_S = 0.02

Risk = Callable[[Sequence[float], Sequence[float]], RiskReading | None]


NEAREST = Nearest(2.0, 150.0, (0.0, 1.0, 2.0), (3.0, 4.0, 5.0), ((6.0, 7.0, 8.0),))


class ToldRisk:
    """A source that answers as a test wants, and remembers what it was asked."""

    name = "told"

    def __init__(self, risk: Risk | float = 0.0) -> None:
        self.risk = risk
        self.asked: list[tuple[list[float], list[float], int]] = []

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        self.asked.append((list(u_from), list(u_to), t_ns))
        if callable(self.risk):
            return self.risk(u_from, u_to)
        return RiskReading(self.risk, self.risk / 10, 0.001, self.name, "as told", NEAREST)

    def clearance(self, u: object, risk: float) -> None:
        return None


def risky_beyond(u: float) -> ToldRisk:
    """Nothing up to `u`, certain contact beyond."""
    return ToldRisk(lambda _, u_to: RiskReading(float(u_to[0] > u), 0.5, 0.001, "told", "a wall"))


class Rig:
    """A gate whose axes are measured where they were last told to be, unless a test says where."""

    def __init__(
        self,
        axes: int = 1,
        *,
        at: int = 50_000,
        risk: ToldRisk | None = None,
        limits: CountLimits = LIMITS,
        tension_limits_n: tuple[float, float] | None = None,
        counts_per_unit: float = COUNTS_PER_UNIT,
    ) -> None:
        self.risk = risk or ToldRisk()
        self.gate = Gate(
            [limits] * axes,
            [counts_per_unit] * axes,
            [tension_limits_n] * axes,
            self.risk,
            THRESHOLD,
            LATEST_S,
        )
        self.t_ns = 0
        self.at = [at] * axes
        self.tension_n: float | None = None
        self.gate.settle(self.at)

    def measured(self, *positions: int | None) -> Measured:
        here: Sequence[int | None] = positions or self.at
        return Measured(here, [self.tension_n] * len(here))

    def decide(self, *targets: float, measured: Measured | None = None) -> Decision:
        """One step later."""
        self.t_ns += STEP_NS
        return self._moved(
            self.gate.decide(targets, measured or self.measured(), self.t_ns, STEP_NS)
        )

    def hold(self, measured: Measured | None = None) -> Decision:
        """One step later."""
        self.t_ns += STEP_NS
        return self._moved(self.gate.hold(measured or self.measured(), self.t_ns, STEP_NS))

    def run_up(self, *targets: float) -> None:
        """Until the axes are at their highest velocity towards the targets."""
        for _ in range(6):
            assert not self.decide(*targets).refused

    def _moved(self, decision: Decision) -> Decision:
        if decision.step is not None:
            self.at = list(decision.step.to_counts)
        return decision


def change(decision: Decision, axis: int = 0) -> int:
    """How far a decision lets one axis go."""
    assert decision.step is not None, decision.refused
    return decision.step.to_counts[axis] - decision.step.from_counts[axis]
