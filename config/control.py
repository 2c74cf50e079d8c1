"""How the robot is controlled and watched, apart from what is being followed."""

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

from pydantic import Field, model_validator

from config.documents.model import (
    ConfigModel,
    NotNegative,
    Positive,
    Quaternion,
    Vector3,
    checked_options,
)

Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Box = Annotated[tuple[float, float], Field(strict=False)]


class PoseFilterSettings(ConfigModel):
    """The Kalman filter between the tracker and the controller."""

    position_noise_mm: Positive = 0.2
    """Standard deviation of one measurement, per coordinate."""

    orientation_noise_rad: Positive = 0.01

    acceleration_mm_s2: Positive = 150.0
    """What the tip may do between two frames: standard deviation of the white acceleration."""

    angular_acceleration_rad_s2: Positive = 5.0

    outlier_sigma: Positive = 5.0
    """A measurement that is further from the prediction than this is not believed."""

    outliers_in_a_row: Annotated[int, Field(ge=2)] = 5
    """So many in a row that agree with each other are believed: the tip has moved."""

    predict_for_s: Positive = 0.15
    """How long the estimate may live on without a measurement."""


class Port(ConfigModel):
    """Where the body comes in: what of it is within this cylinder is not looked at."""

    centre_mm: Vector3
    inwards: Vector3
    """Direction of the cylinder's axis, into free space."""
    radius_mm: Positive
    depth_mm: NotNegative
    """From the centre inwards; outwards it has no end."""


class PlacedMesh(ConfigModel):
    """A closed mesh, and where it is in the base sensor's frame."""

    mesh: str
    """STL, OBJ or PLY: `builtin:` and the name of a shipped one, or relative to the robot file."""
    unit: Literal["mm", "cm", "m", "in"] = "mm"
    turned: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """How it is turned round its own origin, first."""
    at_mm: Vector3 = (0.0, 0.0, 0.0)
    """Where its origin is, then."""


class _Region(ConfigModel):
    """Base of what is drawn and not scanned."""

    name: str = ""
    """For people: it is told again with the surroundings."""
    keep: Literal["out", "in"] = "out"
    """Whether the body must not get into it, or not out of it."""


class BallRegion(_Region):
    """A ball."""

    kind: Literal["ball"]
    centre_mm: Vector3
    """In the base sensor's frame, as every place here."""
    radius_mm: Positive
    """From the centre to its surface."""


class BoxRegion(_Region):
    """A box with right angles."""

    kind: Literal["box"]
    centre_mm: Vector3
    """Where its diagonals meet."""
    size_mm: Annotated[tuple[Positive, Positive, Positive], Field(strict=False)]
    """From side to side, along its own x, y and z."""
    turned: Quaternion = (1.0, 0.0, 0.0, 0.0)
    """Round its centre."""


class _RegionRoundALine(_Region):
    """Base of what is round a straight line."""

    from_mm: Vector3
    """Where the line begins."""
    to_mm: Vector3
    """Where it ends."""
    radius_mm: Positive
    """From the line to the surface."""


class CapsuleRegion(_RegionRoundALine):
    """Everything within a radius of a straight line."""

    kind: Literal["capsule"]


class CylinderRegion(_RegionRoundALine):
    """Round a straight line, and flat at its ends."""

    kind: Literal["cylinder"]


class HalfSpaceRegion(_Region):
    """Everything behind a plane."""

    kind: Literal["half_space"]
    point_mm: Vector3
    """On the plane."""
    normal: Vector3
    """Out of it; of any length."""


Region = Annotated[
    BallRegion | BoxRegion | CapsuleRegion | CylinderRegion | HalfSpaceRegion,
    Field(discriminator="kind"),
]
MOST_BODIES: Final = 32
MOST_REGIONS: Final = 64


class Surface(PlacedMesh):
    """What the body may touch: closed meshes, which must not overlap, and regions, which may."""

    free: Literal["inside", "outside"] | None = None
    """On which side of the outermost surface the body may be; None: normals point there."""
    port: Port | None = None
    grid_mm: Positive | None = None
    """Distances are known on a grid of this spacing. Finer takes longer to make, once. None: half
    of the body's radius, but no more than 1.5; coarser where that would be too many places."""
    bodies: Annotated[list[PlacedMesh], Field(max_length=MOST_BODIES)] = Field(default_factory=list)
    """More meshes."""
    regions: Annotated[list[Region], Field(max_length=MOST_REGIONS)] = Field(default_factory=list)
    """Where the body must not be, or must stay, whatever is there."""


class MoreSurroundings(ConfigModel):
    """What a message adds to surroundings."""

    bodies: Annotated[list[PlacedMesh], Field(max_length=MOST_BODIES)] = Field(default_factory=list)
    regions: Annotated[list[Region], Field(max_length=MOST_REGIONS)] = Field(default_factory=list)


class _Surface(ConfigModel):
    surface: Surface


class _More(ConfigModel):
    surface: MoreSurroundings


def load_surface(mapping: Mapping[str, Any]) -> Surface:
    """Of a message. Raises OptionsError."""
    return checked_options(_Surface, "surface", mapping).surface


def load_more_surroundings(mapping: Mapping[str, Any]) -> MoreSurroundings:
    """Of a message. Raises OptionsError."""
    return checked_options(_More, "surface", mapping).surface


