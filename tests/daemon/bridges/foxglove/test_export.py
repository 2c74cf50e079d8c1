"""`tentacled export --foxglove`: read back by Foxglove's own MCAP and protobuf readers."""

import asyncio
import json
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from msgspec.structs import replace

from daemon.commands.outcome.exit_codes import EXIT_DATA
from daemon.commands.terminal.command_line import main
from daemon.messages import Body, Component, Message, Risk, Status, SurroundingsChanged
from daemon.recording.run_folder import RUN_FILE, SURROUNDINGS_FILE
from tests.daemon.bridges.telling import status, tip
from tests.daemon.recording.synthetic_run import BOOT_NS, WALL_NS, direct_run, event

foxglove = pytest.importorskip("foxglove", reason="pip install '.[bridges]'")
protobuf = pytest.importorskip("mcap_protobuf.decoder", reason="pip install '.[test]'")

STL = (
    bytes(80)
    + (1).to_bytes(4, "little")
    + np.array([0, 0, 1, 0, 0, 0, 10, 0, 0, 0, 20, 0], "<f4").tobytes()
    + bytes(2)
)
AWAY = Risk(
    sequence=0, t_ns=BOOT_NS + 30_000_000, source="model", threshold=0.05, scale=1.0, reasons=[],
    place_mm=[1.0, 2.0, 3.0], obstacle_mm=[4.0, 5.0, 6.0],
)  # fmt: skip
REGIONS: tuple[dict[str, Any], ...] = (
    {"kind": "ball", "centre_mm": [0, 0, 50], "radius_mm": 5},
    {"kind": "box", "centre_mm": [0, 0, 9], "size_mm": [10, 20, 30], "turned": [0, 0, 0, 1]},
    {"kind": "capsule", "from_mm": [0, 0, 0], "to_mm": [30, 0, 0], "radius_mm": 2},
    {"kind": "cylinder", "keep": "in", "from_mm": [0, 0, 0], "to_mm": [0, 9, 0], "radius_mm": 2},
    {"kind": "half_space", "point_mm": [0, 20, 0], "normal": [0, -7, 0]},
)
BODY = Body(
    t_ns=BOOT_NS + 40_000_000,
    source="model",
    centreline_mm=[[0.0, 0.0, 0.0], [0.0, 0.0, 100.0], [10.0, 0.0, 190.0]],
    radius_mm=[6.0, 5.0, 4.0],
    components=[
        Component(
            weight=0.5, mean_mm=[1.0, 2.0, 3.0], covariance_mm2=[4.0, 0.0, 0.0, 1.0, 0.0, 9.0]
        )
    ],
)


