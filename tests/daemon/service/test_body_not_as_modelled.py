"""A tip that is not where the model of the body has it: nothing is armed, nothing moves on."""

import asyncio
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from config.loader import load_robot
from daemon.messages import Acquire, Arm, Load, Resume, Risk, Start
from daemon.risk.model_file import read_model
from daemon.workbench.body_model.clouds.configurations import Candidates
from daemon.workbench.body_model.clouds.emulated_body import EmulatedBody
from safety.risk.tip_consistency import TipConsistency, TipModel
from safety.risk_source import NoModel, RiskReading, TipComparison
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.service.gates_edge import THRESHOLD, Edge
from tests.daemon.service.gates_edge import play as play_edge
from tests.daemon.service.rig import MODEL, SMALL_CIRCLE, Rig, on_a_rig
from tests.daemon.service.undeclared_load import LOAD_G, Course, play

CAUSE = "body_not_as_modelled"
FITS = TipComparison(0.1, 0.4, 2.0, "")
OFF = TipComparison(1.2, 1e-9, 20.0, "it is off")


class Comparing(NoModel):
    """Says of the tip what it is told to."""

    def __init__(self) -> None:
        super().__init__()
        self.answer: TipComparison | None = FITS
        self.asked: list[tuple[int, int]] = []

    def compare(
        self,
        lately: Sequence[Sequence[float]],
        tip_mm: Sequence[float],
        t_ns: int,
        direction: Sequence[float] | None = None,
    ) -> TipComparison | None:
        assert len(tip_mm) == 3
        self.asked.append((t_ns, len(lately)))
        return self.answer

    def assess(
        self, u_from: Sequence[float], u_to: Sequence[float], t_ns: int
    ) -> RiskReading | None:
        doubt = "" if self.answer is None else self.answer.doubt
        return RiskReading(0.0, None, 0.0, "comparing", doubt=doubt)


def test_a_robot_whose_body_is_another_is_not_armed_until_it_is_the_one_again() -> None:
    source = Comparing()

    async def scene(rig: Rig) -> None:
        source.answer = OFF
        await rig.until_state(OperatingState.STANDBY)
        assert rig.causes == {CAUSE}
        await rig.do(Acquire)
        refused = await rig.refused(Arm)
        assert refused.name == "not_ready"
        assert [reason.name for reason in refused.reasons] == [CAUSE]
        assert "tip_load_g" in refused.reasons[0].remedy
        source.answer = FITS
        await rig.until_state(OperatingState.READY)
        await rig.do(Arm)

    on_a_rig(scene, risk=source)


def test_an_armed_robot_does_not_start_with_another_body() -> None:
    source = Comparing()

    async def scene(rig: Rig) -> None:
        await rig.armed()
        await rig.do(Load, trajectory=SMALL_CIRCLE, controller=MODEL)
        source.answer = OFF
        await rig.until(lambda: rig.causes == {CAUSE})
        refused = await rig.refused(Start)
        assert "keeps the robot from moving" in refused.text
        assert rig.state is OperatingState.ARMED
        source.answer = FITS
        await rig.until(lambda: not rig.causes)
        await rig.do(Start)

    on_a_rig(scene, risk=source)


def test_a_moving_robot_holds_says_it_once_and_goes_on_when_the_body_fits_again() -> None:
    source = Comparing()

    async def scene(rig: Rig) -> None:
        await rig.running()
        await rig.until(lambda: any(isinstance(message, Risk) for message in rig.told))
        source.answer = OFF
        assert await rig.until_state(OperatingState.HOLD) < 0.1
        await asyncio.sleep(1.0)
        assert rig.causes == {CAUSE}, "what follows from it is not told beside it"
        last = [message for message in rig.told if isinstance(message, Risk)][-1]
        assert (last.tip_statistic, last.tip_off_mm) == (OFF.statistic, OFF.off_mm)
        source.answer = None
        await asyncio.sleep(1.0)
        assert rig.causes == {CAUSE}, "who says nothing takes nothing back"
        source.answer = FITS
        await rig.until(lambda: not rig.causes)
        await rig.do(Resume)
        assert rig.state is OperatingState.RUNNING

    on_a_rig(scene, risk=source)


