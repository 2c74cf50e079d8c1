"""A path is planned while the robot stands, followed, and planned anew when things have changed."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from config.loader import RobotFile
from daemon.host.processes import ApartError
from daemon.messages import (
    Hold,
    Load,
    MovingObstacle,
    Obstacles,
    PathPlanned,
    Plan,
    Resume,
    Start,
    Surround,
)
from daemon.reference.planned_path import read_path
from daemon.service.operation.planning import PlanRequest
from daemon.workbench.planning.plan_process import answer
from safety.states import OperatingState
from tests.daemon.service.grazing import BROYDEN
from tests.daemon.service.operation.test_surrounding import FAR_BALL, file, play, source_of
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig

__all__ = ["file"]
pytestmark = pytest.mark.usefixtures("shared_grids")

S = OperatingState
THERE = [30.0, 5.0, 192.0]
GO: dict[str, Any] = {"to_mm": THERE, "tip_speed_mm_s": 20.0}
FOLLOWING = BROYDEN | {"posture_gain_per_s": 1.0}


answered = cache(answer)
"""Several tests ask for the same path: it is the same to the last bit."""


async def plan_here(request: bytes) -> bytes:
    """In virtual time nothing takes long."""
    return answered(request)


async def followed(rig: Rig, **trajectory: Any) -> None:
    """Until it has come to the path's end."""
    await rig.do(Load, trajectory={"kind": "planned", **trajectory}, controller=FOLLOWING)
    await rig.do(Start)
    assert rig.in_state(S.RUNNING)
    await rig.until(lambda: not rig.in_state(S.RUNNING), within_s=120.0)
    assert rig.in_state(S.ARMED), rig.causes


def off_mm(rig: Rig) -> float:
    tip = rig.service.loop.tip
    assert tip is not None
    return float(np.linalg.norm(tip.position_mm - THERE))


def test_a_path_is_planned_from_where_it_stands_and_leads_there(
    file: RobotFile, tmp_path: Path
) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        shafts = rig.shafts()
        made = await rig.do(Plan, **GO)
        assert rig.in_state(S.ARMED) and rig.shafts() == pytest.approx(shafts, abs=2.0)
        assert made.path is not None
        kept = read_path(tmp_path / "files" / made.file)
        assert kept.model_dump(mode="json") == made.path
        assert kept.surroundings_sha256 == rig.status.risk.surroundings_sha256
        assert kept.u[0] == pytest.approx([0.0] * 4, abs=0.1)
        assert kept.tip_mm[-1] == pytest.approx(THERE, abs=2.0)
        assert kept.figures["contact_risk_upper_limit"] <= 0.05
        await followed(rig, file=made.file)
        assert off_mm(rig) < 4.0
        assert (tmp_path / made.file).is_file(), "beside the recording"

    rig = play(scene, file, plan_path=plan_here, files=tmp_path / "files", folder=tmp_path)
    (told,) = [message for message in rig.told if isinstance(message, PathPlanned)]
    assert told.to_mm == pytest.approx(THERE, abs=2.0)
    assert told.contact_risk is not None and told.clearance_mm is not None