def test_a_recording_without_a_message_is_not_exported(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty, out = tmp_path / "cut.mcap", tmp_path / "out.mcap"
    empty.touch()
    assert main(["export", str(empty), "--foxglove", str(out)]) == EXIT_DATA
    assert "cut.mcap: there is no message in it" in capsys.readouterr().err
    assert not out.exists()


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    telemetry: list[Message] = [
        tip(sequence=step, t_ns=BOOT_NS + step * 25_000_000, tip_mm=[float(step), 0.0, 190.0])
        for step in range(40)
    ]
    telemetry += [AWAY, BODY, event(1, BOOT_NS + 1_000_000_000, "running", "hold")]
    asyncio.run(direct_run(folder, telemetry))
    (folder / SURROUNDINGS_FILE).write_bytes(STL)
    out = folder / "out" / "drawn.mcap"
    assert main(["export", str(folder), "--foxglove", str(out)]) == 0
    assert [path.name for path in out.parent.iterdir()] == ["drawn.mcap"]
    return out


@pytest.fixture(scope="module")
def decoded(exported: Path) -> dict[str, list[tuple[int, Any]]]:
    return decoded_of(exported)


def decoded_of(exported: Path) -> dict[str, list[tuple[int, Any]]]:
    """Date and message, by topic."""
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with exported.open("rb") as file:
        reader = make_reader(
            file, validate_crcs=True, decoder_factories=[protobuf.DecoderFactory()]
        )
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.message_encoding == "protobuf":
                decode = protobuf.DecoderFactory().decoder_for("protobuf", schema)
                assert decode is not None
                found[channel.topic].append((message.log_time, decode(message.data)))
            else:
                found[channel.topic].append((message.log_time, message.data))
    return found


def entities(decoded: dict[str, list[tuple[int, Any]]], name: str) -> Iterator[Any]:
    for _, update in decoded["/scene"]:
        yield from (one for one in update.entities if one.id == name)


def test_every_channel_has_the_schema_that_viewers_know_it_by(exported: Path) -> None:
    with exported.open("rb") as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        known = {c.topic: summary.schemas[c.schema_id] for c in summary.channels.values()}
    for topic, name in (
        ("/tf", "foxglove.FrameTransform"),
        ("/scene", "foxglove.SceneUpdate"),
        ("/surroundings", "foxglove.SceneUpdate"),
        ("/log", "foxglove.Log"),
        ("/tip", "tentacled.tip/1"),
    ):
        assert known[topic].name == name
    assert known["/scene"].data == foxglove.messages.SceneUpdate.get_schema().data


def test_the_tip_is_a_frame_at_its_time_in_metres(
    decoded: dict[str, list[tuple[int, Any]]],
) -> None:
    tips = [(at, frame) for at, frame in decoded["/tf"] if frame.child_frame_id == "tip"]
    assert len(tips) == 40
    at, last = tips[-1]
    assert at == WALL_NS + 39 * 25_000_000 == last.timestamp.ToNanoseconds()
    assert last.parent_frame_id == "base"
    assert (last.translation.x, last.translation.z) == pytest.approx((0.039, 0.19))
    assert last.rotation.w == 1.0
    assert sum(frame.child_frame_id == "reference" for _, frame in decoded["/tf"]) == 40


def test_body_ellipsoids_clearance_and_trails_are_drawn(
    decoded: dict[str, list[tuple[int, Any]]],
) -> None:
    (body,) = entities(decoded, "body")
    (line,) = body.lines
    assert line.thickness == pytest.approx(0.01) and len(line.points) == 3
    assert line.points[2].x == pytest.approx(0.01)
    (sphere,) = body.spheres
    sizes = sorted((sphere.size.x, sphere.size.y, sphere.size.z))
    assert sizes == pytest.approx([0.004, 0.008, 0.012])
    (clearance,) = entities(decoded, "clearance")
    assert clearance.lines[0].points[1].z == pytest.approx(0.006)
    trails = list(entities(decoded, "tip trail"))
    assert len(trails) == 9 and len(trails[-1].lines[0].points) == 10


def test_surroundings_are_there_once_from_the_beginning(
    decoded: dict[str, list[tuple[int, Any]]],
) -> None:
    ((at, update),) = decoded["/surroundings"]
    assert at == WALL_NS
    (points,) = [one.points for one in update.entities[0].triangles]
    assert [(p.x, p.y) for p in points] == pytest.approx([(0.0, 0.0), (0.01, 0.0), (0.0, 0.02)])


def changed(after_ns: int, file: str, *regions: dict[str, Any]) -> SurroundingsChanged:
    return SurroundingsChanged(
        t_ns=BOOT_NS + after_ns,
        sha256="",
        mesh="",
        triangles=1,
        surface=json.dumps({"regions": regions}),
        file=file,
    )


def test_regions_are_drawn_until_others_take_their_place(tmp_path: Path) -> None:
    telemetry: list[Message] = [
        changed(0, "", {"kind": "ball", "centre_mm": [0, 0, 50], "radius_mm": 5}),
        changed(100, "", *REGIONS),
        changed(200, ""),
    ]
    asyncio.run(direct_run(tmp_path, telemetry))
    out = tmp_path / "out" / "drawn.mcap"
    assert main(["export", str(tmp_path), "--foxglove", str(out)]) == 0
    first, second, third = (update for _, update in decoded_of(out)["/surroundings"])
    assert len(first.entities[0].spheres) == 1 and third.deletions[0].id == "regions"
    (drawn,) = second.entities
    assert [len(kind) for kind in (drawn.spheres, drawn.cubes, drawn.cylinders)] == [3, 2, 2]
    ball, *caps = drawn.spheres
    assert (ball.pose.position.z, ball.size.x) == pytest.approx((0.05, 0.01))
    assert [cap.pose.position.x for cap in caps] == pytest.approx([0.0, 0.03])
    rod, tin = drawn.cylinders
    assert (rod.size.x, rod.size.z, rod.top_scale, rod.bottom_scale) == pytest.approx(
        (0.004, 0.03, 1.0, 1.0)
    )
    assert rod.pose.position.x == pytest.approx(0.015)
    turn = rod.pose.orientation
    assert (turn.w, turn.y) == pytest.approx((0.5**0.5, 0.5**0.5)), "z is turned onto x"
    assert (tin.color.g, tin.color.r) == (0.65, 0.15), "to stay in"
    box, plane = drawn.cubes
    assert (box.size.x, box.size.y, box.pose.orientation.z) == pytest.approx((0.01, 0.02, 1.0))
    assert (plane.pose.position.y, plane.size.z) == pytest.approx((0.02, 0.0002))


def test_obstacles_that_move_are_drawn_where_they_are_and_go_again(tmp_path: Path) -> None:
    def at(number: int, *moving_mm: list[float]) -> Status:
        told = status(t_ns=BOOT_NS + number)
        return replace(told, risk=replace(told.risk, moving_mm=list(moving_mm)))

    telemetry: list[Message] = [at(0), at(1, [60, 0, 65, -30, 0, 0, 6]), at(2), at(3)]
    asyncio.run(direct_run(tmp_path, telemetry))
    out = tmp_path / "out" / "drawn.mcap"
    assert main(["export", str(tmp_path), "--foxglove", str(out)]) == 0
    there, gone = (update for _, update in decoded_of(out)["/scene"])
    (moves,) = there.entities
    assert [one.pose.position.x for one in moves.spheres] == pytest.approx([0.06, 0.03])
    assert moves.id == gone.deletions[0].id == "moving obstacles"
    assert gone.deletions[0].timestamp.ToNanoseconds() == WALL_NS + 2


def test_the_clearance_of_a_robot_that_makes_no_steps_any_more_is_not_left_drawn(
    tmp_path: Path,
) -> None:
    after_ns = (100_000_000, 900_000_000, 1_200_000_000, 1_400_000_000)
    later = [status(t_ns=AWAY.t_ns + each_ns) for each_ns in after_ns]
    asyncio.run(direct_run(tmp_path, [AWAY, *later]))
    out = tmp_path / "out" / "drawn.mcap"
    assert main(["export", str(tmp_path), "--foxglove", str(out)]) == 0
    (_, there), (at, gone) = decoded_of(out)["/scene"]
    assert there.entities[0].id == gone.deletions[0].id == "clearance"
    assert at == WALL_NS + AWAY.t_ns - BOOT_NS + 1_200_000_000


def test_surroundings_are_others_from_when_others_take_their_place(tmp_path: Path) -> None:
    files = (SURROUNDINGS_FILE, "surroundings-2.stl", "../secret.stl", SURROUNDINGS_FILE)
    folder = tmp_path / "run"
    folder.mkdir()
    telemetry: list[Message] = [changed(100 * number, one) for number, one in enumerate(files)]
    asyncio.run(direct_run(folder, telemetry))
    (folder / SURROUNDINGS_FILE).write_bytes(STL)
    (folder / "surroundings-2.stl").write_bytes(STL[:108] + STL[96:108] + STL[120:])
    (tmp_path / "secret.stl").write_bytes(STL)
    out = tmp_path / "drawn.mcap"
    assert main(["export", str(folder), "--foxglove", str(out)]) == 0
    told = decoded_of(out)["/surroundings"]
    assert [at - WALL_NS for at, _ in told] == [0, 100, 200, 300]
    shown = [len(update.entities[0].triangles[0].points) for _, update in told if update.entities]
    assert shown == [3, 3, 3] and [len(update.deletions) for _, update in told] == [0, 0, 1, 0]
    second = told[1][1].entities[0].triangles[0].points[1]
    assert (second.x, second.y) == pytest.approx((0.0, 0.0))


def test_events_are_a_log_and_telemetry_is_as_it_was_recorded(
    decoded: dict[str, list[tuple[int, Any]]],
) -> None:
    ((_, line),) = decoded["/log"]
    assert line.message == "robot: the tracker has lost the tip" and line.name == "state/hold"
    assert line.level == foxglove.messages.LogLevel.Error.value
    assert b'"tip_mm":[39.0,0.0,190.0]' in decoded["/tip"][-1][1]


def test_a_run_is_never_written_over(exported: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = exported.parents[1]
    before = (run / RUN_FILE).read_bytes()
    for out in (run / RUN_FILE, run / "run-0002.mcap"):
        assert main(["export", str(run), "--foxglove", str(out)]) == 64
    assert main(["export", str(run / RUN_FILE), "--foxglove", str(run / RUN_FILE)]) == 64
    assert (run / RUN_FILE).read_bytes() == before
    assert "recording" in capsys.readouterr().err


def test_what_is_no_run_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.mcap"
    assert main(["export", str(tmp_path / "nothing"), "--foxglove", str(out)]) == 66
    assert "no such file" in capsys.readouterr().err and not list(tmp_path.iterdir())
