"""A run's folder is new, named for robot and date, and holds what is needed to repeat the run."""

import hashlib
import json
from pathlib import Path

from config.loader import load_robot
from daemon.recording.result import Result, read_result, write_result
from daemon.recording.run_folder import (
    SURROUNDINGS_FILE,
    describe_run,
    new_run,
    robot_yaml,
    utc_text,
)
from tests import SOFT_ARM
from tests.daemon.recording.synthetic_run import WALL_NS


def test_folders_are_named_for_robot_and_date_and_never_shared(tmp_path: Path) -> None:
    made = [new_run(tmp_path / "runs", "soft_arm", WALL_NS + 999_999_999) for _ in range(3)]
    name = "soft_arm-2020-01-01T00-00-00Z"
    assert [folder.name for folder in made] == [name, f"{name}-2", f"{name}-3"]
    assert all(folder.is_dir() for folder in made)


def test_dates_are_utc() -> None:
    assert utc_text(0) == "1970-01-01T00:00:00Z"
    assert utc_text(1_709_210_096_500_000_000) == "2024-02-29T12:34:56Z"


def test_the_robot_file_of_a_run_gives_the_same_robot(tmp_path: Path) -> None:
    original = load_robot(SOFT_ARM)
    path = tmp_path / "robot.yaml"
    path.write_text(robot_yaml(original.robot, SOFT_ARM))
    assert load_robot(path).robot == original.robot


def test_files_beside_the_robot_file_are_found_from_the_run(tmp_path: Path) -> None:
    source, run = tmp_path / "source", tmp_path / "run"
    source.mkdir()
    run.mkdir()
    eds = SOFT_ARM.parents[1] / "eds" / "stepper.eds"
    (source / "own.eds").write_bytes(eds.read_bytes())
    text = SOFT_ARM.read_text().replace("builtin:stepper.eds", "own.eds")
    (source / "robot.yaml").write_text(text)
    robot = load_robot(source / "robot.yaml").robot
    (run / "robot.yaml").write_text(robot_yaml(robot, source / "robot.yaml"))
    drive = load_robot(run / "robot.yaml").robot.axes[0].drive
    assert Path(drive.eds) == source / "own.eds"


def test_all_that_a_robot_file_names_is_found_from_the_run(tmp_path: Path) -> None:
    source, run = tmp_path / "source", tmp_path / "run"
    (source / "certificates").mkdir(parents=True)
    run.mkdir()
    shipped = SOFT_ARM.parents[1]
    (source / "body.npz").write_bytes((shipped / "models" / "tendon_arm.npz").read_bytes())
    (source / "room.stl").write_bytes((shipped / "surfaces" / "chest.stl").read_bytes())
    text = (SOFT_ARM.parent / "tendon_arm.yaml").read_text()
    text = text.replace("builtin:tendon_arm.npz", "body.npz").replace(
        "builtin:chest.stl", "room.stl"
    )
    text += "remote:\n  tls: {endpoint: '127.0.0.1:7448', certificates: certificates}\n"
    text += "  users: {anna: operator}\n"
    (source / "robot.yaml").write_text(text)
    robot = load_robot(source / "robot.yaml").robot
    (run / "robot.yaml").write_text(robot_yaml(robot, source / "robot.yaml"))
    again = load_robot(run / "robot.yaml").robot
    assert again.risk.model == str(source / "body.npz")
    assert again.risk.surface is not None
    assert again.risk.surface.mesh == str(source / "room.stl")
    assert again.remote.tls is not None
    assert again.remote.tls.certificates == str(source / "certificates")
    assert again.axes[0].drive.eds == "builtin:stepper.eds", "it is wherever we are"


def test_the_provenance_names_code_and_inputs(tmp_path: Path) -> None:
    model = tmp_path / "risk.npz"
    model.write_bytes(b"weights")
    robot = load_robot(SOFT_ARM).robot
    describe_run(tmp_path, robot, SOFT_ARM, WALL_NS, seed=7, models={"risk": model})
    told = json.loads((tmp_path / "provenance.json").read_text())
    assert told["started"] == "2020-01-01T00:00:00Z"
    assert told["seed"] == 7
    assert told["models_sha256"] == {"risk": hashlib.sha256(b"weights").hexdigest()}
    config = (tmp_path / "robot.yaml").read_bytes()
    assert told["config_sha256"] == hashlib.sha256(config).hexdigest()
    assert told["packages"]["numpy"]
    assert told["commit"] is None or len(told["commit"]) == 40


def test_a_result_comes_back(tmp_path: Path) -> None:
    assert read_result(tmp_path) is None
    result = Result(
        robot="soft_arm",
        simulated=True,
        trajectory="circle",
        controller="online",
        seed=None,
        duration_s=60.0,
        cycles=[],
        steps=2400,
        holds=1,
        refusals=0,
    )
    write_result(tmp_path, result)
    assert read_result(tmp_path) == result
    (tmp_path / "result.json").write_text("{")
    assert read_result(tmp_path) is None


def test_what_was_round_the_body_is_kept_where_it_is_known(tmp_path: Path) -> None:
    robot = load_robot(SOFT_ARM).robot
    for name, stl in (("nobody knows", b""), ("known", b"solid")):
        (tmp_path / name).mkdir()
        describe_run(tmp_path / name, robot, SOFT_ARM, WALL_NS, surroundings=stl)
    assert not (tmp_path / "nobody knows" / SURROUNDINGS_FILE).exists()
    assert (tmp_path / "known" / SURROUNDINGS_FILE).read_bytes() == b"solid"
