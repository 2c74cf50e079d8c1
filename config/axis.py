"""Axes: one controlled degree of actuation each, in the order of the actuation vector u.

Keys of the file have their unit in their name. The rest of the program asks an axis by its
unit-free face instead (`AxisBase`): whoever adds a kind of axis adds one class here, and to `Axis`.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from math import pi
from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from config.documents.model import ConfigModel, DriveTime, Name, NodeId, NotNegative, Positive

Range = Annotated[tuple[float, float], Field(strict=False)]
Permille = Annotated[int, Field(ge=1, le=5000)]


class Drive(ConfigModel):
    """Where an axis is on the bus, and what its drive must be told and must answer."""

    bus: Name
    node: NodeId
    axis: Annotated[int, Field(ge=0, le=3)] = 0
    """Axis within a multi-axis node: its objects stand at +0x800 per axis."""

    eds: str = "builtin:stepper.eds"
    """The drive's EDS file, relative to this file; `builtin:` for one that is shipped."""

    vendor_id: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] | None = None
    """Checked against 0x1018:1 where given: a swapped drive is refused."""

    product_code: Annotated[int, Field(ge=0, le=0xFFFFFFFF)] | None = None
    """Checked against 0x1018:2 where given."""

    heartbeat_period_s: DriveTime = 0.1
    """The drive's own heartbeat (0x1017)."""

    heartbeat_timeout_s: Positive = 0.25
    """The drive counts as lost when not heard for this long."""

    state_timeout_s: Positive = 0.1
    """... or when it has not sent its state (TPDO) for this long, and for at least five cycles."""

    mode: Literal["csp", "csv", "pp", "pv"] = "csp"
    """Cyclic position unless the drive is too old for it. `csv` and `pv` send velocities: every
    limit is kept as well, and a drive that gets no more of them stops by itself."""

    setpoint_timeout_s: DriveTime = 0.2
    """In `csv` and `pv`: a drive that has not got a velocity for so long stops by itself (0x1400:5,
    then 0x6007). The gate leaves it the way that it makes until then."""

    counts_per_turn: Annotated[int, Field(gt=0)]
    """Position counts (0x6064) per turn of the motor."""

    velocity_unit_counts_s: Positive = 1.0
    """Counts/s in one of the drive's own velocity units; accelerations go by it too. Some drives
    count velocities in rpm or mrpm whatever their position unit is."""

    inverted: bool = False
    """True where counting up moves the axis down."""

    rated_torque_nmm: Positive
    """0x6076 in N·mm: what 1000 per mille of torque means."""

    max_torque_permille: Permille = 1000
    """0x6072."""

    @property
    def goes_on_s(self) -> float:
        """How long the axis goes on with its last velocity when nothing is sent any more; one that
        is told positions goes no further than the last."""
        return self.setpoint_timeout_s if self.mode in ("csv", "pv") else 0.0


class SafeReaction(ConfigModel):
    """What the drive does by itself. A tendon must hold; a stage may coast."""

    connection_lost: Literal["quick_stop", "disable_voltage", "fault"] = "quick_stop"
    """Master gone (0x6007)."""

    quick_stop: Literal["ramp_then_off", "ramp_then_hold"] = "ramp_then_hold"
    """End of a quick stop (0x605A = 2 or 6)."""

    fault: Literal["off", "ramp_then_off"] = "ramp_then_off"
    """Fault reaction (0x605E = 0 or 2)."""


class Homing(ConfigModel):
    """Whether the drive knows its zero, and how it finds it (`tentacled home`)."""

    referenced: Literal["absolute_encoder", "home_at_start"] = "absolute_encoder"
    """`absolute_encoder`: it knows its zero whenever it is on. `home_at_start`: it loses it with
    its power; the robot does not arm before the axis has been homed."""

    referenced_bit: Annotated[int, Field(ge=8, le=15)] | None = None
    """Bit of the statusword (0x6041) in which the drive itself says that it knows its zero: 15 at
    an EPOS4. Where given, the drive is believed. None: it does not say."""

    method: Annotated[int, Field(ge=-128, le=127)] = 37
    """0x6098. 37: where it stands now."""

    timeout_s: Positive = 30.0
    """An axis that has not found its zero after this long is stopped."""


