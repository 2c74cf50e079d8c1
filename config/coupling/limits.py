"""Coupled limits: what several axes may not do together, however far each of them may go alone.

A limit bounds a sum of axes (or of coordinates, which are sums of axes themselves). It may count
only while other sums are near a value, as the snap of concentric tubes is near only while they bend
against each other.
"""

from abc import ABC, abstractmethod
from math import pi
from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints

from config.documents.model import ConfigModel, Name, Positive

Sum = Annotated[dict[Name, float], Field(min_length=1)]
"""Factors of axes or coordinates, by their names: `{carriage_inner: 1.0, carriage_pair: -1.0}`."""
Sentence = Annotated[str, StringConstraints(min_length=1, max_length=200)]


class ConditionBase(ConfigModel, ABC):
    """A sum is near a value."""

    unit: ClassVar[Literal["mm", "rad"]]

    sum: Sum
    """Factors of axes or coordinates, by their names."""

    @property
    @abstractmethod
    def near(self) -> float:
        """The value, in `unit`."""

    @property
    @abstractmethod
    def within(self) -> float:
        """How near is near: half the width of the band."""

    @property
    def period(self) -> float | None:
        """After how much there is the next such band; None: there is one only."""
        return None


class AngleCondition(ConditionBase):
    """A sum of angles is near one angle, or near it and all that are whole turns away."""

    unit = "rad"

    kind: Literal["angle"]
    near_rad: float
    """The middle of the band."""
    within_rad: Positive
    """Half the width of the band."""
    comes_round: bool = True
    """Whether whole turns make no difference."""

    @property
    def near(self) -> float:
        return self.near_rad

    @property
    def within(self) -> float:
        return self.within_rad

    @property
    def period(self) -> float | None:
        return 2.0 * pi if self.comes_round else None


class LengthCondition(ConditionBase):
    """A sum of lengths is near one length, or near it and all that are `period_mm` apart."""

    unit = "mm"

    kind: Literal["length"]
    near_mm: float
    """The middle of the band."""
    within_mm: Positive
    """Half the width of the band."""
    period_mm: Positive | None = None
    """After how much there is the next band; None: there is one only."""

    @property
    def near(self) -> float:
        return self.near_mm

    @property
    def within(self) -> float:
        return self.within_mm

    @property
    def period(self) -> float | None:
        return self.period_mm


Condition = Annotated[AngleCondition | LengthCondition, Field(discriminator="kind")]


class CoupledLimitBase(ConfigModel, ABC):
    """A sum that stays between its bounds."""

    unit: ClassVar[Literal["mm", "rad"]]

    name: Name
    reason: Sentence
    """What would happen beyond: told where the gate cuts a step short."""
    sum: Sum
    """Factors of axes or coordinates, by their names."""
    only_while: list[Condition] = Field(default_factory=list)
    """The limit counts only while all of these are met; empty: always."""

    @property
    @abstractmethod
    def lowest(self) -> float | None:
        """In `unit`; None: there is no such bound."""

    @property
    @abstractmethod
    def highest(self) -> float | None:
        """In `unit`; None: there is no such bound."""


class LengthLimit(CoupledLimitBase):
    """Of a sum of lengths."""

    unit = "mm"

    kind: Literal["length"]
    lowest_mm: float | None = None
    """None: the sum has no lower bound."""
    highest_mm: float | None = None
    """None: the sum has no upper bound."""

    @property
    def lowest(self) -> float | None:
        return self.lowest_mm

    @property
    def highest(self) -> float | None:
        return self.highest_mm


class AngleLimit(CoupledLimitBase):
    """Of a sum of angles, which count on from turn to turn."""

    unit = "rad"

    kind: Literal["angle"]
    lowest_rad: float | None = None
    """None: the sum has no lower bound."""
    highest_rad: float | None = None
    """None: the sum has no upper bound."""

    @property
    def lowest(self) -> float | None:
        return self.lowest_rad

    @property
    def highest(self) -> float | None:
        return self.highest_rad


CoupledLimit = Annotated[LengthLimit | AngleLimit, Field(discriminator="kind")]
