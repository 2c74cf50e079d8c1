"""Other surroundings while the robot stands still; and all that leaves the old ones in force."""

import asyncio
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from config.loader import RobotFile, load_robot
from daemon.messages import (
    Answer,
    Hold,
    Load,
    Refusal,
    Resume,
    Start,
    Stop,
    Surround,
    SurroundingsChanged,
    Upload,
)
from daemon.risk.body_risk_source import BodyRiskSource, make_risk_source
from daemon.risk.mesh_file import binary_stl, write_mesh
from daemon.risk.preparation import MOST_TRIANGLES
from daemon.service.operation.uploads import MOST_PART_BYTES
from daemon.workbench.body_model.evaluation.shapes import CHEST_PORT, ball, box, chest
from safety.risk.surroundings.environment import Mesh
from safety.states import OperatingState
from tests.daemon.service.grazing import BROYDEN, TENDON_ARM, StoppedClock
from tests.daemon.service.rig import SMALL_CIRCLE, Rig, on_a_rig

pytestmark = pytest.mark.usefixtures("shared_grids")

PORT = {
    "centre_mm": list(CHEST_PORT.centre_mm),
    "inwards": list(CHEST_PORT.inwards),
    "radius_mm": CHEST_PORT.radius_mm,
    "depth_mm": CHEST_PORT.depth_mm,
}
FAR_BALL = {"kind": "ball", "name": "far away", "centre_mm": [60.0, 0.0, 60.0], "radius_mm": 5.0}


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> RobotFile:
    """The shipped arm with a ball far from it."""
    folder = tmp_path_factory.mktemp("free")
    write_mesh(folder / "ball.stl", ball(10.0, (150.0, 0.0, 0.0), 200))
    surface = {"mesh": "ball.stl", "free": "outside", "grid_mm": 3.0}
    robot: dict[str, Any] = yaml.safe_load(TENDON_ARM.read_text())
    robot["risk"] = {"model": "builtin:tendon_arm.npz", "surface": surface}
    (folder / "robot.yaml").write_text(yaml.safe_dump(robot))
    return load_robot(folder / "robot.yaml")


async def upload(rig: Rig, content: bytes, name: str = "new.stl", sha256: str = "") -> str:
    digest = sha256 or hashlib.sha256(content).hexdigest()
    for begin in range(0, len(content), MOST_PART_BYTES):
        await rig.do(
            Upload,
            name=name,
            sha256=digest,
            size_bytes=len(content),
            offset=begin,
            data=content[begin : begin + MOST_PART_BYTES],
        )
    return f"upload:{digest}"


def source_of(rig: Rig) -> BodyRiskSource:
    source = rig.service.dependencies.risk
    assert isinstance(source, BodyRiskSource)
    return source


def play(scene: Any, file: RobotFile, **more: Any) -> Rig:
    return on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()), **more)


