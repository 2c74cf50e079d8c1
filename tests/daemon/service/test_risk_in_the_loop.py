"""The tendon arm in a cavity, with the model that is shipped: it stops before it touches.

The circle leads past a place where the wall stands in the way. What touches is asked of the plant's
own shape, which nothing in the daemon can see.
"""

import asyncio
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.ndimage import map_coordinates

from config.control import RiskSettings
from config.loader import RobotFile, load_robot
from config.robot import Robot
from daemon.messages import Resume, Risk
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.grid_cache import cached_grid
from daemon.risk.mesh_file import read_environment, write_mesh
from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, chest
from drivers.cia402.power_state import PowerState
from safety.risk.surroundings.distance_grid import DistanceGrid
from safety.risk_source import NoModel, RiskReading
from safety.states import OperatingState
from tests.daemon.service.grazing import TENDON_ARM, StoppedClock, once_round
from tests.daemon.service.rig import Rig, on_a_rig

CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 197.5],
    "plane": "xy",
    "radius_mm": 34.0,
    "cycle_s": 25.0,
}
GRID_MM = 3.0
IN_THE_PORT_MM = CHEST_PORT.depth_mm + 5.0


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> RobotFile:
    """The shipped arm in a chest."""
    folder = tmp_path_factory.mktemp("chest")
    write_mesh(folder / "chest.stl", chest(1500, seed=0))
    port = {
        "centre_mm": list(CHEST_PORT.centre_mm),
        "inwards": list(CHEST_PORT.inwards),
        "radius_mm": CHEST_PORT.radius_mm,
        "depth_mm": CHEST_PORT.depth_mm,
    }
    surface = {"mesh": "chest.stl", "free": "inside", "port": port, "grid_mm": GRID_MM}
    robot: dict[str, Any] = yaml.safe_load(TENDON_ARM.read_text())
    robot["risk"] = {"model": "builtin:tendon_arm.npz", "surface": surface, "slide": False}
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        loaded = load_robot(folder / "robot.yaml")
        make_risk_source(loaded, StoppedClock())  # makes the grid, and compiles
    return loaded


@pytest.fixture(scope="module")
def walls(file: RobotFile) -> DistanceGrid:
    """How far the walls are, for whoever knows where the body really is."""
    return cached_grid(read_environment(file.path.parent / "chest.stl", "inside"), GRID_MM, 40.0)


class Witness:
    """Looks at the body itself while the scene plays."""

    def __init__(self, walls: DistanceGrid) -> None:
        self._walls = walls
        self.least_clearance_mm = np.inf

    async def watch(self, rig: Rig) -> None:
        while True:
            state = rig.lab.body.record.state
            inside = state.centreline_mm[state.centreline_mm[:, 2] > IN_THE_PORT_MM]
            at = (inside - self._walls.origin_mm) / self._walls.spacing_mm
            away = map_coordinates(self._walls.values_mm, at.T, order=1)
            clearance_mm = float(away.min()) - state.radius_mm
            self.least_clearance_mm = min(self.least_clearance_mm, clearance_mm)
            await asyncio.sleep(0.025)


def test_it_holds_before_it_touches_and_says_where(file: RobotFile, walls: DistanceGrid) -> None:
    witness = Witness(walls)

    async def scene(rig: Rig) -> None:
        await once_round(rig, CIRCLE, witness.watch(rig))
        assert rig.state is OperatingState.HOLD
        assert rig.causes == {"risk_too_high"}
        (reason,) = rig.status.reasons
        assert "clearance" in reason.detail
        assert "mm along the body, nearest to (" in reason.detail
        assert rig.power == {PowerState.OPERATION_ENABLED}

    rig = on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()))
    assert witness.least_clearance_mm > 0.0
    risks = [message for message in rig.told if isinstance(message, Risk)]
    assert any(risk.scale < 1.0 and "risk" in risk.reasons for risk in risks)
    last = risks[-1]
    assert last.contact_risk is not None
    assert last.body_point_risk is not None
    assert last.contact_risk > last.threshold
    assert last.obstacle_mm is not None
    assert last.means_mm is not None
    assert len(last.means_mm) == 5


@pytest.mark.long
def test_without_the_model_the_same_way_touches(file: RobotFile, walls: DistanceGrid) -> None:
    witness = Witness(walls)

    async def scene(rig: Rig) -> None:
        await once_round(rig, CIRCLE, witness.watch(rig))

    def unaware(robot: Robot) -> Robot:
        return robot.model_copy(update={"risk": RiskSettings()})

    on_a_rig(scene, path=file.path, change=unaware, risk=NoModel())
    assert witness.least_clearance_mm < 0.0


SAFE = RiskReading(0.0, None, 0.0, "told")
BAD = {
    "late": ("risk_unavailable", RiskReading(0.0, None, 1.0, "told")),
    "never learned": ("risk_unavailable", RiskReading(0.0, None, 0.0, "told", doubt="outside")),
    "no answer": ("risk_unavailable", None),
    "too high": ("risk_too_high", RiskReading(0.9, None, 0.0, "told", "a wall")),
}


class Told:
    """Answers what it is told to."""

    name = "told"

    def __init__(self) -> None:
        self.answer: RiskReading | None = SAFE

    def assess(self, u_from: object, u_to: object, t_ns: int) -> RiskReading | None:
        return self.answer

    def clearance(self, u: object, risk: float) -> None:
        return None


@pytest.mark.parametrize(("cause", "answer"), BAD.values(), ids=BAD)
def test_without_a_good_answer_no_step_is_let_through_until_there_is_one(
    cause: str, answer: RiskReading | None
) -> None:
    source = Told()

    async def scene(rig: Rig) -> None:
        await rig.running()
        await rig.until(lambda: any(isinstance(message, Risk) for message in rig.told))
        source.answer = answer
        begun = len(rig.told)
        await rig.until_state(OperatingState.HOLD)
        assert rig.causes == {cause}
        after = [message for message in rig.told[begun:] if isinstance(message, Risk)]
        assert {risk.scale for risk in after} == {0.0}
        await asyncio.sleep(0.1)
        await rig.do(Resume)
        await rig.until_state(OperatingState.HOLD, within_s=1.0)
        source.answer = SAFE
        await asyncio.sleep(0.1)
        await rig.do(Resume)
        await asyncio.sleep(1.0)
        assert rig.state is OperatingState.RUNNING
        assert rig.causes == set()

    on_a_rig(scene, risk=source)
