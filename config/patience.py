"""How long the parts of a robot wait for each other, and how much longer in emulation.

The daemon says itself that it stood still (`supervision.loop_fault_after_s`) before the drives stop
because they do not hear it. A computer that is not made for real time, a laptop or a virtual
machine, stops every program now and then for tenths of a second. Where drives are emulated nobody
is hurt by that: there all of them wait for as long as `emulation.patience_s`.
"""

from collections.abc import Iterator
from typing import Any, Final

from config.bus import Bus
from config.control import PoseFilterSettings, Supervision
from config.documents.model import LONGEST_DRIVE_TIME_S
from config.documents.yaml_document import Location
from config.emulation.lab import Emulation
from config.robot import Robot
from config.tracker import Tracker

_LATER: Final = 1.25
"""The drives wait a quarter longer than the daemon: that it stood still is then told first."""
_FRAMES_WAITED: Final = 3.0
"""One may be late, and one lost, before nobody knows where the tip is."""
_FRAMES_PREDICTED: Final = 2.0
"""... and as long as one is late the tip may be taken to go on."""


def patient(robot: Robot) -> Robot:
    """The robot as it runs in real time: with patience on its emulated buses, else as it is."""
    emulated = {name for name, bus in robot.buses.items() if bus.emulated}
    if robot.emulation is None or not emulated or not robot.emulation.patience_s:
        return robot
    stall_s = robot.emulation.patience_s
    fault_s = max(robot.supervision.loop_fault_after_s, stall_s)
    drives_s = min(_LATER * fault_s, LONGEST_DRIVE_TIME_S)
    changes: dict[str, Any] = {
        "buses": {
            name: _at_least(bus, master_heartbeat_timeout_s=drives_s) if name in emulated else bus
            for name, bus in robot.buses.items()
        },
        "axes": [
            axis.model_copy(
                update={
                    "drive": _at_least(
                        axis.drive,
                        heartbeat_timeout_s=stall_s,
                        state_timeout_s=stall_s,
                        setpoint_timeout_s=drives_s,
                    )
                }
            )
            if axis.drive.bus in emulated
            else axis
            for axis in robot.axes
        ],
    }
    if len(emulated) == len(robot.buses):  # a real drive would not wait for a daemon that does
        changes["supervision"] = _at_least(robot.supervision, loop_fault_after_s=stall_s)
    shortest_s = min(robot.buses[name].cycle_period_s for name in emulated)
    drives = _at_least(robot.emulation.drives, sync_lost_after_periods=drives_s / shortest_s)
    changes["emulation"] = robot.emulation.model_copy(update={"drives": drives})
    return robot.model_copy(update=changes)


def _at_least(part: Any, **seconds: float) -> Any:
    """`part` with each of these values raised to this, where it is below."""
    raised = {name: value for name, value in seconds.items() if getattr(part, name) < value}
    return part.model_copy(update=raised) if raised else part


def impatience(supervision: Supervision, bus: Bus, emulation: Emulation | None) -> Iterator[str]:
    """Which drives on `bus` stop by themselves before the daemon says that it stood still."""
    fault_s = supervision.loop_fault_after_s
    says = f"supervision.loop_fault_after_s ({fault_s:g} s), so that the daemon can say why"
    if not fault_s < bus.master_heartbeat_timeout_s:
        yield f"drives must wait longer for the master than {says}"
    if emulation is None or emulation.patience_s or not bus.emulated:
        return
    sync_s = emulation.drives.sync_lost_after_periods * bus.cycle_period_s
    if not fault_s < sync_s:
        yield (
            f"without emulation.patience_s the emulated drives stop {sync_s:g} s after the last "
            f"SYNC (emulation.drives.sync_lost_after_periods): that must be longer than {says}"
        )


def frames_impatience(
    tracker: Tracker, supervision: Supervision | None, pose_filter: PoseFilterSettings | None
) -> Iterator[tuple[Location, str]]:
    """Who does not wait for the frames that the tracker's line can bring, and why: else the robot
    could never be armed, and its reasons would not say so."""
    apart_s = tracker.frames_apart_s
    why = (
        f"tracker.baud_rate {tracker.baud_rate} brings a frame of {len(tracker.tools)} tools every "
        f"{apart_s:.3g} s"
    )
    if supervision is not None:
        least_s, share = _FRAMES_WAITED * apart_s, tracker.frame_s / apart_s
        if supervision.tracker_hold_after_s < least_s:
            text = f"{why}: wait for {least_s:.3g} s or more, or use a faster line"
            yield ("supervision", "tracker_hold_after_s"), text
        if supervision.tracker_quality > share:
            text = f"{why}, a share of {share:.3g} of all: ask for less, or use a faster line"
            yield ("supervision", "tracker_quality"), text
    least_s = _FRAMES_PREDICTED * apart_s
    if pose_filter is not None and pose_filter.predict_for_s < least_s:
        text = f"{why}: predict for {least_s:.3g} s or more, or use a faster line"
        yield ("pose_filter", "predict_for_s"), text
