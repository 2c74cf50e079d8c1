"""What comes slowly is given way to, or the robot holds by name; nothing touches."""

import asyncio
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from config.loader import RobotFile, load_robot
from daemon.loop.step_messages import SLIDING
from daemon.messages import Disarm, Hold, Load, MovingObstacle, Obstacles, Risk, Start, Surround
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.daemon.service.grazing import BROYDEN, TENDON_ARM, StoppedClock
from tests.daemon.service.rig import MODEL, Rig, on_a_rig

pytestmark = pytest.mark.usefixtures("shared_grids")

S = OperatingState
CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 187.0],
    "plane": "xy",
    "radius_mm": 20.0,
    "cycle_s": 20.0,
    "cycles": 20,
}
MIDDLE_MM = 115.0
"""Above the base: six tenths of the arm."""
RADIUS_MM = 12.0
FROM_MM = 60.0
EVERY_S = 0.05


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> RobotFile:
    """The soft arm with nothing near it."""
    return in_the_open(tmp_path_factory.mktemp("open"), SOFT_ARM, "builtin:soft_arm.npz")


def in_the_open(folder: Path, arm: Path, model: str) -> RobotFile:
    write_mesh(folder / "far.stl", ball(10.0, (200.0, 0.0, 0.0), 200))
    robot: dict[str, Any] = yaml.safe_load(arm.read_text())
    surface = {"mesh": "far.stl", "free": "outside", "grid_mm": 3.0}
    robot["risk"] = {"model": model, "surface": surface}
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return load_robot(folder / "robot.yaml")


@dataclass
class Seen:
    """What became of the arm, as the plant itself has it."""

    state: str = ""
    causes: set[str] = field(default_factory=set)
    warned_ns: int | None = None
    """When it was told that the robot does nothing but give way; None: it was not."""
    stopped_at_mm: float = 0.0
    """Where the ball was when the robot held, or stayed."""
    clearances_mm: list[float] = field(default_factory=list)
    seen_ns: list[int] = field(default_factory=list)
    middle_x_mm: list[float] = field(default_factory=list)
    turned_aside: int = 0
    errors_mm: list[float] = field(default_factory=list)


def played(
    file: RobotFile,
    comes_to_mm: float,
    speed_mm_s: float,
    controller: dict[str, Any] | None = None,
) -> Seen:
    """Once the arm goes round, a ball comes along x at its middle's height, as far as that, and
    stays; where the arm holds it stays at once."""
    seen, place = Seen(), {"x": FROM_MM, "moves": 0.0}

    def told() -> list[MovingObstacle]:
        velocity = [-speed_mm_s * place["moves"], 0.0, 0.0]
        centre = [place["x"], 0.0, MIDDLE_MM]
        return [MovingObstacle(centre_mm=centre, radius_mm=RADIUS_MM, velocity_mm_s=velocity)]

    async def camera(rig: Rig) -> None:
        number = 0
        while True:
            explored = bool(rig.tips) and rig.tips[-1].cycle >= 0
            comes = explored and place["x"] > comes_to_mm and rig.in_state(S.RUNNING)
            place["moves"] = float(comes)
            place["x"] -= place["moves"] * speed_mm_s * EVERY_S
            number += 1
            rig.operator.obstacles("camera", Obstacles(sequence=number, balls=told()))
            look(rig)
            await asyncio.sleep(EVERY_S)

    def look(rig: Rig) -> None:
        state = rig.lab.body.record.state
        line = np.asarray(state.centreline_mm)
        fine = np.concatenate([line[:-1] + share * np.diff(line, axis=0) for share in (0, 0.5)])
        away = np.linalg.norm(fine - [place["x"], 0.0, MIDDLE_MM], axis=1).min()
        seen.clearances_mm.append(float(away) - RADIUS_MM - state.radius_mm)
        seen.seen_ns.append(rig.service.clock.now_ns())
        seen.middle_x_mm.append(float(line[round(0.6 * (len(line) - 1)), 0]))

    async def scene(rig: Rig) -> None:
        streaming = asyncio.create_task(camera(rig))
        await asyncio.sleep(0.1)
        await rig.running(CIRCLE, controller or {"kind": "broyden"})
        await rig.until(lambda: rig.tips[-1].cycle >= 0, within_s=60.0)
        lasts_s = (FROM_MM - comes_to_mm) / speed_mm_s + 6.0
        with suppress(AssertionError):
            await rig.until(lambda: rig.in_state(S.HOLD), within_s=lasts_s)
        await asyncio.sleep(0.5)
        seen.state, seen.causes, seen.stopped_at_mm = rig.state.value, rig.causes, place["x"]
        warned = rig.events("cause", "giving_way")
        seen.warned_ns = warned[0].t_ns if warned else None
        streaming.cancel()
        await asyncio.gather(streaming, return_exceptions=True)

    rig = on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()))
    risks = [message for message in rig.told if isinstance(message, Risk)]
    seen.turned_aside = sum(SLIDING in message.reasons for message in risks)
    seen.errors_mm = [
        tip.error_mm for tip in rig.tips if tip.error_mm is not None and tip.cycle >= 0
    ]
    return seen


