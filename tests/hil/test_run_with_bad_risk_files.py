"""`tentacled run` as a process, with files that tell nothing of this robot: it does not start."""

from collections.abc import Callable
from pathlib import Path
from shutil import copy

import pytest
import yaml

from tests import SOFT_ARM
from tests.hil.processes import run

CONFIG = SOFT_ARM.parents[1]


def removed(folder: Path) -> None:
    (folder / "model.npz").unlink()


def corrupted(folder: Path) -> None:
    whole = bytearray((folder / "model.npz").read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    (folder / "model.npz").write_bytes(whole)


def of_another_robot(folder: Path) -> None:
    copy(CONFIG / "models" / "soft_arm.npz", folder / "model.npz")


def no_mesh(folder: Path) -> None:
    (folder / "chest.stl").write_text("solid nothing\n")


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (corrupted, "model.npz"),
        pytest.param(removed, "there is no file", marks=pytest.mark.long),
        pytest.param(of_another_robot, "is of the robot 'soft_arm'", marks=pytest.mark.long),
        pytest.param(no_mesh, "chest.stl", marks=pytest.mark.long),
    ],
)
def test_it_says_which_file_and_ends(
    spoil: Callable[[Path], None], told: str, tmp_path: Path
) -> None:
    robot = yaml.safe_load((CONFIG / "robots" / "tendon_arm.yaml").read_text())
    robot["risk"] |= {"model": "model.npz"}
    robot["risk"]["surface"] |= {"mesh": "chest.stl"}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    copy(CONFIG / "models" / "tendon_arm.npz", tmp_path / "model.npz")
    copy(CONFIG / "surfaces" / "chest.stl", tmp_path / "chest.stl")
    spoil(tmp_path)
    where = ["--runtime-dir", str(tmp_path / "run"), "--runs", str(tmp_path / "runs")]
    ended = run("run", str(tmp_path / "robot.yaml"), *where, "--no-real-time")
    assert ended.returncode == 78
    assert told in ended.stderr + ended.stdout
