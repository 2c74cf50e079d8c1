"""Set-points that say where the tip shall point: followed by who can, else refused by name."""

import asyncio

import numpy as np
import pytest

from daemon.messages import Setpoint, Teleoperate
from daemon.service.setpoints import Setpoints
from safety.states import OperatingState as S
from tests import SHIPPED_ROBOTS
from tests.daemon.service.rig import USER, Rig, on_a_rig

TUBES = SHIPPED_ROBOTS / "concentric_tubes.yaml"
LEARNED = {
    "kind": "learned_kinematics",
    "model": "builtin:concentric_tubes_pose.npz",
    "damping_mm": 2.0,
}
TURN_RAD = 0.08


def setpoint(direction: list[float] | None, sequence: int = 1) -> Setpoint:
    return Setpoint(
        token="t",
        sequence=sequence,
        position_mm=[1.0, 2.0, 3.0],
        valid_s=0.2,
        direction=direction,
    )


@pytest.mark.parametrize(
    ("direction", "why"),
    [
        (None, ""),
        ([0.0, 0.6, 0.8], ""),
        ([0.0, 0.6, 0.8005], ""),
        ([0.0, 0.0, 2.0], "as long as 1, not 2"),
        ([0.0, 0.0, 0.0], "as long as 1, not 0"),
        ([0.0, 1.0], "three numbers"),
        ([0.0, float("nan"), 1.0], "finite"),
    ],
)
def test_directions_are_of_unit_length(direction: list[float] | None, why: str) -> None:
    said = Setpoints(None, 0, pointing=True).take(setpoint(direction), 0)
    assert why in said
    assert bool(said) == bool(why)


def test_who_leads_the_position_alone_refuses_pointing_by_name() -> None:
    setpoints = Setpoints(None, 0)
    assert setpoints.take(setpoint([0.0, 0.0, 1.0]), 0).startswith("pointing: ")
    assert setpoints.take(setpoint(None), 0) == ""


@pytest.mark.parametrize(
    ("controller", "seconds"),
    [
        (LEARNED, 10.0),
        ({"kind": "broyden"}, 18.0),
        ({"kind": "forward_jacobian", "babbling": {"duration_s": 8.0}}, 18.0),
    ],
)
def test_tubes_turn_their_tip_to_where_a_hand_points_it_and_keep_its_place(
    controller: dict[str, object], seconds: float
) -> None:
    """Those too that find out in first motions what turns it."""

    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Teleoperate, controller=controller)
        place = rig.status.tip_mm
        begun = rig.tips[-1].quaternion
        assert place is not None
        assert begun is not None
        w, x, y, z = begun
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        # All tubes bend towards x: out of their plane three rotations turn and move the tip, and
        # within it two carriages could do no more than move it.
        wanted = axis + np.tan(TURN_RAD) * np.array([0.0, 1.0, 0.0])
        wanted /= np.linalg.norm(wanted)
        for sequence in range(1, round(20 * seconds)):
            told = Setpoint(
                token=rig.token,
                sequence=sequence,
                position_mm=place,
                valid_s=0.2,
                direction=wanted.tolist(),
            )
            assert rig.operator.setpoint(USER, told) is None
            await asyncio.sleep(0.05)
        assert rig.in_state(S.RUNNING)
        last = rig.tips[-1]
        assert last.error_rad is not None
        assert last.error_rad < 0.4 * TURN_RAD
        assert last.error_mm is not None
        assert last.error_mm < 2.0

    on_a_rig(scene, path=TUBES)