Quantity = Literal[
    "travel",
    "max_velocity",
    "max_acceleration",
    "quick_stop_deceleration",
    "following_error",
    "homing_speed",
    "homing_position",
]
"""What every axis has in its own unit."""

_PER_TIME: Final[dict[Quantity, str]] = {
    "travel": "",
    "max_velocity": "_s",
    "max_acceleration": "_s2",
    "quick_stop_deceleration": "_s2",
    "following_error": "",
    "homing_speed": "_s",
    "homing_position": "",
}
_TURN_RAD: Final = 2 * pi
_RANGE_RAD: Final = 1.0
"""What a rotation does to the tip turns with it: by more than a right angle it is the opposite, and
through a whole turn it is nothing. Over a radian more than half of it keeps its direction."""


class AxisBase(ConfigModel, ABC):
    """What every axis has, whatever it moves: positions are mm or rad, as `unit` says."""

    unit: ClassVar[Literal["mm", "rad"]]

    name: Name
    drive: Drive
    gear_ratio: Positive = 1.0
    """Turns of the motor per turn of the output."""
    safe: SafeReaction = SafeReaction()
    homing: Homing = Homing()
    following_error_time_s: DriveTime = 0.05
    """0x6066: how long the following error may last."""
    holds_without_power: bool = False
    """Whether gear, screw or brake keeps the axis where it is when its drive is off."""

    @property
    @abstractmethod
    def travel(self) -> tuple[float, float]:
        """Software limits, lowest and highest."""

    @property
    @abstractmethod
    def max_velocity(self) -> float:
        """Units per second."""

    @property
    @abstractmethod
    def max_acceleration(self) -> float:
        """Units per second squared."""

    @property
    @abstractmethod
    def quick_stop_deceleration(self) -> float:
        """Units per second squared."""

    @property
    @abstractmethod
    def following_error(self) -> float:
        """How far the axis may be from where it was told to be."""

    @property
    @abstractmethod
    def homing_speed(self) -> float:
        """Units per second."""

    @property
    @abstractmethod
    def homing_position(self) -> float:
        """Where the axis is, by its own scale, at what homing finds."""

    @property
    @abstractmethod
    def units_per_turn(self) -> float:
        """How far one turn of the output moves the axis."""

    @property
    def counts_per_unit(self) -> float:
        """Counts of the drive per mm or rad; negative where counting up moves the axis down."""
        sign = -1.0 if self.drive.inverted else 1.0
        return sign * self.drive.counts_per_turn * self.gear_ratio / self.units_per_turn

    @property
    def linear_range(self) -> float:
        """In shares of which controllers count: so far, what the axis does to the tip is about the
        same. Its travel, but for what turns."""
        lowest, highest = self.travel
        return highest - lowest

    @property
    def period(self) -> float | None:
        """After how much the body is where it was; None: never. Models of the body take positions
        modulo this, and nothing else does."""
        return None

    @property
    def piston_area_mm2(self) -> float | None:
        """Area of the cylinder's piston, where the axis drives a cylinder."""
        return None

    @property
    def tension_range_n(self) -> tuple[float, float] | None:
        """Slack and over-tension, where the axis pulls a tendon."""
        return None

    def key(self, quantity: Quantity) -> str:
        """Name of a quantity in the robot file, such as `max_velocity_mm_s`."""
        return f"{quantity}_{self.unit}{_PER_TIME[quantity]}"

    def problems(self) -> Iterator[tuple[str, str]]:
        """What cannot be, as far as this axis alone shows it: the key, and a sentence about it."""
        lowest, highest = self.travel
        if not lowest < highest:
            text = f"the lowest must come first and be lower, not {[lowest, highest]}"
            yield self.key("travel"), text


class LinearAxis(AxisBase):
    """An axis that is measured in mm."""

    unit = "mm"

    travel_mm: Range
    """Software limits (0x607D), lowest and highest."""
    max_velocity_mm_s: Positive
    max_acceleration_mm_s2: Positive
    quick_stop_deceleration_mm_s2: Positive
    """0x6085."""
    following_error_mm: Positive
    """0x6065."""
    homing_speed_mm_s: Positive = 2.0
    homing_position_mm: float = 0.0
    """Where the axis is at the switch or mark that homing finds (0x607C)."""

    @property
    def travel(self) -> tuple[float, float]:
        return self.travel_mm

    @property
    def max_velocity(self) -> float:
        return self.max_velocity_mm_s

    @property
    def max_acceleration(self) -> float:
        return self.max_acceleration_mm_s2

    @property
    def quick_stop_deceleration(self) -> float:
        return self.quick_stop_deceleration_mm_s2

    @property
    def following_error(self) -> float:
        return self.following_error_mm

    @property
    def homing_speed(self) -> float:
        return self.homing_speed_mm_s

    @property
    def homing_position(self) -> float:
        return self.homing_position_mm