@pytest.mark.long
def test_a_ball_that_comes_slowly_toward_the_middle_is_given_way_to(file: RobotFile) -> None:
    seen = played(file, 20.0, 5.0)
    assert seen.stopped_at_mm <= 20.0, "it has come all the way"
    assert seen.state == S.RUNNING.value, seen.causes
    assert seen.turned_aside > 100
    assert min(seen.clearances_mm) > 1.0
    # Where the middle went without it, it would stand in the arm.
    assert min(seen.middle_x_mm) < seen.middle_x_mm[0] - 5.0


@pytest.mark.long
@pytest.mark.parametrize("speed_mm_s", [40.0, 80.0])
def test_that_something_comes_faster_than_the_arm_goes_is_told_before_it_touches(
    file: RobotFile, speed_mm_s: float
) -> None:
    seen = played(file, -20.0, speed_mm_s)
    assert seen.warned_ns is not None
    touched = [
        at_ns
        for at_ns, clear_mm in zip(seen.seen_ns, seen.clearances_mm, strict=True)
        if clear_mm <= 0.0
    ]
    if touched:
        assert seen.warned_ns < touched[0]


def test_what_comes_onto_a_body_that_stands_energised_is_told(file: RobotFile) -> None:
    place_mm = [FROM_MM, 0.0, MIDDLE_MM]

    async def camera(rig: Rig) -> None:
        for number in range(1, 1000):
            balls = [MovingObstacle(centre_mm=place_mm, radius_mm=RADIUS_MM)]
            rig.operator.obstacles("camera", Obstacles(sequence=number, balls=balls))
            await asyncio.sleep(EVERY_S)

    async def scene(rig: Rig) -> None:
        streaming = asyncio.create_task(camera(rig))
        await rig.armed()
        await asyncio.sleep(1.0)
        assert rig.causes == set(), "it is far away"
        place_mm[0] = 10.0
        await rig.until(lambda: "near_at_rest" in rig.causes, within_s=0.5)
        assert rig.in_state(S.ARMED), "it is only told"
        assert "along the body" in rig.events("cause", "near_at_rest")[0].detail
        place_mm[0] = FROM_MM
        await rig.until(lambda: rig.causes == set(), within_s=0.5)
        place_mm[0] = 10.0
        await rig.until(lambda: "near_at_rest" in rig.causes)
        await rig.do(Disarm)
        assert "near_at_rest" not in rig.causes, "nothing is energised"
        streaming.cancel()
        await asyncio.gather(streaming, return_exceptions=True)

    on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()))


def test_a_wall_between_the_tip_and_its_reference_is_told(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        wall_mm = rig.lab.body.record.state.radius_mm + 8.0
        wall = {"kind": "half_space", "point_mm": [wall_mm, 0, 0], "normal": [-1, 0, 0]}
        await rig.do(Surround, surface={"regions": [wall]}, add=True)
        await rig.do(Load, trajectory=CIRCLE | {"radius_mm": 30.0}, controller=MODEL)
        await rig.do(Start)
        await rig.until(lambda: "kept_away" in rig.causes, within_s=20.0)
        assert rig.in_state(S.RUNNING)
        assert rig.tips[-1].error_mm is not None and rig.tips[-1].error_mm > 6.0
        await rig.do(Hold)
        await rig.until(lambda: "kept_away" not in rig.causes)

    on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()))


def test_an_arm_of_four_tendons_gives_way_or_holds_by_name(tmp_path: Path) -> None:
    arm = in_the_open(tmp_path, TENDON_ARM, "builtin:tendon_arm.npz")
    seen = played(arm, 20.0, 8.0, BROYDEN)
    if seen.state == S.HOLD.value:
        assert seen.causes == {"risk_too_high"}
        assert seen.stopped_at_mm > 20.0, "before it has come all the way"
    else:
        assert seen.state == S.RUNNING.value, seen.causes
        assert seen.turned_aside > 100
    assert min(seen.clearances_mm) > 0.0
