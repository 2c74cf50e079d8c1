"""What the daemon tells by itself, step by step, and what it records besides."""

import msgspec

from daemon.messages.base import Message
from daemon.messages.commands import MovingObstacle
from daemon.messages.status import LoopStatus, Status


class Tip(Message, frozen=True, kw_only=True, tag="tip/1"):
    """One control step: where the tip is, and where it should be. Base sensor's frame."""

    sequence: int
    t_ns: int
    """When this was measured."""
    state: str
    measured_mm: list[float] | None = None
    """As the tracker gave it; None where this frame had none."""
    tip_mm: list[float] | None = None
    """Filtered."""
    velocity_mm_s: list[float] | None = None
    quaternion: list[float] | None = None
    """Scalar first."""
    reference_mm: list[float] | None = None
    error_mm: float | None = None
    cycle: int = -1
    age_s: float | None = None
    believed: bool = True
    """Whether the filter took this frame for a measurement and not for an outlier."""
    measured_quaternion: list[float] | None = None
    """As the tracker gave it. This and all of the following only where the reference says where to
    point."""
    direction: list[float] | None = None
    """Unit vector along the tip's axis. Filtered."""
    reference_direction: list[float] | None = None
    error_rad: float | None = None
    """Angle between the two."""
    expected_mm: float | None = None
    """How far off the controller expects the tip to be, root mean square; None: it does not know.
    """


class Axes(Message, frozen=True, kw_only=True, tag="axes/1"):
    """One control step: the actuation vector u, each element in its axis' own unit."""

    sequence: int
    t_ns: int
    actual: list[float]
    target: list[float]
    """Where the drives are told to be now."""
    proposed: list[float] | None = None
    """The change that the controller asked for in this step."""
    permitted: list[float] | None = None
    """The change that the gate let through."""
    force: list[float]


class Risk(Message, frozen=True, kw_only=True, tag="risk/1"):
    """One control step: what the gate was told and what it did."""

    sequence: int
    t_ns: int
    source: str
    contact_risk: float | None = None
    body_point_risk: float | None = None
    threshold: float
    scale: float
    reasons: list[str]
    """Which limits made it reduce the step."""
    detail: str = ""
    minute_risk: float | None = None
    """Probability that something was touched in the last minute, one body for all of its steps."""
    path_risk: float | None = None
    """... and that something is touched on the rest of the planned path that is followed."""
    clearance_mm: float | None = None
    """One in twenty of the shapes that the body may have has no more."""
    arc_mm: float | None = None
    """Where along the body that is, ..."""
    place_mm: list[float] | None = None
    """... where it is in the base sensor's frame, ..."""
    obstacle_mm: list[float] | None = None
    """... and the place of the surface nearest to it."""
    means_mm: list[list[float]] | None = None
    """Of the components of the mixture over the body's points."""
    aside_arc_mm: float | None = None
    """Of a step that was turned aside: where along the body its nearest part is, ..."""
    aside_clearance_mm: float | None = None
    """... what it has left of the clearance that the risk allows, ..."""
    given_up_mm: float | None = None
    """... and how far that leads the tip, in this step, from where it was to go."""
    tip_statistic: float | None = None
    """Of the test whether the measured tip is where the model has it: 1 raises its alarm."""
    tip_off_mm: float | None = None
    """How far the measured tip is from the mean of the model's."""
    model_risk: float | None = None
    """Of the answers that the contact risk is one of: that of the model alone, of the body at rest
    while the tip decides (None: it was not asked for), ..."""
    given_tip_risk: float | None = None
    """... that of its shapes given the measured tip; None: there was no tip, or the model has
    something against it and nothing was near, ..."""
    decided_by: str = ""
    """... and which one decided: `model`, `tip`, or `shifted`, of a body that is off everywhere as
    it is seen to be."""


class Loop(Message, frozen=True, kw_only=True, tag="loop/1"):
    """One second of the loop's time keeping."""

    t_ns: int
    status: LoopStatus


class Event(Message, frozen=True, kw_only=True, tag="event/1"):
    """Something happened."""

    sequence: int
    t_ns: int
    kind: str
    """`state`, `cause`, `condition`, `command`, `homing`, `note`."""
    name: str
    subject: str
    present: bool
    """For what comes and goes: whether it came."""
    text: str
    severity: str = ""
    detail: str = ""
    follows_from: str = ""
    """Of a cause: the one that it follows from."""


class InternalError(Message, frozen=True, kw_only=True, tag="internal_error/1"):
    """An error of the daemon's own. Recorded only: its traceback is for who mends it."""

    t_ns: int
    place: str
    """Logger and line."""
    text: str
    traceback: str
    """As Python prints it; empty where there was no exception."""
    kept_back: int = 0
    """How often the same came since it was last recorded."""


class Component(msgspec.Struct, frozen=True, kw_only=True):
    """One normal distribution of the mixture over the body's points. Base sensor's frame."""

    weight: float
    mean_mm: list[float]
    covariance_mm2: list[float]
    """xx, xy, xz, yy, yz, zz."""


class Body(Message, frozen=True, kw_only=True, tag="body/1"):
    """Where the whole body is, at most ten times a second. Base sensor's frame."""

    t_ns: int
    source: str
    """`model`: what the model of the risk expects where the axes are. `emulated truth`: as the
    emulated lab has it. `none`: nobody knows, and there is no centreline."""
    centreline_mm: list[list[float]] | None = None
    """From base to tip, at most 32 points."""
    radius_mm: list[float] | None = None
    """At each of them."""
    components: list[Component] | None = None
    """Of the mixture over the body's points."""
    stability: float | None = None
    """As an emulated lab has it: 0 where the body is about to snap to another shape; ..."""
    snaps: int | None = None
    """... and how often it has."""


class SurroundingsChanged(Message, frozen=True, kw_only=True, tag="surroundings_changed/1"):
    """Recorded when others take their place, and when a recording begins."""

    t_ns: int
    sha256: str
    """Of what counts."""
    mesh: str
    """As `surroundings` has it."""
    triangles: int
    surface: str
    """JSON: `risk.surface` of a robot file that would have them."""
    file: str = ""
    """In the recording's folder: the meshes, as a binary STL file."""


class ObstaclesTaken(Message, frozen=True, kw_only=True, tag="obstacles_taken/1"):
    """Recorded: moving obstacles as they came."""

    t_ns: int
    user: str
    valid_for_s: float
    age_s: float
    balls: list[MovingObstacle]


class PathPlanned(Message, frozen=True, kw_only=True, tag="path_planned/1"):
    """Recorded: a path that was planned. Its file is beside the recording."""

    t_ns: int
    file: str
    surroundings_sha256: str
    """Of what counted."""
    model_sha256: str
    duration_s: float
    to_mm: list[float]
    contact_risk: float | None = None
    """Of the whole path, upper limit."""
    clearance_mm: float | None = None


TELEMETRY = (Status, Tip, Axes, Risk, Loop, Event, Body)
RECORDED = (*TELEMETRY, InternalError, SurroundingsChanged, ObstaclesTaken, PathPlanned)