class RotaryAxis(AxisBase):
    """An axis that is measured in rad."""

    unit = "rad"

    travel_rad: Range
    max_velocity_rad_s: Positive
    max_acceleration_rad_s2: Positive
    quick_stop_deceleration_rad_s2: Positive
    following_error_rad: Positive
    homing_speed_rad_s: Positive = 0.2
    homing_position_rad: float = 0.0
    """Where the axis is at the switch or mark that homing finds (0x607C)."""

    @property
    def travel(self) -> tuple[float, float]:
        return self.travel_rad

    @property
    def max_velocity(self) -> float:
        return self.max_velocity_rad_s

    @property
    def max_acceleration(self) -> float:
        return self.max_acceleration_rad_s2

    @property
    def quick_stop_deceleration(self) -> float:
        return self.quick_stop_deceleration_rad_s2

    @property
    def following_error(self) -> float:
        return self.following_error_rad

    @property
    def homing_speed(self) -> float:
        return self.homing_speed_rad_s

    @property
    def homing_position(self) -> float:
        return self.homing_position_rad

    @property
    def units_per_turn(self) -> float:
        return _TURN_RAD

    @property
    def linear_range(self) -> float:
        return min(super().linear_range, _RANGE_RAD)

    @property
    def period(self) -> float | None:
        return _TURN_RAD


class LinearStepper(LinearAxis):
    """A lead screw that may drive a cylinder."""

    kind: Literal["linear_stepper"]
    lead_mm: Positive
    """Travel per turn of the screw."""
    bore_mm: Positive | None = None
    """Bore of the cylinder: gives the axis a volume in mL. Leave out for a bare stage."""

    @property
    def units_per_turn(self) -> float:
        return self.lead_mm

    @property
    def piston_area_mm2(self) -> float | None:
        return None if self.bore_mm is None else pi / 4.0 * (self.bore_mm * self.bore_mm)


class TendonMotor(LinearAxis):
    """A motor with a spool; positive pulls."""

    kind: Literal["tendon_motor"]
    spool_radius_mm: Positive
    min_tension_n: NotNegative
    """Below this the tendon counts as slack."""
    max_tension_n: Positive

    @property
    def units_per_turn(self) -> float:
        return _TURN_RAD * self.spool_radius_mm

    @property
    def tension_range_n(self) -> tuple[float, float] | None:
        return self.min_tension_n, self.max_tension_n

    def problems(self) -> Iterator[tuple[str, str]]:
        yield from super().problems()
        if not self.min_tension_n < self.max_tension_n:
            yield "min_tension_n", f"must be below max_tension_n ({self.max_tension_n:g} N)"


class TubeTranslation(LinearAxis):
    """A lead screw that carries a tube; positive inserts."""

    kind: Literal["tube_translation"]
    lead_mm: Positive

    @property
    def units_per_turn(self) -> float:
        return self.lead_mm

    def problems(self) -> Iterator[tuple[str, str]]:
        yield from super().problems()
        yield from _let_go(self)


class TubeRotation(RotaryAxis):
    """A motor that turns a tube about its axis."""

    kind: Literal["tube_rotation"]

    def problems(self) -> Iterator[tuple[str, str]]:
        yield from super().problems()
        yield from _let_go(self)


def _let_go(tube: AxisBase) -> Iterator[tuple[str, str]]:
    """Tubes that are wound up in each other turn and slide back when they are let go, and after a
    fault every drive is without torque."""
    if not tube.holds_without_power:
        text = "a tube must not be let go: use a gear, a screw or a brake that holds it, and say so"
        yield "holds_without_power", text


Axis = Annotated[
    LinearStepper | TendonMotor | TubeTranslation | TubeRotation, Field(discriminator="kind")
]
