"""A controller whose axes turn and push: a radian is not a millimetre, and not a turn's share."""

import numpy as np
import pytest

from config.loader import load_robot
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


@pytest.mark.parametrize(
    ("trajectory", "mean_mm"),
    [(EIGHT, 10.0), (HELIX, 1.5)],
    ids=["across the axis", "round it"],
)
def test_a_measured_jacobian_leads_turning_axes_round_and_the_gate_refuses_nothing(
    trajectory: dict[str, object], mean_mm: float
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(trajectory, {"kind": "broyden"})
        await rig.until_state(OperatingState.ARMED, OperatingState.HOLD, within_s=150.0)
        assert not rig.events("cause", "gate_refused")
        assert not rig.events("cause", "drive_limit"), "not for the rounding of a count"
        assert rig.in_state(OperatingState.ARMED)
        errors = [tip.error_mm for tip in rig.tips if tip.cycle >= 0 and tip.error_mm is not None]
        assert float(np.mean(errors)) < mean_mm

    on_a_rig(scene, path=TUBES)
