"""Other surroundings over the wire, as processes: the loop goes on while they are prepared."""

import asyncio
import hashlib
from pathlib import Path

import pytest

from daemon.messages import MovingObstacle, Upload
from daemon.remote.client.client_errors import RefusedError
from daemon.risk.mesh_file import binary_stl
from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, chest
from safety.states import OperatingState
from tests.hil.daemon_rig import Rig, short_folder
from tests.hil.test_tendon_arm import patient, seen

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
