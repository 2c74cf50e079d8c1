"""The risk of all that is left of a planned path, and of the minute behind: told, and limited."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from config.loader import load_robot
from config.tasks.planned_path import PlannedPath
from daemon.messages import Load, Resume, Risk, Start, Status
from daemon.risk.body_risk_source import BodyRiskSource, make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball
from safety.risk.contact_figures import upper_limit
from safety.risk_source import NoModel, RiskReading
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.service.grazing import StoppedClock
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig

S = OperatingState
BENT_MM = np.array([10.0, 25.0, 25.0, 25.0, 15.0, 15.0])
BALL_MM = 20.0
LASTS_S = 8.0
PLACES = 61
CLEAR = upper_limit(0, 1000)


class Scene:
    """The soft arm, a ball beside the middle of a path that bends it and unbends it again."""

    def __init__(self, folder: Path, gap_mm: float, **risk: Any) -> None:
        """gap_mm: between the mean body's tip, where it is bent, and the ball."""
        self.path = folder / "robot.yaml"
        self._write(folder, np.array([500.0, 0.0, 0.0]), {})
        body = self.source().body_risk
        line = self._line(body, BENT_MM)
        outwards = line[-1] * np.array([1.0, 1.0, 0.0]) / np.hypot(*line[-1, :2])
        thick_mm = float(body.model.basis.radius_mm[-1])
        self._write(folder, line[-1] + (gap_mm + thick_mm + BALL_MM) * outwards, risk)

    def source(self) -> BodyRiskSource:
        source = make_risk_source(load_robot(self.path), StoppedClock())
        assert isinstance(source, BodyRiskSource)
        return source

    def planned(self, source: BodyRiskSource) -> dict[str, Any]:
        t_s = np.linspace(0.0, LASTS_S, PLACES)
        bends = np.interp(t_s, [0.0, 0.5 * LASTS_S, LASTS_S], [0.0, 1.0, 0.2])
        u = bends[:, None] * BENT_MM
        tips = np.array([self._line(source.body_risk, one)[-1] for one in u])
        identity = source.files.identity
        path = PlannedPath(
            tentacled_path=1,
            robot="soft_arm",
            axes=tuple(axis.name for axis in load_robot(self.path).robot.axes),
            model_sha256=identity.model_sha256,
            surroundings_sha256=identity.surroundings_sha256,
            t_s=tuple(t_s.tolist()),
            u=tuple(map(tuple, u.tolist())),
            tip_mm=tuple(map(tuple, tips.tolist())),
        )
        return {"kind": "planned", "path": path.model_dump(mode="json")}

    @staticmethod
    def _line(body: Any, u: np.ndarray) -> np.ndarray:
        known = body.body(u.tolist())
        assert known is not None
        return np.array(known.centreline_mm)

    def _write(self, folder: Path, centre_mm: np.ndarray, risk: dict[str, Any]) -> None:
        write_mesh(folder / "ball.stl", ball(BALL_MM, centre_mm.tolist(), 600))
        robot: dict[str, Any] = yaml.safe_load(SOFT_ARM.read_text())
        surface = {"mesh": "ball.stl", "free": "outside"}
        robot["risk"] = {"model": "builtin:soft_arm.npz", "surface": surface, **risk}
        self.path.write_text(yaml.safe_dump(robot))


@pytest.fixture
def folder(tmp_path: Path, shared_grids: None) -> Path:
    """Its own."""
    return tmp_path


def test_what_is_left_of_a_path_is_told_and_gets_less_behind_the_narrow_place(
    folder: Path,
) -> None:
    scene = Scene(folder, 6.0)
    source = scene.source()

    async def play(rig: Rig) -> None:
        await rig.running(scene.planned(source))
        await rig.until(lambda: rig.state is not S.RUNNING, within_s=60.0)
        assert rig.state is S.ARMED, rig.causes

    rig = on_a_rig(play, path=scene.path, risk=source)
    told = [message for message in rig.told if isinstance(message, Risk)]
    left = [message.path_risk for message in told if message.path_risk is not None]
    assert len(left) > 100
    assert max(left[:20]) > 5.0 * CLEAR
    assert left[-1] == CLEAR
    minutes = [message.minute_risk for message in told if message.minute_risk is not None]
    assert len(minutes) == len(told)
    assert minutes[0] == CLEAR
    assert minutes == sorted(minutes), "all of it was in one minute"
    highest = max(message.contact_risk or 0.0 for message in told)
    assert highest <= minutes[-1] < 20.0 * highest
    status = [message for message in rig.told if isinstance(message, Status)][-1]
    assert status.risk.minute_risk is not None
    assert status.risk.path_risk is None, "nothing is left"