def test_what_is_sent_is_what_the_gate_asks_with(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        before = rig.status.risk
        await rig.armed()
        u = [0.0] * 4
        assert source_of(rig).assess(u, u, 0).contact_risk < 0.01  # type: ignore[union-attr]
        wall = box((40.0, 100.0, 300.0), (38.0, 0.0, 100.0), 2)  # leaves less than the body needs
        reference = await upload(rig, binary_stl(wall), "wall.stl")
        answer = await rig.do(Surround, surface={"mesh": reference, "free": "outside"})
        assert answer.text.startswith("wall.stl, ")
        assert rig.status.risk.source == "tendon_arm.npz, wall.stl"
        assert rig.status.risk.surroundings_sha256 != before.surroundings_sha256
        assert rig.status.risk.surroundings_sha256 in answer.text
        reading = source_of(rig).assess(u, u, 0)
        assert reading is not None and reading.contact_risk > 0.9
        assert reading.nearest is not None
        # Back to the robot file's: the same answers as before.
        await rig.do(Surround)
        assert rig.status.risk.surroundings_sha256 == before.surroundings_sha256
        assert source_of(rig).assess(u, u, 0).contact_risk < 0.01  # type: ignore[union-attr]

    rig = play(scene, file)
    changes = [told for told in rig.told if isinstance(told, SurroundingsChanged)]
    assert [change.file for change in changes] == [
        "surroundings.stl",
        f"surroundings-{changes[1].sha256[:12]}.stl",
        f"surroundings-{changes[2].sha256[:12]}.stl",
    ]
    assert changes[0].sha256 == changes[2].sha256


def test_who_puts_something_where_the_body_stands_is_told_at_once(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        touching = {**FAR_BALL, "centre_mm": [0.0, 0.0, 120.0]}
        answer = await rig.do(Surround, surface={"regions": [touching]}, add=True)
        assert "; the body touches something where it stands" in answer.text
        assert "mm along the body, there (" in answer.text
        assert rig.events("note", "surroundings")[-1].text == answer.text
        free = await rig.do(Surround)
        assert "touches" not in free.text

    play(scene, file)


def test_a_recording_keeps_the_meshes_that_come_while_it_goes_on(
    file: RobotFile, tmp_path: Path
) -> None:
    wall = box((40.0, 100.0, 300.0), (90.0, 0.0, 100.0), 2)

    async def scene(rig: Rig) -> None:
        await rig.armed()
        reference = await upload(rig, binary_stl(wall), "wall.stl")
        await rig.do(Surround, surface={"mesh": reference, "free": "outside"})
        sha256 = rig.status.risk.surroundings_sha256
        kept = tmp_path / f"surroundings-{sha256[:12]}.stl"
        assert kept.stat().st_size == len(binary_stl(wall))

    on_a_rig(scene, path=file.path, risk=make_risk_source(file, StoppedClock()), folder=tmp_path)


def test_bodies_and_regions_are_added_and_placed(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        reference = await upload(rig, binary_stl(ball(8.0, (0.0, 0.0, 0.0), 200)), "seed.stl")
        half = float(np.sqrt(0.5))
        placed = {"mesh": reference, "at_mm": [0.0, 0.0, 150.0], "turned": [half, 0, half, 0]}
        u = [0.0] * 4
        await rig.do(Surround, surface={"regions": [FAR_BALL]}, add=True)
        assert rig.status.risk.source == "tendon_arm.npz, ball.stl and 1 region"
        assert source_of(rig).assess(u, u, 0).contact_risk < 0.01  # type: ignore[union-attr]
        await rig.do(Surround, surface={"bodies": [placed]}, add=True)
        assert rig.status.risk.source == "tendon_arm.npz, ball.stl and 1 more mesh and 1 region"
        assert source_of(rig).assess(u, u, 0).contact_risk > 0.9  # type: ignore[union-attr]

    play(scene, file)


def test_a_body_that_is_to_stay_in_a_region_is_kept_in_it(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        room = {"kind": "box", "keep": "in", "centre_mm": [0, 0, 100], "size_mm": [120, 120, 280]}
        await rig.do(Surround, surface={"regions": [room]}, add=True)
        u = [0.0] * 4
        assert source_of(rig).assess(u, u, 0).contact_risk < 0.01  # type: ignore[union-attr]
        low = room | {
            "centre_mm": [0.0, 0.0, 70.0],
            "size_mm": [120.0, 120.0, 220.0],
        }  # the tip is at 200
        await rig.do(Surround, surface={"regions": [low]}, add=True)
        assert source_of(rig).assess(u, u, 0).contact_risk > 0.9  # type: ignore[union-attr]

    play(scene, file)


# What is refused.


def open_box() -> bytes:
    mesh = box((40.0, 60.0, 60.0), (90.0, 0.0, 100.0), 2)
    return binary_stl(Mesh(mesh.vertices_mm, mesh.triangles[:-1]))


def with_nan() -> bytes:
    mesh = box((40.0, 60.0, 60.0), (90.0, 0.0, 100.0), 2)
    vertices = mesh.vertices_mm.copy()
    vertices[3, 1] = np.nan
    with np.errstate(invalid="ignore"):
        return binary_stl(Mesh(vertices, mesh.triangles))


def with_too_many_triangles() -> bytes:
    """As PLY, which says many of them in few bytes; they need not be sound."""
    count = MOST_TRIANGLES + 2
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {count // 2}\n"
        "property float x\nproperty float y\nproperty float z\n"
        f"element face {count}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    random = np.random.default_rng(0)
    places = random.uniform(-50.0, 50.0, (count // 2, 3)).astype("<f4")
    faces = np.zeros(count, [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"] = 3
    faces["corners"] = np.arange(3 * count).reshape(-1, 3) % (count // 2)
    return header.encode() + places.tobytes() + faces.tobytes()


CHEST = binary_stl(chest(1000, seed=0))
FREE = {"free": "outside"}
REFUSED: dict[str, tuple[str, str, bytes, str, dict[str, Any]]] = {
    "NaN": ("not_finite", "new.stl: triangle", with_nan(), "new.stl", FREE),
    "open": ("not_closed", "new.stl: not watertight", open_box(), "new.stl", FREE),
    "cut off": ("cut_off", "new.stl: is cut off", CHEST[:-1000], "new.stl", FREE),
    "no mesh": ("bad_mesh", "new.obj", b"hello", "new.obj", FREE),
    "sealed port": ("sealed_port", "there is no port", CHEST, "new.stl", {"free": "inside"}),
    "port elsewhere": (
        "sealed_port",
        "outside the port",
        CHEST,
        "new.stl",
        {"free": "inside", "port": PORT | {"centre_mm": [60.0, 0.0, 0.0]}},
    ),
    "a region of no size": (
        "bad_surroundings",
        "radius_mm",
        CHEST,
        "new.stl",
        {"free": "inside", "port": PORT, "regions": [FAR_BALL | {"radius_mm": 0.0}]},
    ),
    "an unknown region": (
        "bad_surroundings",
        "cone",
        CHEST,
        "new.stl",
        {"free": "inside", "port": PORT, "regions": [FAR_BALL | {"kind": "cone"}]},
    ),
}


def test_what_cannot_be_used_is_refused_by_name_and_the_old_ones_stay(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        before, shafts, asked = source_of(rig).files, rig.shafts(), source_of(rig)._risk
        for case, (name, told, content, called, more) in REFUSED.items():
            reference = await upload(rig, content, called)
            refused = await rig.refused(Surround, surface={"mesh": reference, **more})
            assert refused.name == name, case
            assert told in refused.text, case
            assert "tentacled-uploads" not in refused.text, "where we keep it is nobody's business"
            assert source_of(rig).files is before and source_of(rig)._risk is asked, case
            assert rig.state is OperatingState.ARMED
            assert rig.shafts() == pytest.approx(shafts, abs=2.0)

    rig = play(scene, file)
    assert len([told for told in rig.told if isinstance(told, SurroundingsChanged)]) == 1


def test_too_many_triangles_are_refused_before_anything_is_made_of_them(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        reference = await upload(rig, with_too_many_triangles(), "new.ply")
        refused = await rig.refused(Surround, surface={"mesh": reference, **FREE})
        assert refused.name == "too_many_triangles"
        assert f"are more than {MOST_TRIANGLES}" in refused.text
        size = 84 + 50 * 1_000_000
        await rig.refused(
            Upload, name="a.stl", sha256="0" * 64, size_bytes=size, offset=0, data=b"x"
        )

    play(scene, file)


MEANT_BY_NOBODY: list[tuple[dict[str, Any] | None, bool, str]] = [
    ({"mesh": "upload:" + "0" * 64}, False, "no_such_upload"),
    ({"mesh": "builtin:nowhere.stl"}, False, "bad_surroundings"),
    ({"mesh": "builtin:../robots/soft_arm.yaml"}, False, "bad_surroundings"),
    ({"mesh": "/etc/passwd"}, False, "bad_surroundings"),
    ({"mesh": 5}, False, "bad_surroundings"),
    ({"regions": []}, False, "bad_surroundings"),
    ({"mesh": "builtin:chest.stl"}, True, "bad_surroundings"),
    ({"regions": [FAR_BALL] * 65}, True, "bad_surroundings"),
    (None, True, "bad_surroundings"),
]


def test_what_nobody_can_mean_is_refused(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        for surface, add, name in MEANT_BY_NOBODY:
            refused = await rig.refused(Surround, surface=surface, add=add)
            assert refused.name == name, surface

    play(scene, file)


def test_while_it_moves_nothing_is_exchanged(file: RobotFile) -> None:
    async def scene(rig: Rig) -> None:
        await rig.running(SMALL_CIRCLE | {"radius_mm": 5.0}, BROYDEN)
        before = source_of(rig).files
        refused = await rig.refused(Surround, surface={"regions": [FAR_BALL]}, add=True)
        assert (refused.name, refused.text) == (
            "wrong_state",
            "the robot is moving: hold or stop it first",
        )
        assert source_of(rig).files is before
        verbs = {verb.name: verb for verb in rig.status.verbs}
        assert not verbs["surround"].possible
        await rig.do(Hold)
        await rig.do(Surround, surface={"regions": [FAR_BALL]}, add=True)
        await rig.do(Resume)
        assert rig.state is OperatingState.RUNNING

    play(scene, file)


def test_what_was_started_or_lost_while_others_were_prepared_ends_it(file: RobotFile) -> None:
    """Preparing takes seconds: whether it may still be is looked at again at its end."""

    async def scene(rig: Rig) -> None:
        await rig.armed()
        circle = SMALL_CIRCLE | {"radius_mm": 5.0}
        await rig.do(Load, trajectory=circle, controller=BROYDEN)
        surrounding, waiting = rig.operator.surrounding, asyncio.Event()
        at_once = surrounding._prepare

        async def slowly(*arguments: Any) -> Any:
            await waiting.wait()
            return await at_once(*arguments)

        surrounding._prepare = slowly
        before = source_of(rig).files

        async def meanwhile(what: Any) -> Answer | Refusal:
            waiting.clear()
            asked = asyncio.create_task(
                rig.ask(Surround(token=rig.token, surface={"regions": [FAR_BALL]}, add=True))
            )
            await asyncio.sleep(0.1)
            second = await rig.refused(Surround, surface={"regions": [FAR_BALL]}, add=True)
            assert second.name == "busy"
            await what
            waiting.set()
            return await asked

        moving = await meanwhile(rig.do(Start))
        assert isinstance(moving, Refusal) and moving.name == "wrong_state"
        await rig.do(Stop)
        await rig.until_state(OperatingState.READY)
        held = rig.token
        rig.renewing = False
        lost = await meanwhile(asyncio.sleep(5.0))
        assert isinstance(lost, Refusal) and lost.name == "no_lease", held
        assert source_of(rig).files is before

    play(scene, file)


def test_a_robot_without_a_model_has_no_surroundings_to_replace() -> None:
    async def scene(rig: Rig) -> None:
        await rig.armed()
        assert (await rig.refused(Surround)).name == "no_model"

    on_a_rig(scene)
