"""A tendon that hangs loose keeps the robot from moving, and the remedy that is told helps. On a
path none gets loose, however little pretension is left."""

import asyncio
import json
from pathlib import Path

import numpy as np

from daemon.messages import Arm, Axes, Disarm, Resume, Start
from daemon.recording.format.channels import TOPICS
from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.in_virtual_time import carry_out_in_virtual_time
from drivers.axis_scale import axis_scale
from safety.causes import cause
from safety.states import OperatingState
from tests import SHIPPED_ROBOTS
from tests.daemon.service.grazing import BROYDEN, TENDON_ARM
from tests.daemon.service.rig import Rig, on_a_rig

S = OperatingState
CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 197.5],
    "plane": "xy",
    "radius_mm": 10.0,
    "cycle_s": 20.0,
}
LOOSENED_MM = 3.0
A_TURN_MM = 0.02
"""Of tendon: a hand that is slower than the motor may be."""
AXIS = 0


async def wind_by_hand(rig: Rig, length_mm: float) -> None:
    """The spool of one tendon, which nothing holds but the drive. Up: tighter."""
    (shaft,) = [axis.shaft for axis in list(rig.lab.drives.values())[AXIS].axes]
    counts = axis_scale(rig.service.robot.axes[AXIS]).magnitude(A_TURN_MM)
    for _ in range(round(abs(length_mm) / A_TURN_MM)):
        assert not shaft.energised
        shaft.drag_to(shaft.position + (counts if length_mm > 0.0 else -counts))
        await asyncio.sleep(0.01)


def test_a_slack_tendon_is_wound_up_by_hand_while_its_drive_is_off() -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(CIRCLE, BROYDEN)
        await rig.do(Disarm)
        await rig.until_state(S.READY)
        await wind_by_hand(rig, -LOOSENED_MM)
        await rig.do(Arm)
        await rig.until(lambda: "tendon_slack" in rig.causes)
        for kind in (Start, Resume):
            (why,) = (await rig.refused(kind)).reasons
            assert (why.name, why.subject) == ("tendon_slack", rig.service.robot.axes[AXIS].name)
            assert why.remedy == cause("tendon_slack").remedy
            assert why.remedy.startswith("disarm: the drives hold their spools")
        await rig.do(Disarm)
        await rig.until_state(S.READY)
        await wind_by_hand(rig, LOOSENED_MM)
        await rig.do(Arm)
        await asyncio.sleep(1.0)
        assert "tendon_slack" not in rig.causes
        await rig.do(Start)
        await asyncio.sleep(5.0)
        assert rig.in_state(S.RUNNING)

    on_a_rig(scene, path=TENDON_ARM)


def test_an_arm_that_has_lost_pretension_follows_a_wide_path_with_all_tendons_tight(
    tmp_path: Path,
) -> None:
    worn = {"pretension_n": 1.2, "friction": 0.3}
    wide = {**CIRCLE, "center_mm": [0.0, 0.0, 193.2], "radius_mm": 45.0, "cycle_s": 14.0}
    changed = {
        "plant": worn,
        "trajectory": {**wide, "cycles": 1},
        "controller": {"kind": "broyden", "lead": True},
        "longest_s": 60.0,
    }
    file = load_experiment(SHIPPED_ROBOTS.parent / "experiments/bench_tendon_arm.yaml", changed)
    result = carry_out_in_virtual_time(file, 1, tmp_path, lambda _: None)
    assert (result.holds, result.faults) == (0, [])
    recorded = RunReader(tmp_path / RUN_FILE).messages([TOPICS[Axes]])
    steps = [step for one in recorded if (step := json.loads(one.data)).get("permitted")]
    lowest_n = np.array([axis.tension_range_n for axis in file.robot.axes], np.float64)[:, 0]
    assert len(steps) > 500
    assert (np.array([step["force"] for step in steps]) > lowest_n).all()
