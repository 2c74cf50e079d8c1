"""Whether something learnt belongs to a robot: its name, its axes and how far they go."""

from collections.abc import Mapping
from typing import Any

from config.robot import Robot
from daemon.robot.axes import AxisRanges


def whose(robot: Robot) -> dict[str, Any]:
    """What must be the same where something learnt is used again. For JSON."""
    axes = AxisRanges.of(robot)
    ends = zip(axes.lowest.tolist(), axes.highest.tolist(), strict=True)
    return {
        "robot": robot.robot,
        "axes": list(axes.names),
        "travel": [list(pair) for pair in ends],
    }


def misfit_of(told: Mapping[str, Any], robot: Robot) -> str:
    """What of `whose` is another robot's, in words; empty: nothing."""
    for name, expected in whose(robot).items():
        found = told.get(name)
        if found != expected:
            return f"its {name} is {found!r}, not {expected!r}"
    return ""
