"""A controller whose axes turn and push: a radian is not a millimetre, and not a turn's share."""

from collections.abc import Callable

import numpy as np
import pytest

from config.loader import load_robot
from config.robot import Robot
from daemon.robot.axes import AxisRanges
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import Rig, on_a_rig

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
EIGHT = {
    "kind": "lissajous",  # across the axis, where a bend has to change its side
    "center_mm": [0.0, 0.0, 185.0],
    "amplitude_mm": [45.0, 45.0, 0.0],
    "frequencies": [1, 2, 0],
    "cycle_s": 40.0,
}
THE_OTHER_WAY = {**EIGHT, "frequencies": [2, 1, 0]}
HELIX = {
    "kind": "helix",
    "center_mm": [0.0, 0.0, 178.0],
    "radius_mm": 50.0,
    "turns": 0.75,
    "rise_mm": 4.0,
    "cycle_s": 60.0,
}


def test_a_rotation_counts_by_the_radian_and_a_push_by_its_travel() -> None:
    ranges = AxisRanges.of(load_robot(TUBES).robot)
    assert ranges.scale.tolist() == [1.0, 1.0, 1.0, 20.0, 67.0]


def as_shipped(robot: Robot) -> Robot:
    return robot


def never_drawn_in(robot: Robot) -> Robot:
    """Tubes that are drawn in far turn round where they come near the axis."""
    inner = robot.axes[4].model_copy(update={"travel_mm": (-23.5, 23.5)})
    return robot.model_copy(update={"axes": [*robot.axes[:4], inner]})


@pytest.mark.parametrize(
    ("kind", "trajectory", "change", "mean_mm"),
    [
        pytest.param("broyden", EIGHT, as_shipped, 10.0, marks=pytest.mark.long),
        pytest.param("broyden", THE_OTHER_WAY, as_shipped, 10.0, marks=pytest.mark.long),
        ("broyden", THE_OTHER_WAY | {"cycle_s": 30.0}, never_drawn_in, 6.0),
        pytest.param("broyden", HELIX, as_shipped, 1.5, marks=pytest.mark.long),
        pytest.param(
            *("forward_jacobian", HELIX | {"turns": 0.2, "cycle_s": 12.0}, never_drawn_in, 1.5),
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_measured_jacobian_leads_turning_axes_round_and_the_gate_refuses_nothing(
    kind: str, trajectory: dict[str, object], change: Callable[[Robot], Robot], mean_mm: float
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(trajectory, {"kind": kind})
        await rig.until_state(OperatingState.ARMED, OperatingState.HOLD, within_s=150.0)
        assert not rig.events("cause", "gate_refused")
        assert not rig.events("cause", "drive_limit"), "not for the rounding of a count"
        assert rig.in_state(OperatingState.ARMED)
        errors = [tip.error_mm for tip in rig.tips if tip.cycle >= 0 and tip.error_mm is not None]
        assert float(np.mean(errors)) < mean_mm

    on_a_rig(scene, path=TUBES, change=change)
