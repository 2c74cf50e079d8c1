"""Other surroundings over the wire, as processes: the loop goes on while they are prepared."""

import asyncio
import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from daemon.files import models_directory
from daemon.messages import MovingObstacle, Upload
from daemon.remote.client.client_errors import RefusedError
from daemon.risk.mesh_file import binary_stl, write_mesh
from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, ball, chest
from daemon.workbench.report.report import write_report
from safety.states import OperatingState
from tests.hil.daemon_rig import Rig, short_folder
from tests.hil.test_tendon_arm import BROYDEN, ended, patient, seen

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("tendon_arm")]

S = OperatingState
PORT = {
    "centre_mm": list(CHEST_PORT.centre_mm),
    "inwards": list(CHEST_PORT.inwards),
    "radius_mm": CHEST_PORT.radius_mm,
    "depth_mm": CHEST_PORT.depth_mm,
}
BALL = {"kind": "ball", "name": "seed", "centre_mm": [60.0, 0.0, 100.0], "radius_mm": 6.0}


def test_a_chest_of_fifty_thousand_triangles_is_exchanged_while_the_arm_is_armed() -> None:
    content = binary_stl(chest(50_000, seed=4))
    with short_folder() as folder:
        one = Rig(folder, patient(folder))
        try:
            one.armed()
            one.from_now_on()
            before = one.status().risk.surroundings_sha256
            mesh = one.user.do(one.client.upload("today.stl", content))
            answer = one.user.do(
                one.client.surround({"mesh": mesh, "free": "inside", "port": PORT})
            )
            assert "today.stl, 50000 triangles" in answer.text or "today.stl, " in answer.text
            one.user.do(one.client.surround({"regions": [BALL]}, add=True))
            about, stl = one.user.do(one.client.surroundings())
            status = one.status()
            assert status.state == S.ARMED.value
            assert status.risk.surroundings_sha256 == about.counts_sha256 != before
            assert hashlib.sha256(stl).hexdigest() == about.sha256
            assert [region["name"] for region in about.regions] == ["seed"]
            assert not one.events("cause", "loop_late")
            cut_off(one, content)
            stream_that_stops(one)
            assert one.status().risk.surroundings_sha256 == about.counts_sha256
            recorded = Path(str(status.recording))
            one.user.do(one.client.disarm())
        finally:
            one.leave()
        told = seen(recorded, "/surroundings_changed")
        assert told[0]["file"] == "surroundings.stl"
        assert told[-1]["sha256"] == about.counts_sha256
        assert (recorded / told[-1]["file"]).is_file()


