"""Everything that is said over the wire, and recorded: one struct per kind of message.

The tag names kind and version (`status/1`); within a version, fields are only added, and have a
default. What may be unknown is None then, and is left out in recordings. Lengths are mm (rad for
rotating axes), times s, and `t_ns` is the daemon's monotonic clock. A vector is a list of as many
numbers as its frame or the robot has.
"""

from typing import Any

import msgspec


class Message(msgspec.Struct, frozen=True, kw_only=True):
    """Base of all; a subclass sets its tag."""


# What the daemon tells.


class Reason(msgspec.Struct, frozen=True, kw_only=True):
    """Why the robot is not doing what somebody might want of it."""

    name: str
    """As in the table of causes."""
    severity: str
    subject: str
    """What it is about: `tracker`, `can0/3`, `loop`."""
    text: str
    remedy: str
    detail: str = ""
    since_s: float = 0.0
    """How long it has been so."""
    latched: bool = False
    """Gone by itself, but waits for a deliberate clear."""
    follows_from: str = ""
    """The cause, told before this one, that this one follows from: mend that first."""
    over: bool = False
    """Gone, and told because of what follows from it."""


class TrackerStatus(msgspec.Struct, frozen=True, kw_only=True):
    """The tracker, as the loop sees it."""

    state: str
    rate_hz: float
    age_s: float | None = None
    """Since the newest accepted measurement was made."""
    quality: float
    """Share of recent frames that were there and were believed, 0 to 1."""
    latency_s: float | None = None
    """From measurement to the loop, median."""


class AxisStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One axis."""

    name: str
    unit: str
    actual: float | None = None
    target: float | None = None
    drive_state: str
    node_state: str
    force: float | None = None
    """Tension of a tendon, thrust of a screw, torque of a rotation."""
    force_unit: str
    volume_ml: float | None = None
    force_range: list[float] | None = None
    """Of a tendon: the least and the most tension that it may have."""


class BusStatus(msgspec.Struct, frozen=True, kw_only=True):
    """One CAN bus, over the last second."""

    name: str
    load: float
    """Share of what it can carry, all frames at their longest."""


class LoopStatus(msgspec.Struct, frozen=True, kw_only=True):
    """How well the loop keeps its time."""

    rate_hz: float
    """Control steps per second."""
    cycle_rate_hz: float
    lateness_p50_s: float
    lateness_p99_s: float
    lateness_max_s: float
    missed: int
    """Bus cycles that were skipped because the loop came too late."""
    step_p50_s: float
    """Time from a frame's arrival to its targets' being on the bus, or ready for its next cycle."""
    step_p99_s: float
    last_overrun: str = ""
    """What the last late cycle was spent on."""
    real_time: str = ""
    """What of the real-time set-up is in force."""
    buses: list[BusStatus] = []


class RiskStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What the gate was told about the last step."""

    source: str
    contact_risk: float | None = None
    """Probability that any part of the body touches something, along the step."""
    body_point_risk: float | None = None
    """Probability that a random point of the body is in an obstacle: not the same, and smaller."""
    threshold: float
    scale: float
    """Share of the last proposal that was let through, 0 to 1."""
    detail: str = ""
    minute_risk: float | None = None
    """Probability that something was touched in the last minute, one body for all of its steps."""
    path_risk: float | None = None
    """... and that something is touched on the rest of the planned path that is followed."""
    surroundings_sha256: str = ""
    """Of what counts of the surroundings: triangles, their free side, the port, and the regions.
    Empty: nothing is known of them."""
    moving_obstacles: int = 0
    """How many count, besides."""
    moving_mm: list[list[float]] = []
    """Each of them, as the capsule in which it may be while it is believed: three numbers of where
    that begins, three of the way to its end, and its radius."""


class LeaseStatus(msgspec.Struct, frozen=True, kw_only=True):
    """Who may command."""

    holder: str | None = None
    expires_in_s: float | None = None


class ReferenceStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What is being followed."""

    trajectory: str
    controller: str
    elapsed_s: float
    duration_s: float | None = None
    cycle: int
    """From 0; -1 while the tip is led to the start."""
    cycles: int | None = None
    note: str = ""
    """What the controller is doing; empty while it simply follows."""
    part: int | None = None
    """Which motion of an exploration this is; None while it follows."""
    pace: float = 1.0
    """Seconds of the trajectory for each second: less than 1 where it is followed more slowly than
    it says, since the tip would be off too far."""


class Verb(msgspec.Struct, frozen=True, kw_only=True):
    """A command, and whether it would be let through now."""

    name: str
    needs_lease: bool
    """Whether only the holder of the lease may ask for it."""
    possible: bool
    """As far as is known before drives and surroundings are looked at anew, as `arm` does."""
    why_not: str = ""
    helps: str = ""
    """What can be done about it."""


class Status(Message, frozen=True, kw_only=True, tag="status/1"):
    """The whole robot at a glance."""

    robot: str
    state: str
    reasons: list[Reason]
    t_ns: int
    sequence: int
    tip_mm: list[float] | None = None
    reference_mm: list[float] | None = None
    error_mm: float | None = None
    expected_mm: float | None = None
    """How far off the controller expects the tip to be, root mean square; None: it does not know.
    """
    error_rad: float | None = None
    """Of the tip's direction; None where it may be any."""
    tracker: TrackerStatus
    axes: list[AxisStatus]
    risk: RiskStatus
    loop: LoopStatus
    lease: LeaseStatus
    recording: str | None = None
    """Folder of the run; None: nothing is being recorded."""
    simulated: bool
    reference: ReferenceStatus | None = None
    version: str = ""
    stopped_by: list[Reason] = []
    """Why the robot was last held or switched off, until motion goes on; each may be over."""
    verbs: list[Verb] = []
    """Every command."""


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


