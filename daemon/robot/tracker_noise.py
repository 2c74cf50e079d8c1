"""Whether the filter is told of as much noise as the tracker has: it does not believe the rest."""

from math import hypot, sqrt
from typing import Final

from config.robot import Robot

_FAST_TIMES: Final = 2.0
"""The noise at 66 Hz against that at 40 Hz."""
_BORNE: Final = 2.0
"""Times the noise that the filter was told of. The shipped robots have up to 1.6 times as much."""


def untold_noise(robot: Robot) -> str | None:
    """What to tell the filter, as a sentence; None: it knows, or nobody can say."""
    told_mm, fast = robot.pose_filter.position_noise_mm, robot.tracker.frame_rate == "fast"
    noise_mm = _emulated_noise_mm(robot)
    if noise_mm is None:
        if fast and "position_noise_mm" not in robot.pose_filter.model_fields_set:
            return (
                f"at 66 Hz the tracker has twice the noise, of which the filter is not told: say "
                f"`pose_filter: {{position_noise_mm: {_FAST_TIMES * told_mm:g}}}`"
            )
        return None
    if noise_mm <= _BORNE * told_mm:
        return None
    averaged = "base" in robot.tracker.tools and robot.tracker.base_averaged_s is None
    also = (
        ", or with a base that stands still `tracker: {base_averaged_s: 1.0}`" if averaged else ""
    )
    return (
        f"the emulated tracker's noise is about {noise_mm:.2g} mm at the tip, and the filter is "
        f"told of {told_mm:g} mm, so it will not believe many frames: say "
        f"`pose_filter: {{position_noise_mm: {0.75 * noise_mm:.1g}}}`{also}"
    )


def _emulated_noise_mm(robot: Robot) -> float | None:
    """Of one coordinate of the tip in the base's frame. None: on a rig nobody knows."""
    if robot.emulation is None or not robot.tracker.port.startswith("lab:"):
        return None
    tracker, workspace = robot.emulation.tracker, robot.workspace
    times = _FAST_TIMES if robot.tracker.frame_rate == "fast" else 1.0
    if "base" not in robot.tracker.tools or robot.tracker.base_averaged_s is not None:
        return times * tracker.jitter_mm
    far_mm = 0.0
    if workspace is not None:
        ranges = (workspace.x_mm, workspace.y_mm, workspace.z_mm)
        far_mm = hypot(*(0.5 * (low + high) for low, high in ranges))
    return times * hypot(sqrt(2.0) * tracker.jitter_mm, far_mm * tracker.jitter_rad)