def stream_that_stops(one: Rig) -> None:
    """A camera's program that ends in the middle of it, and is there again."""
    place, velocity = [80.0, 0.0, 120.0], [1.0, 0.0, 0.0]
    ball = MovingObstacle(centre_mm=place, radius_mm=5.0, velocity_mm_s=velocity)

    async def stream(seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            one.client.send_obstacles([ball], valid_for_s=1.0)
            await asyncio.sleep(0.05)

    one.user.do(stream(1.0))
    assert one.status().risk.moving_obstacles == 1
    assert not one.events("cause", "obstacles_late")
    one.until_told("obstacles_late")
    one.user.do(stream(0.5))
    one.until(lambda: "obstacles_late" not in one.causes())

    async def end() -> None:
        one.client.send_obstacles([])

    one.user.do(end())
    one.until(lambda: one.status().risk.moving_obstacles == 0)


def cut_off(one: Rig, content: bytes) -> None:
    """A client that goes away in the middle of it."""
    digest = hashlib.sha256(content + b"x").hexdigest()
    part = Upload(
        name="late.stl", sha256=digest, size_bytes=len(content) + 1, offset=0, data=content[:40_000]
    )
    one.user.do(one.client.send(part))
    with pytest.raises(RefusedError, match="40000 of") as refused:
        one.user.do(one.client.surround({"mesh": f"upload:{digest}", "free": "inside"}))
    assert refused.value.refusal.name == "upload_incomplete"


GOAL = [30.0, 5.0, 192.0]
FOLLOWING = BROYDEN | {"posture_gain_per_s": 1.0}
CLOSE_MM = 5.0


def test_what_comes_in_the_way_of_a_planned_path_is_gone_round() -> None:
    """Plan, follow; a ball comes in the way, the arm holds. While it is where the path has to end
    there is none, and that is told; then plan anew among all that is there, and arrive. The report
    shows both plans and what they were said to risk."""
    with short_folder() as folder:
        one = Rig(folder, in_the_open(folder))
        try:
            one.armed()
            one.from_now_on()
            first = one.user.do(one.client.plan(GOAL))
            assert one.state is S.ARMED
            assert first.path is not None
            one.user.do(one.client.load({"kind": "planned", "file": first.file}, FOLLOWING))
            one.user.do(one.client.start())
            one.until(lambda: off_mm(one) < 20.0, WITHIN_S)
            camera = Camera(one)
            camera.sees(in_the_way(first.path))
            one.until(lambda: one.state is S.HOLD, 20.0)
            assert "risk_too_high" in {why.name for why in one.status().stopped_by}
            none = one.user.refused(one.client.plan(GOAL))
            assert "with 1 moving obstacle where they may be" in none.text, none
            camera.sees(ASIDE_MM)
            put = {"kind": "ball", "centre_mm": [*BESIDE_MM], "radius_mm": 6.0}
            one.user.do(one.client.surround({"regions": [put]}, add=True))
            with pytest.raises(RefusedError) as refused:
                one.user.do(one.client.resume())
            assert refused.value.refusal.name == "other_surroundings"
            second = one.user.do(one.client.plan(GOAL))
            assert second.path is not None
            assert second.path["surroundings_sha256"] != first.path["surroundings_sha256"]
            assert second.path["figures"]["moving_obstacles"] == 1
            one.user.do(one.client.load({"kind": "planned", "file": second.file}, FOLLOWING))
            one.user.do(one.client.start())
            one.until(lambda: ended(one), WITHIN_S)
            assert one.state is S.ARMED, one.causes()
            assert off_mm(one) < CLOSE_MM
            camera.sees(None)
            recorded = Path(str(one.status().recording))
            one.user.do(one.client.disarm())
        finally:
            one.leave()
        planned = seen(recorded, "/path_planned")
        assert [told["file"] for told in planned] == [first.file, second.file]
        for told in planned:
            (models_directory() / told["file"]).unlink()
        assert all((recorded / told["file"]).is_file() for told in planned)
        page = write_report(recorded).read_text()
        for said in ("Planned paths", "What was planned", first.file, second.file, "risk_too_high"):
            assert said in page
        left = [told.get("path_risk") for told in seen(recorded, "/risk")]
        assert any(risk is not None for risk in left), "of what is left of the path"
        assert len(seen(recorded, "/surroundings_changed")) == 2
        assert seen(recorded, "/obstacles_taken")


WITHIN_S = 150.0
BESIDE_MM = (45.0, 45.0, 150.0)
"""Where what came in the way has gone."""
ASIDE_MM = (-45.0, -45.0, 150.0)
"""Where the camera sees it then."""


def in_the_open(folder: Path) -> Path:
    """The shipped arm, with nothing near it."""
    path = patient(folder)
    robot = yaml.safe_load(path.read_text())
    write_mesh(folder / "far.stl", ball(10.0, (150.0, 0.0, 0.0), 200))
    robot["risk"] |= {"surface": {"mesh": "far.stl", "free": "outside"}, "slide": False}
    path.write_text(yaml.safe_dump(robot))
    return path


def in_the_way(path: dict[str, Any]) -> list[float]:
    """A place that the body will come to, and where it is not yet."""
    x, y, z = path["tip_mm"][-1]
    return [1.4 * x, 1.4 * y, z - 5.0]


class Camera:
    """Tells of one ball again and again, on the client's own loop."""

    def __init__(self, one: Rig) -> None:
        self._one = one
        self._telling: asyncio.Task[None] | None = None

    def sees(self, place_mm: Sequence[float] | None) -> None:
        """None: it has gone."""
        self._one.user.do(self._change(place_mm))

    async def _change(self, place_mm: Sequence[float] | None) -> None:
        if self._telling is not None:
            self._telling.cancel()
            self._telling = None
        if place_mm is None:
            self._one.client.send_obstacles([])
        else:
            self._telling = asyncio.create_task(self._tell(list(place_mm)))

    async def _tell(self, place_mm: list[float]) -> None:
        ball = MovingObstacle(centre_mm=place_mm, radius_mm=6.0)
        while True:
            self._one.client.send_obstacles([ball], valid_for_s=1.0)
            await asyncio.sleep(0.05)


def off_mm(one: Rig) -> float:
    tip_mm = one.status().tip_mm
    return math.inf if tip_mm is None else math.dist(tip_mm, GOAL)