class Events(Message, frozen=True, kw_only=True, tag="events/1"):
    """Answer to `events`: the last 200 that there were, the oldest first."""

    events: list[Event]


class Surroundings(Message, frozen=True, kw_only=True, tag="surroundings/1"):
    """Answer to `surroundings`: what is round the body. `surround` replaces it; the state tells of
    that by another `risk.surroundings_sha256`."""

    mesh: str = ""
    """Name of its file, and how much there is besides; empty: nobody knows what is round the
    body."""
    sha256: str = ""
    """Of the mesh as it is answered: a binary STL file in mm, normals out of what is solid."""
    size_bytes: int = 0
    parts: int = 0
    """Into how many it is cut; `surroundings/0` and so on answer the bytes of each."""
    transform: list[float] = []
    """(16,) row by row, from the mesh's places to the base sensor's frame."""
    workspace_mm: list[list[float]] | None = None
    """(3, 2) from where to where references may lead the tip."""
    counts_sha256: str = ""
    """Of what counts: triangles, their free side, the port, and the regions."""
    regions: list[dict[str, Any]] = []
    """Regions that the body must not get into or out of, with the keys of robot files."""
    port: dict[str, Any] | None = None
    """Where the body comes in, with the keys of robot files; None: there is none."""


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


class WhoAmI(Message, frozen=True, kw_only=True, tag="whoami/1"):
    """Answer to `whoami`: that the daemon is there, and what the asker may do."""

    robot: str
    version: str
    role: str
    simulated: bool


# What clients ask for. All but `acquire` and `stop` need the lease.


class Command(Message, frozen=True, kw_only=True):
    """Base of commands."""

    request: str = ""
    """The client's own identifier of this request; comes back in the answer."""
    token: str = ""
    """Of the lease."""


class Acquire(Command, frozen=True, kw_only=True, tag="acquire/1"):
    """Take the lease, or renew it with its token. Renewals must come several times within it."""


class Release(Command, frozen=True, kw_only=True, tag="release/1"):
    """Give the lease back. Refused while drives are energised."""


class Arm(Command, frozen=True, kw_only=True, tag="arm/1"):
    """Energise the drives where they stand. Refused with all unmet conditions, and where the body
    touches something."""

    despite_contact: bool = False
    """Arm a body that touches something, or whose risk is not known, to lead it out: the gate then
    lets nothing through but what leads out of the contact."""


class Home(Command, frozen=True, kw_only=True, tag="home/1"):
    """Let axes look for their zeros, in the order of the robot file. Answered at the end; `event`
    tells of each axis. STOP, `hold` and a lost lease end it."""

    axes: list[str] = []
    """Empty: all that do not know their zero."""


class Disarm(Command, frozen=True, kw_only=True, tag="disarm/1"):
    """Stop, take the drives' power off, go to STANDBY."""


class Load(Command, frozen=True, kw_only=True, tag="load/1"):
    """Make a trajectory and a controller ready. Keys as in experiment files."""

    trajectory: dict[str, Any]
    controller: dict[str, Any] | None = None
    cycles: int | None = None
    robot: str = ""
    """The robot that it is meant for; empty: whichever this is."""


class Plan(Command, frozen=True, kw_only=True, tag="plan/1"):
    """Look for a path from where the axes are to a place, that keeps the whole body away from what
    is round it. While the robot is ready, armed or held; nothing moves by it. Refused with the
    planner's reason where there is none."""

    to_mm: list[float]
    via_mm: list[list[float]] = []
    """Places that the tip passes before."""
    pointing: list[float] | None = None
    """Which way the tip shall point there."""
    tip_speed_mm_s: float = 8.0
    most_risk: float = 0.05
    """Contact risk that the whole path may have, upper limit."""
    seed: int = 1


class Start(Command, frozen=True, kw_only=True, tag="start/1"):
    """Follow what was loaded, from its beginning; in a hold, what was loaded since it began."""


class Teleoperate(Command, frozen=True, kw_only=True, tag="teleoperate/1"):
    """Follow the set-point stream."""

    controller: dict[str, Any] | None = None


class Hold(Command, frozen=True, kw_only=True, tag="hold/1"):
    """Stand still, energised; `resume` goes on."""


