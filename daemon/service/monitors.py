"""The monitors keep what the watchdogs look at up to date, from all that the service knows."""

from math import floor
from typing import Final, NamedTuple, Protocol

from config.control import RiskSettings
from daemon.loop.control_step import ControlLoop
from daemon.loop.timekeeping import Timekeeping
from daemon.recording.run_folder import free_mb
from daemon.service.dependencies import Dependencies
from daemon.service.following import Following
from daemon.service.lease import Lease
from daemon.service.obstacles import MovingObstacles
from daemon.supervision.supervisor import Supervisor
from drivers.aurora.tracker import AuroraTracker

_FEW_MISSED_PER_S = 2
"""Bus cycles, of 100 to 500: a busy machine misses one now and then. Chosen."""


class RecordingTrouble(NamedTuple):
    """What is wrong with the recording of a run that is going on."""

    failed: str = ""
    """What keeps it from being written at the moment; empty: nothing."""
    lost: str = ""
    """Why it was given up, or has a gap that goes on; empty: neither."""


NO_TROUBLE: Final = RecordingTrouble()


class WatchedRecording(Protocol):
    """The recording of a run, while there is one."""

    def look(self) -> RecordingTrouble:
        """See to it, and say what is wrong with it."""
        ...


class Monitors:
    """`look` every bus cycle, `look_at_recorder` and `look_at_machine` now and then."""

    def __init__(
        self,
        tracker: AuroraTracker,
        loop: ControlLoop,
        supervisor: Supervisor,
        timekeeping: Timekeeping,
        lease: Lease,
        following: Following,
        obstacles: MovingObstacles,
        dependencies: Dependencies,
        risk: RiskSettings,
    ) -> None:
        """risk: what may be risked in a minute, and on a path."""
        self._recording: WatchedRecording | None = None
        self._tracker = tracker
        self._loop = loop
        self._supervisor = supervisor
        self._timekeeping = timekeeping
        self._lease = lease
        self._following = following
        self._obstacles = obstacles
        self._dependencies = dependencies
        self._risk = risk
        self._tendons = [
            (channel, limits)
            for channel in loop.channels
            if (limits := channel.axis.tension_range_n) is not None
        ]
        self._missing_cycles, self._missed_before = False, 0
        self._free_mb: float | None = None
        self.look_at_machine()

    def watch(self, recording: WatchedRecording) -> None:
        """See to the recording of each run too."""
        self._recording = recording

    def look(self, now_ns: int) -> None:
        """Before each supervision."""
        watched, loop = self._supervisor.checks.watched, self._loop
        watched.tracking = self._tracker.tracking
        watched.tip_age_s = loop.filter.age_s(now_ns)
        watched.tip_quality = loop.filter.quality
        watched.body_failing = self._dependencies.body_failing()
        watched.outside_mm = loop.outside_mm
        watched.targets = loop.target_counts(now_ns)
        watched.cycles_missed = self._missing_cycles
        watched.lease_missing_s = self._lease.unheld_s(now_ns)
        watched.lease_held = watched.lease_missing_s <= 0.0
        watched.setpoint_age_s = self._following.setpoint_age_s(now_ns)
        risk = self._risk
        watched.minute_risk = _beyond(loop.minute_risk, risk.most_in_a_minute)
        watched.path_risk = _beyond(loop.path_risk, risk.most_on_path)
        watched.near_at_rest = loop.near_at_rest
        watched.obstacles_late = self._obstacles.late(now_ns)
        watched.tensions_n = [
            (channel.axis.name, channel.scale.force(channel.torque_permille), *limits)
            for channel, limits in self._tendons
        ]

    def look_at_recorder(self) -> None:
        """How the recording does, and how much room there is for it."""
        watched, recorder = self._supervisor.checks.watched, self._dependencies.recorder.status
        trouble = NO_TROUBLE if self._recording is None else self._recording.look()
        watched.recorder_failed, watched.recording_lost = trouble
        watched.recordings_dropped = recorder.dropped
        watched.disk_free_mb = recorder.free_mb if recorder.recording else self._free_mb

    def look_at_machine(self) -> None:
        """Once a second."""
        missed = self._timekeeping.missed
        self._missing_cycles = missed - self._missed_before > _FEW_MISSED_PER_S
        self._missed_before = missed
        runs = self._dependencies.runs
        self._free_mb = None if runs is None else free_mb(runs)


def _beyond(risk: float | None, most: float | None) -> str:
    """In words; empty: it is not. In tenths, so that not every step is news."""
    if risk is None or most is None or risk <= most:
        return ""
    return f"more than {max(most, floor(10.0 * risk) / 10.0):g}, and {most:g} is allowed"