def test_only_believed_tips_are_compared_and_with_where_the_axes_were_before() -> None:
    source = Comparing()

    async def scene(rig: Rig) -> None:
        await asyncio.sleep(1.0)
        rig.lab.inject("tracker.missing=1s")
        await asyncio.sleep(0.2)
        before = len(source.asked)
        await asyncio.sleep(0.6)
        assert len(source.asked) == before
        await asyncio.sleep(1.5)
        assert len(source.asked) > before
        assert {count for _, count in source.asked} == {4}

    on_a_rig(scene, risk=source)


def test_the_shipped_soft_arm_with_a_load_is_told_from_one_without() -> None:
    """On random ways, with nothing between the plant and the test."""
    robot = load_robot(SOFT_ARM).robot
    read = read_model(SOFT_ARM.parents[1] / "models" / "soft_arm.npz")
    candidates = Candidates(robot, 4242)
    u = [u for u in candidates.actuation(candidates.parameters(0, 30)) if candidates.possible(u)]
    assert robot.emulation is not None
    alarms = {}
    for load_g in (0.0, LOAD_G):
        emulation = robot.emulation.model_copy(update={"tip_load_g": load_g})
        body = EmulatedBody(robot.model_copy(update={"emulation": emulation}))
        test, tip, t_ns = TipConsistency(), TipModel(read.model, 1.0), 0
        alarms[load_g] = 0
        for there in u:
            state = body.go(there)
            place = tip.place([there], state.tip.position_mm)
            assert place is not None
            for _ in range(40):
                t_ns += 25_000_000
                test.add(place.probability, t_ns)
            alarms[load_g] += not test.consistent
    assert alarms[0.0] == 0
    assert alarms[LOAD_G] > 0.5 * len(u)


at_the_edge = pytest.mark.parametrize("seed", [2, pytest.param(38, marks=pytest.mark.long)])


@at_the_edge
def test_at_the_gates_edge_a_load_is_told_from_the_tip_and_touches_nothing(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ball as near as the model allows, where the weight bends the body to.

    In seed 38 the arm goes so fast that it sinks on by 3 mm while the comparison makes up its mind.
    """
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    edge = Edge.of(seed, tmp_path)
    assert 0.02 < edge.risk <= THRESHOLD
    seeing = play_edge(edge, tmp_path, seeing=True)
    assert (seeing.touched, seeing.arrived, seeing.state) == (False, False, OperatingState.HOLD)
    assert seeing.causes <= {CAUSE, "risk_too_high"}
    assert seeing.least_clearance_mm > 2.0


@pytest.mark.long
@at_the_edge
def test_unless_the_tip_is_compared_with_the_model_it_touches(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    unseeing = play_edge(Edge.of(seed, tmp_path), tmp_path, seeing=False)
    assert (unseeing.touched, unseeing.by_the_drop, unseeing.arrived) == (True, False, True)
    assert unseeing.least_clearance_mm < -3.0


@pytest.mark.parametrize(
    ("seed", "given_tip", "least_mm"),
    [
        (34, True, 2.0),
        pytest.param(4, True, 2.0, marks=pytest.mark.long),
        pytest.param(4, False, 5.0, marks=pytest.mark.long),
    ],
)
def test_among_balls_an_arm_with_a_load_touches_nothing(
    seed: int, given_tip: bool, least_mm: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the tip is off by counts. Given the tip the arm is known better, and may go nearer."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    found = play(Course.of(seed), tmp_path, given_tip)
    assert found.touched_at_s is None
    assert found.least_clearance_mm > least_mm
    assert np.isfinite(found.highest_statistic)