class Resume(Command, frozen=True, kw_only=True, tag="resume/1"):
    """Go on from where `hold`, or a cause that is over, has stopped the motion."""


class Stop(Command, frozen=True, kw_only=True, tag="stop/1"):
    """Quick stop, then power off. All who may command may stop. Not an emergency stop circuit."""


class Clear(Command, frozen=True, kw_only=True, tag="clear/1"):
    """Acknowledge latched faults and reset the drives'. In FAULT or STANDBY only."""


class Upload(Command, frozen=True, kw_only=True, tag="upload/1"):
    """One part of a mesh's file, for `surround` to name. Parts come in their order; who begins
    another file gives up the one before."""

    name: str
    """Of the file; its end says how it is written: .stl, .obj, .ply."""
    sha256: str
    """Of the whole file."""
    size_bytes: int
    offset: int
    """Where in the file this part begins."""
    data: bytes
    """At most 49152 bytes; in JSON, base64."""


class Surround(Command, frozen=True, kw_only=True, tag="surround/1"):
    """Replace what is round the body, while nothing moves. Answered when it is checked, prepared,
    and in force; refused, and all stays as it is."""

    surface: dict[str, Any] | None = None
    """As `risk.surface` in a robot file; a mesh is `upload:` and the SHA-256 of what was uploaded,
    or `builtin:` and a name. None: that of the robot file again."""
    add: bool = False
    """Keep what is there, and add the `bodies` and `regions` of this surface, which then has
    nothing else."""


class Inject(Command, frozen=True, kw_only=True, tag="inject/1"):
    """Make an emulated device misbehave. Refused on real hardware."""

    fault: str


class Answer(Message, frozen=True, kw_only=True, tag="answer/1"):
    """What every command that was carried out gets."""

    request: str
    state: str
    """After it."""
    text: str = ""
    token: str = ""
    """Of the lease, after `acquire`."""
    expires_in_s: float | None = None
    confirmed: bool = True
    """For stop and disarm: whether the drives have said that they did it."""
    path: dict[str, Any] | None = None
    """After `plan`: what its path file holds; None: it is too long for an answer."""
    file: str = ""
    """After `plan`: the name under which `load` takes it, as `{"kind": "planned", "file": ...}`."""


class Refusal(Message, frozen=True, kw_only=True, tag="refusal/1"):
    """Why a command was not carried out: all reasons at once."""

    request: str
    state: str
    name: str
    """`no_lease`, `wrong_state`, `not_ready`, `bad_payload`, `unreachable`, `busy`, ..."""
    text: str
    reasons: list[Reason] = []


class Setpoint(Message, frozen=True, kw_only=True, tag="setpoint/1"):
    """Where the tip shall be now. A stream of puts; the newest counts while it is valid."""

    token: str
    sequence: int
    """Rising under one lease; a set-point that is not newer than the last is dropped."""
    position_mm: list[float]
    valid_s: float
    """For how long after its arrival it may be followed."""
    velocity_mm_s: list[float] | None = None
    direction: list[float] | None = None
    """Unit vector, where the tip shall point; None: anywhere. Refused where nothing points it."""


class MovingObstacle(msgspec.Struct, frozen=True, kw_only=True):
    """A ball that moves. Base sensor's frame."""

    centre_mm: list[float]
    radius_mm: float
    velocity_mm_s: list[float] | None = None
    """None: it stands still."""


class Obstacles(Message, frozen=True, kw_only=True, tag="obstacles/1"):
    """Where obstacles are that move: a stream of puts, one of each user. Each replaces the one
    before. It counts wherever its velocity may lead it while it is valid; should nothing newer have
    come by then, the robot holds. Needs no lease."""

    sequence: int
    """Rising."""
    balls: list[MovingObstacle]
    """At most 16; none: the stream has ended, and nothing of it counts any more."""
    valid_for_s: float = 0.3
    """For how long after they were measured they are to be believed; at most 1."""
    age_s: float = 0.0
    """How long ago they were measured when this is sent."""


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


class SetpointRefused(Message, frozen=True, kw_only=True, tag="setpoint_refused/1"):
    """Published as an event when a set-point is dropped."""

    sequence: int
    """-1 where it could not be read."""
    reason: str
    user: str = ""
    """Whose set-point it was."""


TELEMETRY = (Status, Tip, Axes, Risk, Loop, Event, Body)
RECORDED = (*TELEMETRY, InternalError, SurroundingsChanged, ObstaclesTaken, PathPlanned)
COMMANDS = (
    Acquire,
    Release,
    Arm,
    Home,
    Disarm,
    Load,
    Plan,
    Start,
    Teleoperate,
    Hold,
    Resume,
    Stop,
    Clear,
    Upload,
    Surround,
    Inject,
)


def verb(command: Command | type[Command]) -> str:
    """The word under which a command is asked for: the last part of its key."""
    kind = command if isinstance(command, type) else type(command)
    return tag(kind).split("/")[0]


def tag(kind: type[msgspec.Struct]) -> str:
    """Kind and version, as on the wire."""
    return str(kind.__struct_config__.tag)
