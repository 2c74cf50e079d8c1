"""What clients ask for and send: commands, and streams of set-points and of obstacles.

All commands but `acquire` and `stop` need the lease.
"""

from typing import Any

import msgspec

from daemon.messages.base import Message, tag


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


class Setpoint(Message, frozen=True, kw_only=True, tag="setpoint/1"):
    """Where the tip shall be now. A stream of puts; the newest counts while it is valid."""

    token: str
    sequence: int
    """Rising under one lease; a set-point that is not newer than the last is dropped."""
    position_mm: list[float]
    valid_s: float
    """For how long after its arrival it may be followed. The robot holds when that is over, and
    without a newer one in any case after the robot file's `setpoint_hold_after_s`."""
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