class RiskSettings(ConfigModel):
    """What the gate asks of the risk of collision."""

    model: str | None = None
    """What `tentacled mdn train` made of this robot's body: `builtin:` and the name of one that is
    shipped, or a file relative to the robot file. None: nothing is known of the risk, and none is
    assumed."""

    surface: Surface | None = None
    """Needed by a model, and needs one."""

    tip_load_g: NotNegative = 0.0
    """What hangs at the tip. A model that was made with another load is not believed."""

    oldest_days: Positive | None = None
    """A model whose clouds were seen longer ago is not believed: bodies change with use. It has to
    say when that was (`tentacled mdn collect --seen-on`). None: any age."""

    samples: Annotated[int, Field(ge=100, le=100_000)] = 1000
    """How many shapes of the body are tried. None of n that touches is a risk of 3/n."""

    threshold: Probability = 0.05
    """A step whose contact risk is above this is shortened or refused."""

    tip_accuracy_mm: Positive = 1.0
    """How well the measured tip is known to be the model's: standard deviation per coordinate, of
    the tracker's accuracy and of where the sensor sits. A tip that stays further from where the
    model has the body than this and the body's own spread explain makes the risk unavailable."""

    tip_accuracy_rad: Positive | None = 0.05
    """... and its direction, of a sensor that lies along the body. None: it says nothing of the
    body, as of a sensor that lies askew."""

    given_tip: bool = True
    """Whether the risk is told given the measured tip, while the model has nothing against it. Else
    the model alone decides, and what the tip is off by is only added."""

    most_in_a_minute: Probability | None = None
    """The motion is held where the body has touched something within the last minute with a higher
    probability. None: it is told, and nothing else."""

    most_on_path: Probability | None = None
    """A planned path is refused, or held, where the body touches something on all that is left of
    it with a higher probability. None: it is told, and nothing else."""

    slide: bool = True
    """Whether a step that leads too near to something is turned aside, to go along it, before the
    gate is asked. Otherwise the robot holds there."""

    latest_after_s: Positive = 0.02
    """A risk that took longer than this counts as maximum."""

    @model_validator(mode="after")
    def _both_or_none(self) -> "RiskSettings":
        if (self.model is None) != (self.surface is None):
            raise ValueError("a risk needs both `model` and `surface`")
        return self


class Workspace(ConfigModel):
    """Where the tip may be asked to go, in the base sensor's frame."""

    x_mm: Box
    y_mm: Box
    z_mm: Box

    @model_validator(mode="after")
    def _lowest_first(self) -> "Workspace":
        for lowest, highest in (self.x_mm, self.y_mm, self.z_mm):
            if not lowest < highest:
                raise ValueError("each range is lowest first, then highest")
        return self


class Supervision(ConfigModel):
    """When what is late or missing becomes a reason to stand still, or to switch off."""

    tracker_hold_after_s: Positive = 0.15
    """No believed tip for this long: HOLD."""

    tracker_fault_after_s: Positive = 3.0
    """... and for this long: power off."""

    tracker_quality: Probability = 0.6
    """Share of recent frames that must be there and believed; below: HOLD."""

    loop_hold_after_s: Positive = 0.06
    """A gap in the bus cycle of this length: HOLD."""

    loop_fault_after_s: Positive = 0.15
    """... of this length: FAULT. Shorter than the drives' own patience with their master: what they
    do by themselves says less about why."""

    lease_s: Positive = 2.0
    """A client that has not renewed its lease for this long has lost it."""

    lease_disarm_after_s: Positive = 15.0
    """Energised without any lease for this long: power off."""

    setpoint_hold_after_s: Positive = 0.25
    """In teleoperation: no valid set-point for this long: HOLD."""

    tracking_error_mm: Positive | None = None
    """How far the tip may be from its reference, beyond what the reference went in the last second,
    before it must be seen to come nearer. None: 3 % of the workspace's diagonal, 8 mm without
    one."""

    tracking_patience_s: Positive = 4.0
    """So long it may stay farther away and come no nearer: HOLD; half of it where it goes away. An
    abrupt load on a body with a dead time of 0.25 s and a lag of 0.5 s takes 3 s of it. A tip that
    is led away, as fast or faster all the time, is not waited for so long, but 1 s."""

    tip_jump_mm: Positive | None = None
    """A tip that is further from where it was a frame before than its motion explains, and stays
    there, has jumped: HOLD. For bodies that may snap to another shape. None: nobody looks."""

    arm_within_s: Positive = 5.0
    """The drives must be enabled this long after `arm`."""

    recording_required: bool = True
    """HOLD where the recorder fails and cannot be started again. Otherwise motion goes on, and is
    not recorded."""

    disk_free_mb: NotNegative = 500.0
    """Less free space where recordings go: no arming; a tenth of it: HOLD."""

    @model_validator(mode="after")
    def _hold_before_fault(self) -> "Supervision":
        for name in ("tracker", "loop"):
            hold_s: float = getattr(self, f"{name}_hold_after_s")
            fault_s: float = getattr(self, f"{name}_fault_after_s")
            if not hold_s < fault_s:
                raise ValueError(
                    f"{name}_hold_after_s ({hold_s:g} s) must be below "
                    f"{name}_fault_after_s ({fault_s:g} s)"
                )
        return self
