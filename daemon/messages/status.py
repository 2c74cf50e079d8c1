"""The whole robot at a glance."""

import msgspec

from daemon.messages.base import Message, Reason


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
