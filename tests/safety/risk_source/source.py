"""A source of risk that answers as it is told."""

from collections.abc import Sequence

from safety.risk_source import (
    Clearance,
    RiskReading,
)

LATEST_S = 0.02


class Source:
    """Answers as it is told; an exception is raised."""

    name = "a model"

    def __init__(
        self, answer: RiskReading | Exception | None, clearance: Clearance | Exception | None = None
    ) -> None:
        self.answer = answer
        self.given_clearance = clearance
        self.looked: list[tuple[Sequence[float], float]] = []
        self.asked: list[tuple[Sequence[float], Sequence[float], int]] = []

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        self.asked.append((u_from, u_to, t_ns))
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer

    def clearance(self, u: Sequence[float], risk: float) -> Clearance | None:
        self.looked.append((u, risk))
        if isinstance(self.given_clearance, Exception):
            raise self.given_clearance
        return self.given_clearance