def test_a_path_that_is_riskier_than_may_be_is_refused_with_its_place(folder: Path) -> None:
    scene = Scene(folder, 3.0, most_on_path=0.02)
    source = scene.source()

    async def play(rig: Rig) -> None:
        await rig.armed()
        refused = await rig.refused(Load, trajectory=scene.planned(source), controller=MODEL)
        assert refused.name == "path_risk"
        assert "0.02 is allowed (risk.most_on_path): at " in refused.text
        assert "mm along the body, nearest to (" in refused.text
        assert (await rig.refused(Start)).name == "nothing_loaded"

    on_a_rig(play, path=scene.path, risk=source)


def test_a_load_that_makes_the_rest_of_the_path_riskier_than_may_be_holds_the_robot(
    folder: Path,
) -> None:
    """The gate would still let every step through."""
    scene = Scene(folder, 6.0, most_on_path=0.3, threshold=0.6)
    source = scene.source()

    async def play(rig: Rig) -> None:
        await rig.running(scene.planned(source))
        await asyncio.sleep(1.0)
        rig.lab.set_tip_load(14.0)
        await rig.until_state(S.HOLD, within_s=20.0)
        causes = [reason.name for reason in rig.status.stopped_by]
        assert "path_risk_too_high" in causes
        assert "minute_risk_too_high" not in causes
        reason = next(one for one in rig.status.stopped_by if one.name == "path_risk_too_high")
        assert "0.3 is allowed" in reason.detail
        rig.lab.set_tip_load(0.0)
        await rig.until(lambda: "path_risk_too_high" not in rig.causes, within_s=60.0)
        await rig.do(Resume)
        assert rig.state is S.RUNNING

    on_a_rig(play, path=scene.path, risk=source)


class Told(NoModel):
    """Says of the minute what it is told to, and counts the ways that were gone."""

    def __init__(self) -> None:
        super().__init__()
        self.minute: float | None = 0.0
        self.reading = RiskReading(0.0, None, 0.0, "told")
        self.gone = 0

    def assess(self, u_from: object, u_to: object, t_ns: int) -> RiskReading:
        return self.reading

    def went(self, t_ns: int) -> None:
        self.gone += 1

    def minute_risk(self, t_ns: int) -> float:
        if self.minute is None:
            raise RuntimeError("a model")
        return self.minute


def change(most: float | None) -> Any:
    def changed(robot: Any) -> Any:
        risk = robot.risk.model_copy(update={"most_in_a_minute": most})
        return robot.model_copy(update={"risk": risk})

    return changed


@pytest.mark.parametrize("too_much", [0.3, float("nan"), None], ids=["high", "nan", "fails"])
def test_a_minute_that_was_too_risky_holds_until_it_is_over(too_much: float | None) -> None:
    source = Told()

    async def play(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE)
        await asyncio.sleep(1.0)
        assert rig.state is S.RUNNING
        source.minute = too_much
        assert await rig.until_state(S.HOLD) < 0.2
        assert rig.causes == {"minute_risk_too_high"}
        assert "0.2 is allowed" in rig.status.reasons[0].detail
        refused = await rig.refused(Resume)
        assert refused.name == "held"
        source.minute = 0.1
        await asyncio.sleep(0.1)
        await rig.do(Resume)
        await asyncio.sleep(0.5)
        assert rig.state is S.RUNNING

    on_a_rig(play, risk=source, change=change(0.2))


def test_without_a_limit_it_is_told_and_nothing_else() -> None:
    source = Told()
    source.minute = 0.9

    async def play(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE)
        await asyncio.sleep(2.0)
        assert rig.state is S.RUNNING
        assert rig.status.risk.minute_risk == 0.9

    on_a_rig(play, risk=source, change=change(None))


def test_steps_that_are_refused_are_not_gone() -> None:
    source = Told()

    async def play(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE)
        await asyncio.sleep(1.0)
        gone = source.gone
        assert gone > 30
        source.reading = RiskReading(0.9, None, 0.0, "told")
        await rig.until_state(S.HOLD)
        assert source.gone <= gone + 1

    on_a_rig(play, risk=source)
