"""What a `load` may name and how it is read: data, or files of one folder, never on the loop."""

import asyncio
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from config.loader import load_robot
from daemon.control.reachability import Bounds
from daemon.host.clock import run_in_real_time
from daemon.messages import Load
from daemon.reference.trajectories import Trajectory
from daemon.service.motion_loader import CommandRefusedError, MotionLoader, in_a_thread
from tests import SOFT_ARM

ROBOT = load_robot(SOFT_ARM).robot
WAY = "t, x, y, z\n0, 0, 0, 185\n5, 10, 0, 185\n"
SECRET = "root:x:0:0:root:/root:/bin/bash\n"


def asked(load: Load, folder: Path | None = None) -> Trajectory:
    async def test() -> Trajectory:
        return (await MotionLoader(ROBOT, 1, folder, in_a_thread).to_follow(load))[0]

    return run_in_real_time(test())


def refused(load: Load, folder: Path | None = None) -> CommandRefusedError:
    with pytest.raises(CommandRefusedError) as caught:
        asked(load, folder)
    return caught.value


def waypoints(name: str) -> Load:
    return Load(trajectory={"kind": "waypoints", "file": name})


def test_a_file_of_the_folder_can_be_named_by_its_name_or_its_path(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text(WAY)
    for name in ("way.csv", str(tmp_path / "way.csv"), "./../" + tmp_path.name + "/way.csv"):
        assert asked(waypoints(name), tmp_path).duration_s == 5.0


def test_points_can_be_sent_as_data() -> None:
    rows = [[0.0, 0.0, 0.0, 185.0], [5.0, 10.0, 0.0, 185.0]]
    load = Load(trajectory={"kind": "waypoints", "points": rows})
    assert asked(load).duration_s == 5.0
    bad = Load(trajectory={"kind": "waypoints", "points": [*rows, [4.0, 0.0, 0.0, 0.0]]})
    assert refused(bad).text == "points:3: t is not after the one before"


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../way.csv", "/", "", ".", "link.csv", "a\0b", "/nowhere/at/all"]
)
def test_what_is_elsewhere_is_refused_alike_whether_it_is_there_or_not(
    tmp_path: Path, name: str
) -> None:
    folder = tmp_path / "files"
    folder.mkdir()
    (tmp_path / "way.csv").write_text(WAY)
    (folder / "link.csv").symlink_to(tmp_path / "way.csv")
    for key, load in (
        ("bad_trajectory", waypoints(name)),
        ("bad_controller", Load(trajectory=CIRCLE, controller={**LEARNER, "model": name})),
    ):
        error = refused(load, folder)
        assert error.name == key
        assert "only files in" in error.text or "at least 1 character" in error.text or not name
        assert refused(load, None).name == key


@pytest.mark.parametrize("text", [SECRET, f"t, x, y, z\n{SECRET}", "t, x, y, z\n1, s3cret, 2, 3\n"])
def test_what_is_in_a_file_is_never_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "file").write_text(text)
    told = refused(waypoints("file"), tmp_path).text
    for word in ("root", "bash", "s3cret"):
        assert word not in told.replace(str(tmp_path), "")


@pytest.mark.parametrize("kind", ["waypoints", "model"])
def test_a_pipe_a_folder_or_a_device_is_not_waited_for(tmp_path: Path, kind: str) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for name in ("pipe", "folder"):
        if kind == "waypoints":
            load = waypoints(name)
        else:
            load = Load(trajectory=CIRCLE, controller={**LEARNER, "model": name})
        error = refused(load, tmp_path)
        assert "regular" in error.text or "directory" in error.text


def test_a_file_that_is_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "large").open("wb") as file:
        file.truncate(1 << 40)
    assert "bytes" in refused(waypoints("large"), tmp_path).text


def test_what_is_meant_for_another_robot_is_refused() -> None:
    assert asked(Load(trajectory=CIRCLE, robot="soft_arm")).kind == "circle"
    error = refused(Load(trajectory=CIRCLE, robot="tendon_arm"))
    assert error.name == "wrong_robot"
    assert "tendon_arm" in error.text


def test_files_are_read_in_another_thread_and_the_loop_goes_on(tmp_path: Path) -> None:
    lines = [f"{number}, 0, 0, {185 + number % 7}" for number in range(19_990)]
    (tmp_path / "way.csv").write_text("\n".join(["t, x, y, z", *lines]))
    turns = 0

    async def test() -> None:
        nonlocal turns
        loading = asyncio.ensure_future(
            MotionLoader(ROBOT, 1, tmp_path, in_a_thread).to_follow(waypoints("way.csv"))
        )
        while not loading.done():
            await asyncio.sleep(0.001)
            turns += 1
        assert (await loading)[0].duration_s == 19_989.0

    run_in_real_time(test())
    assert turns > 3  # read on the loop, it would have been one or two


def test_one_thing_is_loaded_at_a_time_and_what_never_ends_is_left_behind() -> None:
    never = threading.Event()

    async def for_ever(work: Callable[[], Any]) -> Any:
        del work
        return await in_a_thread(never.wait, 0.2)

    async def test() -> None:
        one = MotionLoader(ROBOT, 1, None, for_ever)
        first = asyncio.ensure_future(one.to_follow(Load(trajectory=CIRCLE)))
        await asyncio.sleep(0.01)
        with pytest.raises(CommandRefusedError) as second:
            await one.to_follow(Load(trajectory=CIRCLE))
        assert second.value.name == "busy"
        with pytest.raises(CommandRefusedError) as slow:
            await first
        assert slow.value.name == "too_slow"

    run_in_real_time(test())
    never.set()


CIRCLE: dict[str, Any] = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 10.0,
    "cycle_s": 20.0,
}
LEARNER: dict[str, Any] = {"kind": "reward_weighted"}


def test_what_is_loaded_is_held_against_whether_its_controller_points() -> None:
    async def test(kind: str) -> Bounds:
        load = Load(trajectory=CIRCLE, controller={"kind": kind})
        return (await MotionLoader(ROBOT, 1, None, in_a_thread).to_follow(load))[2]

    for kind in ("pid_constant_curvature", "constant_curvature"):
        assert run_in_real_time(test(kind)).position_only == kind
    assert run_in_real_time(test("broyden")).position_only == ""


def test_a_load_that_means_to_end_the_process_is_answered_with_what_it_did() -> None:
    def leave() -> None:
        raise SystemExit(3)

    async def test() -> None:
        with pytest.raises(RuntimeError, match="SystemExit: 3"):
            await in_a_thread(leave)

    run_in_real_time(test())