def test_held_on_its_way_it_is_planned_anew_among_what_is_there_then(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        first = await rig.do(Plan, **GO)
        await rig.do(Load, trajectory={"kind": "planned", "path": first.path}, controller=FOLLOWING)
        await rig.do(Start)
        await rig.until(lambda: off_mm(rig) < 15.0, within_s=60.0)
        await rig.do(Hold)
        moved = {**FAR_BALL, "centre_mm": [50.0, 40.0, 150.0], "radius_mm": 8.0}
        await rig.do(Surround, surface={"regions": [moved]}, add=True)
        refused = await rig.refused(Resume)
        assert refused.name == "other_surroundings"
        again = await rig.refused(
            Load, trajectory={"kind": "planned", "path": first.path}, controller=FOLLOWING
        )
        assert again.name == "other_surroundings"
        assert (await rig.refused(Start)).name != "", "what is loaded is what was held"
        assert rig.in_state(S.HOLD)
        second = await rig.do(Plan, **GO)
        assert second.path is not None and first.path is not None
        assert second.path["surroundings_sha256"] != first.path["surroundings_sha256"]
        verbs = {verb.name: verb for verb in rig.status.verbs}
        assert not verbs["start"].possible
        await rig.do(
            Load, trajectory={"kind": "planned", "path": second.path}, controller=FOLLOWING
        )
        verbs = {verb.name: verb for verb in rig.status.verbs}
        assert verbs["start"].possible, "in a hold, what was loaded since"
        await rig.do(Start)
        assert rig.in_state(S.RUNNING)
        await rig.until(lambda: not rig.in_state(S.RUNNING), within_s=120.0)
        assert rig.in_state(S.ARMED), rig.causes
        assert off_mm(rig) < 4.0

    play(scene, file, plan_path=plan_here)


def plan_and_note(asked: list[PlanRequest]) -> Callable[[bytes], Awaitable[bytes]]:
    """Plans in this process, and keeps what was asked for."""

    async def heard(request: bytes) -> bytes:
        asked.append(msgspec.json.decode(request, type=PlanRequest))
        return answered(request)

    return heard


def test_beside_something_it_is_planned_for_the_body_that_is_seen_as_the_gate_takes_it(
    file: RobotFile,
) -> None:
    asked: list[PlanRequest] = []

    async def scene(rig: Rig) -> None:
        await rig.armed()
        x, y, _ = rig.lab.body.record.state.centreline_mm[-1].tolist()
        x -= rig.lab.body.record.state.radius_mm + 5.0 + 3.0
        beside = {**FAR_BALL, "centre_mm": [x, y, 196.0], "radius_mm": 5.0}
        await rig.do(Surround, surface={"regions": [beside]}, add=True)
        await asyncio.sleep(0.1)
        assert rig.service.loop.refuses_rest() == ""
        made = await rig.do(Plan, **GO)
        tip = rig.service.loop.tip
        assert made.path is not None and tip is not None
        assert made.path["tip_mm"][0] == pytest.approx(tip.position_mm.tolist(), abs=1.0)

    play(scene, file, plan_path=plan_and_note(asked))
    any_body = msgspec.structs.replace(asked[0], seen=None)
    assert json.loads(answer(msgspec.json.encode(any_body)))["none"] == "start_touches"


def test_what_was_loaded_among_others_is_not_started(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        made = await rig.do(Plan, **GO)
        await rig.do(Load, trajectory={"kind": "planned", "path": made.path}, controller=FOLLOWING)
        await rig.do(Surround, surface={"regions": [FAR_BALL]}, add=True)
        assert (await rig.refused(Start)).name == "other_surroundings"
        await rig.do(Surround)
        await rig.do(Start)
        assert rig.in_state(S.RUNNING)

    play(scene, file, plan_path=plan_here)


def test_what_moves_is_kept_away_from_where_it_may_be(file: RobotFile) -> None:
    beside = MovingObstacle(centre_mm=[60.0, 5.0, 190.0], radius_mm=6.0, velocity_mm_s=[-9.0, 0, 0])
    asked: list[PlanRequest] = []

    async def scene(rig: Rig) -> None:
        await rig.armed()
        far = await rig.do(Plan, **GO)
        rig.operator.obstacles("camera", Obstacles(sequence=1, balls=[beside], valid_for_s=1.0))
        refused = await rig.refused(Plan, to_mm=[45.0, 5.0, 190.0])
        assert "with 1 moving obstacle where they may be" in refused.text
        near = await rig.do(Plan, to_mm=[-x for x in THERE[:2]] + THERE[2:])
        assert far.path is not None and near.path is not None
        assert far.path["figures"]["moving_obstacles"] == 0
        assert near.path["figures"]["moving_obstacles"] == 1
        assert near.path["surroundings_sha256"] == far.path["surroundings_sha256"]

    play(scene, file, plan_path=plan_and_note(asked))
    assert [len(request.moving) for request in asked] == [0, 1, 1]
    x, y, z, *way, radius_mm = asked[1].moving[0]
    assert (x, y, z, radius_mm) == (60.0, 5.0, 190.0, 6.0)
    assert -14.0 < way[0] < -9.0, "a second that it is believed, and a step that is begun by then"


def test_while_nobody_knows_where_something_moves_nothing_is_planned(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        there = MovingObstacle(centre_mm=[80.0, 0.0, 150.0], radius_mm=5.0)
        rig.operator.obstacles("camera", Obstacles(sequence=1, balls=[there]))
        await asyncio.sleep(1.0)
        shafts = rig.shafts()
        refused = await rig.refused(Plan, to_mm=THERE)
        assert refused.name == "obstacles_late"
        assert "camera" in refused.text
        assert rig.shafts() == pytest.approx(shafts, abs=2.0)
        rig.operator.obstacles("camera", Obstacles(sequence=2, balls=[]))
        await rig.do(Plan, **GO)

    play(scene, file, plan_path=plan_here)


NONE_THERE: dict[str, tuple[str, dict[str, Any]]] = {
    "out of reach": ("goal_out_of_reach", {"to_mm": [0.0, 0.0, 205.0]}),
    "outside the workspace": ("goal_outside_workspace", {"to_mm": [0.0, 0.0, 500.0]}),
    "two numbers": ("bad_goal", {"to_mm": [1.0, 2.0]}),
    "no direction": ("bad_goal", {"to_mm": THERE, "pointing": [0.0, 0.0, 0.0]}),
    "no speed": ("bad_goal", {"to_mm": THERE, "tip_speed_mm_s": 0.0}),
    "no probability": ("bad_goal", {"to_mm": THERE, "most_risk": 1.5}),
    "too many places": ("bad_goal", {"to_mm": THERE, "via_mm": [THERE] * 17}),
}


def test_where_there_is_no_path_the_reason_is_told_and_nothing_moves(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        shafts = rig.shafts()
        for case, (name, asked) in NONE_THERE.items():
            refused = await rig.refused(Plan, **asked)
            assert refused.name == name and refused.text, case
            assert rig.shafts() == pytest.approx(shafts, abs=2.0), case

    play(scene, file, plan_path=plan_here)


def test_a_goal_inside_what_was_added_is_refused_with_its_place(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        there = {**FAR_BALL, "centre_mm": THERE, "radius_mm": 8.0}
        await rig.do(Surround, surface={"regions": [there]}, add=True)
        assert (await rig.refused(Plan, to_mm=THERE)).name == "goal_in_solid"

    play(scene, file, plan_path=plan_here)


def test_while_it_moves_nothing_is_planned(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE | {"radius_mm": 5.0}, BROYDEN)
        refused = await rig.refused(Plan, to_mm=THERE)
        assert (refused.name, refused.text) == (
            "wrong_state",
            "the robot is running: plan while it is armed or held",
        )
        verbs = {verb.name: verb for verb in rig.status.verbs}
        assert not verbs["plan"].possible

    play(scene, file, plan_path=plan_here)


def test_one_path_is_planned_at_a_time_and_among_what_is_there_at_its_end(
    file: RobotFile,
) -> None:
    waiting = asyncio.Event()

    async def slowly(request: bytes) -> bytes:
        await waiting.wait()
        return answered(request)

    async def scene(rig: Rig) -> None:
        await rig.armed()
        asked = asyncio.create_task(rig.ask(Plan(token=rig.token, to_mm=THERE)))
        await asyncio.sleep(0.1)
        assert (await rig.refused(Plan, to_mm=THERE)).name == "busy"
        await rig.do(Surround, surface={"regions": [FAR_BALL]}, add=True)
        waiting.set()
        assert getattr(await asked, "name", "") == "other_surroundings"
        assert len(source_of(rig).files.surroundings.regions) == 1

    play(scene, file, plan_path=slowly)


@pytest.mark.parametrize("failing", [ApartError("it took more than 90 s"), TimeoutError(), b"{]"])
def test_a_planner_that_gives_no_answer_is_told(
    file: RobotFile, failing: Exception | bytes
) -> None:
    async def fails(request: bytes) -> bytes:
        asked = json.loads(request)
        assert set(asked) == set(PlanRequest.__struct_fields__)
        if isinstance(failing, bytes):
            return failing
        raise failing

    async def scene(rig: Rig) -> None:
        await rig.armed()
        refused = await rig.refused(Plan, to_mm=THERE)
        assert refused.name == "not_planned"
        assert "the planner gives no answer: " in refused.text
        assert (await rig.refused(Plan, to_mm=THERE)).name == "not_planned"

    play(scene, file, plan_path=fails)


def test_a_robot_without_a_model_plans_nothing() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        assert (await rig.refused(Plan, to_mm=THERE)).name == "no_model"

    on_a_rig(scene, plan_path=plan_here)
