"""The tendon arm as it is shipped, in a chest, from its tracker to its report, as processes."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import yaml

from daemon.recording.run_folder import RUN_FILE
from daemon.recording.run_reader import RunReader
from daemon.remote.client.client_errors import RefusedError
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.hil.daemon_rig import Rig, short_folder
from tests.hil.processes import run

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("tendon_arm")]

S = OperatingState

TENDON_ARM = SOFT_ARM.with_name("tendon_arm.yaml")
CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 197.5],
    "plane": "xy",
    "radius_mm": 25.0,
    "cycle_s": 30.0,
}
BROYDEN = {
    "kind": "broyden",
    "explore_together": False,
    "explore_share": 0.03,
    "damping_mm": 200.0,
    "posture_gain_per_s": 1.0,
}
ROUND_WITHIN_S = 120.0
ATTEMPTS = 3


def patient(folder: Path) -> Path:
    """The shipped file, for a machine that gives nobody a turn for a moment."""
    robot = yaml.safe_load(TENDON_ARM.read_text())
    robot["buses"]["can0"] |= {"cycle_period_s": 0.02, "master_heartbeat_timeout_s": 2.0}
    robot["supervision"] |= {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
    robot["risk"]["latest_after_s"] = 0.5
    path = folder / "robot.yaml"
    path.write_text(yaml.safe_dump(robot))
    return path


def test_it_goes_round_in_a_chest_along_what_is_in_its_way() -> None:
    with short_folder() as folder:
        recorded = gone_round(folder)
        risks, tips = seen(recorded, "/risk"), seen(recorded, "/tip")
        asked = [risk["contact_risk"] for risk in risks]
        assert None not in asked
        near_mm = [risk["clearance_mm"] for risk in risks if risk["clearance_mm"] is not None]
        assert min(near_mm) + 1.0 < max(near_mm), "the heart is near, and not always"
        assert any("sliding" in risk["reasons"] for risk in risks)
        assert {len(risk["means_mm"]) for risk in risks if risk["means_mm"]} == {5}
        assert max(tip["cycle"] for tip in tips) >= 0
        report = run("report", str(recorded))
        assert report.returncode == 0, report.stderr
        assert "The body and what is near" in (recorded / "report.html").read_text()


def gone_round(folder: Path) -> Path:
    """The run's folder. On a machine that gives nobody a turn for a while, at the next attempt."""
    one = Rig(folder, patient(folder))
    try:
        assert "tendon_arm.npz, chest.stl" in one.status().risk.source
        for _ in range(ATTEMPTS):
            one.armed()
            one.user.do(one.client.load(CIRCLE, BROYDEN))
            one.from_now_on()
            one.user.do(one.client.start())
            one.until(lambda: ended(one), ROUND_WITHIN_S)
            assert not one.events("cause", "risk_too_high")
            if one.state is S.ARMED:
                one.user.do(one.client.stop())
                one.until_without_torque()
                break
        else:
            pytest.fail("it always came to a fault")
    finally:
        one.leave()
    return max((folder / "runs").iterdir())


def ended(one: Rig) -> bool:
    """Round, or in a fault. A machine that was busy for a moment has held the robot: it goes on."""
    if one.state is S.HOLD:
        with suppress(RefusedError):
            one.user.do(one.client.resume())
    return one.state in (S.ARMED, S.FAULT)


def seen(recorded: Path, topic: str) -> list[dict[str, Any]]:
    """What was told of it."""
    reader = RunReader(recorded / RUN_FILE)
    return [json.loads(message.data) for message in reader.messages([topic])]
