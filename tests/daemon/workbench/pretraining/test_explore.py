"""An emulated arm explored in virtual time: what is seen, and what is made of it."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from config.loader import RobotFile, load_robot
from config.tasks.experiment import Pretraining
from config.tasks.exploration import DesignedExploration, WaypointExploration
from daemon.commands.outcome.exit_codes import (
    EXIT_DATA,
    EXIT_NO_INPUT,
    EXIT_OK,
    EXIT_USAGE,
)
from daemon.commands.terminal.command_line import main
from daemon.files import models_directory
from daemon.learning.forward.forward_fit import ForwardFit
from daemon.learning.forward.pretrained_model import PretrainedModel
from daemon.learning.samples.dataset import Dataset, DatasetError
from daemon.learning.samples.motion_samples import SamplingSettings
from daemon.workbench.experiments.experiment_file import other_plant
from daemon.workbench.pretraining import model_cache
from daemon.workbench.pretraining.explore import (
    config_sha256,
    dataset_of_run,
    explore,
    frames_of_run,
)
from daemon.workbench.pretraining.model_cache import pretrained
from daemon.workbench.pretraining.parts import ExplorationParts
from tests import SHIPPED_ROBOTS

pytestmark = pytest.mark.xdist_group("explore")  # whose arm is explored once for all tests

PATH = Path(__file__).parents[4] / "config" / "robots" / "soft_arm.yaml"
FILE: RobotFile = load_robot(PATH)
OPTIONS = WaypointExploration(kind="waypoint_exploration", waypoints=5)
FEW = Pretraining(waypoints=2)


def quiet(_: str) -> None:
    """What is told is of no interest."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("exploration")


@pytest.fixture(scope="module")
def dataset(run: Path) -> Iterator[Dataset]:
    yield explore(FILE, OPTIONS, 3, run, quiet)


def test_frames_are_what_the_controller_saw(dataset: Dataset) -> None:
    frames = dataset.frames
    assert len(frames) > 400
    assert np.median(np.diff(frames.t_ns)) == pytest.approx(25e6, rel=0.01)
    assert ((frames.u > -0.1) & (frames.u < 50.1)).all()
    assert (np.ptp(frames.tip_mm, axis=0)[:2] > 30.0).all()


def test_each_waypoint_is_a_line(dataset: Dataset) -> None:
    lines, counts = np.unique(dataset.frames.line, return_counts=True)
    assert OPTIONS.waypoints <= len(lines) <= OPTIONS.waypoints + 2
    assert (counts > 20).sum() >= OPTIONS.waypoints - 1


def test_the_tip_of_a_slow_arm_stays_inside_although_it_goes_on_long_after_its_axes_turned(
    tmp_path: Path,
) -> None:
    """Looked ahead as for a prompt one it leaves its workspace on the first line, and is held."""
    emulation = FILE.robot.emulation
    assert emulation is not None and FILE.robot.workspace is not None
    slow = other_plant(emulation.plant, {"body": "slow"})
    robot = FILE.robot.model_copy(
        update={"emulation": emulation.model_copy(update={"plant": slow})}
    )
    options = WaypointExploration(kind="waypoint_exploration", waypoints=6)
    explored = explore(replace(FILE, robot=robot), options, 4, tmp_path, quiet)
    assert len(np.unique(explored.frames.line)) >= options.waypoints
    z_mm = explored.frames.tip_mm[:, 2]
    low, high = FILE.robot.workspace.z_mm
    assert low < z_mm.min() and z_mm.max() < high


def test_an_arm_with_tendons_explores_without_pulling_one_slack(tmp_path: Path) -> None:
    """It goes as far as its tendons let it: their travel is several times of that."""
    arm = load_robot(PATH.with_name("tendon_arm.yaml"))
    run = tmp_path / "run"
    run.mkdir()
    frames = explore(arm, OPTIONS, 1, run, quiet).frames
    assert len(np.unique(frames.line)) >= OPTIONS.waypoints
    assert (np.ptp(frames.u, axis=0) > 1.5).all()


def test_an_arm_whose_tendons_are_strung_loosely_is_seen_as_far_as_others(tmp_path: Path) -> None:
    """They are pulled before they are nearly slack: else each line ends as soon as it begins."""
    arm = load_robot(PATH.with_name("tendon_arm.yaml"))
    emulation = arm.robot.emulation
    assert emulation is not None
    loose = other_plant(emulation.plant, {"pretension_n": 1.25, "friction": 0.3})
    robot = arm.robot.model_copy(
        update={
            "emulation": emulation.model_copy(update={"plant": loose}),
            "risk": arm.robot.risk.model_copy(update={"model": None}),
        }
    )
    options = DesignedExploration(kind="designed_exploration")
    frames = explore(replace(arm, robot=robot), options, 2, tmp_path, quiet).frames
    assert len(np.unique(frames.line)) < 70
    assert (np.ptp(frames.tip_mm[:, :2], axis=0) > 50.0).all()


def test_motions_are_good_to_learn_from(dataset: Dataset) -> None:
    motions = dataset.motions(SamplingSettings())
    assert len(motions) > 100
    lengths = np.linalg.norm(motions.delta_tip_mm, axis=1)
    assert np.median(lengths) == pytest.approx(1.2, abs=0.3)
    directions = motions.delta_u / np.linalg.norm(motions.delta_u, axis=1)[:, None]
    assert np.linalg.svd(directions, compute_uv=False)[-1] > 0.1 * np.sqrt(len(motions))


def test_the_file_says_how_it_was_made(dataset: Dataset, tmp_path: Path) -> None:
    dataset.save(tmp_path / "data.npz")
    told = Dataset.load(tmp_path / "data.npz", FILE.robot).provenance
    assert told["exploration"]["waypoints"] == OPTIONS.waypoints
    assert (told["seed"], told["tip_load_g"], told["real_time"]) == (3, 0.0, False)
    assert told["config_sha256"] == config_sha256(FILE)
    assert told["version"]


def test_the_same_seed_sees_the_same(dataset: Dataset, tmp_path: Path) -> None:
    again = explore(FILE, OPTIONS, 3, tmp_path, quiet)
    assert again.sha256 == dataset.sha256


def test_a_recorded_run_can_be_learnt_from_as_well(dataset: Dataset, run: Path) -> None:
    recorded = dataset_of_run(run, FILE, {"run": "somewhere"})
    assert recorded.sha256 == dataset.sha256
    assert recorded.provenance["run"] == "somewhere"
    assert len(frames_of_run(run / "run.mcap")) == len(dataset.frames)


def test_a_recording_is_cut_into_the_lines_of_its_exploration(dataset: Dataset, run: Path) -> None:
    del dataset  # it has made the recording
    lines = frames_of_run(run / "run.mcap").line
    # Before its first status is recorded, and once it is ready, nobody says which line it is.
    assert OPTIONS.waypoints <= len({*lines.tolist()}) <= OPTIONS.waypoints + 2
    assert (lines[1:] >= lines[:-1]).all()


def test_a_load_moves_the_tip_elsewhere(dataset: Dataset, tmp_path: Path) -> None:
    few = OPTIONS.model_copy(update={"waypoints": 1})
    loaded = explore(FILE, few, 3, tmp_path, quiet, tip_load_g=14.2)
    shared = min(len(loaded.frames.tip_mm), len(dataset.frames.tip_mm))
    aside_mm = np.abs(loaded.frames.tip_mm[:shared] - dataset.frames.tip_mm[:shared])
    assert aside_mm.max() > 0.5


def test_what_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(b"nothing of the kind")
    with pytest.raises(DatasetError, match="is not a recording"):
        frames_of_run(tmp_path)
    with pytest.raises(DatasetError, match="there is no such file or folder"):
        frames_of_run(tmp_path / "not_there")


# Models that are made once.


def test_a_model_is_made_once_and_found_again(tmp_path: Path) -> None:
    told: list[str] = []
    first = pretrained(FILE, FEW, seed=3, tell=told.append, directory=tmp_path)
    assert any("exploring soft_arm" in line for line in told)
    model = PretrainedModel.load(first, FILE.robot)
    assert model.metadata["kept_back"] == 0
    made = first.stat().st_mtime_ns
    told.clear()
    assert pretrained(FILE, FEW, seed=3, tell=told.append, directory=tmp_path) == first
    assert not told
    assert first.stat().st_mtime_ns == made
    assert [path.name for path in tmp_path.iterdir()] == [first.name]

    first.write_bytes(first.read_bytes()[:1000])
    assert pretrained(FILE, FEW, seed=3, tell=told.append, directory=tmp_path) == first
    assert told
    remade = PretrainedModel.load(first, FILE.robot)
    assert remade.metadata == model.metadata


NO_DOUBT = SimpleNamespace(fit=None)


@pytest.mark.parametrize(("r2", "told"), [(-0.2, 1), (0.03, 1), (0.33, 0), (0.9, 0)])
def test_who_is_to_go_by_a_model_that_explains_nothing_is_told(
    r2: float, told: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found or made: samples as poor as the paper's are meant, where they are asked for."""
    fit = ForwardFit(motions=100, kept_back=False, rmse_mm=1.0, spread_mm=1.0, r2=r2, field_r2=None)
    monkeypatch.setattr(model_cache, "_usable", lambda path, file: SimpleNamespace(fit=fit))
    lines: list[str] = []
    pretrained(FILE, FEW, seed=3, tell=lines.append, directory=tmp_path)
    assert len(lines) == told
    assert all("leave `pretraining` out" in line for line in lines)


def test_of_axes_that_turn_round_a_model_has_to_explain_more_before_nobody_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No waypoints help there, and tubes are led astray by half of a model."""
    fit = ForwardFit(
        motions=369, kept_back=False, rmse_mm=0.7, spread_mm=0.9, r2=0.46, field_r2=None
    )
    monkeypatch.setattr(model_cache, "_usable", lambda path, file: SimpleNamespace(fit=fit))
    lines: list[str] = []
    tubes = load_robot(SHIPPED_ROBOTS / "concentric_tubes.yaml")
    pretrained(tubes, FEW, seed=3, tell=lines.append, directory=tmp_path)
    assert [line.split(": ")[-1][: len("leave `pretraining` out")] for line in lines] == [
        "leave `pretraining` out"
    ]


def test_another_robot_body_or_setting_has_another_model(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_cache, "_usable", lambda path, file: NO_DOUBT)
    emulation = FILE.robot.emulation
    assert emulation is not None
    stiff = emulation.plant.model_copy(update={"bending_stiffness_n_mm2": 9e3})
    other_body = FILE.robot.model_copy(
        update={"emulation": emulation.model_copy(update={"plant": stiff})}
    )
    paths = [
        pretrained(FILE, directory=tmp_path),
        pretrained(FILE, Pretraining(waypoints=320), directory=tmp_path),
        pretrained(FILE, Pretraining(waypoints=320, dither_share=0.0), directory=tmp_path),
        pretrained(FILE, Pretraining(waypoints=320, home_every=0), directory=tmp_path),
        pretrained(FILE, Pretraining(sample_tip_mm=0.6), directory=tmp_path),
        pretrained(FILE, Pretraining(lag_s=0.0), directory=tmp_path),
        pretrained(FILE, seed=2, directory=tmp_path),
        pretrained(replace(FILE, robot=other_body), directory=tmp_path),
    ]
    assert len(set(paths)) == len(paths)
    assert pretrained(FILE, directory=tmp_path) == paths[0]


def test_models_are_kept_where_data_of_users_are(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", "/somewhere")
    assert models_directory() == Path("/somewhere/tentacled/models")
    monkeypatch.delenv("XDG_DATA_HOME")
    assert models_directory() == Path.home() / ".local" / "share" / "tentacled" / "models"


# The commands.


def test_explore_and_pretrain_on_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, model, kept = tmp_path / "data.npz", tmp_path / "model.npz", tmp_path / "run"
    words = ["explore", str(PATH), "--out", str(data), "--waypoints", "6", "--run", str(kept)]
    assert main(words) == EXIT_OK
    assert "s of motion" in capsys.readouterr().out
    assert (kept / "run.mcap").is_file()
    assert main(words) == EXIT_DATA
    assert "is there already" in capsys.readouterr().err

    words = ["pretrain", str(PATH), str(data), "--out", str(model), "--epochs", "2"]
    assert main([*words, "--fields", "4"]) == EXIT_OK
    shown = " ".join(capsys.readouterr().out.split())
    assert "4 receptive fields" in shown
    assert "kept back" in shown
    for name in ("model.epochs.png", "model.regression.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")
    assert PretrainedModel.load(model, FILE.robot).lwpr.count == 4

    assert main([*words, "--json", "--no-figures"]) == EXIT_OK
    told = json.loads(capsys.readouterr().out)["result"]
    assert [errors["epoch"] for errors in told["errors"]] == [1, 2]

    words = ["explore", str(PATH), "--out", str(tmp_path / "again.npz"), "--from", str(kept)]
    assert main(words) == EXIT_OK
    assert Dataset.load(tmp_path / "again.npz", FILE.robot).sha256 == (
        Dataset.load(data, FILE.robot).sha256
    )


def test_seconds_of_designed_motions_are_what_is_explored_by_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, model = tmp_path / "data.npz", tmp_path / "model.npz"
    assert main(["explore", str(PATH), "--out", str(data)]) == EXIT_OK
    dataset = Dataset.load(data, FILE.robot)
    assert dataset.provenance["exploration"]["kind"] == "designed_exploration"
    assert dataset.frames.duration_s == pytest.approx(16.0, abs=0.5)
    assert main(["pretrain", str(PATH), str(data), "--out", str(model), "--no-figures"]) == EXIT_OK
    learnt = PretrainedModel.load(model, FILE.robot)
    assert learnt.sampling.lag_s == pytest.approx(0.1, abs=0.04)
    capsys.readouterr()


def test_designed_motions_that_are_interrupted_go_on_with_the_seconds_that_are_missing(
    tmp_path: Path,
) -> None:
    options = DesignedExploration(kind="designed_exploration", duration_s=6.0)
    parts = ExplorationParts(tmp_path / "data.npz", FILE, options, 1, 0.0, real_time=False)
    parts.begin()
    first = parts.folder / "1"
    first.mkdir()
    explore(FILE, options.model_copy(update={"duration_s": 3.0}), 1, first, quiet)
    assert 2 <= parts.done <= 3
    assert parts.how_far == f"{parts.done} of 6 s"
    parts.explore(quiet)
    assert parts.done >= 5
    assert len(parts.dataset().provenance["parts"]) == 2
    parts.explore(quiet)
    assert len(list(parts.folder.glob("*/run.mcap"))) == 2, "nothing is missing any more"


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGKILL, marks=pytest.mark.long)]
)
def test_an_exploration_that_is_ended_goes_on_where_it_was(
    number: signal.Signals, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, parts = tmp_path / "data.npz", tmp_path / "data.npz.parts"
    words = ["explore", str(PATH), "--out", str(data), "--waypoints", "6"]
    command = [sys.executable, "-m", "daemon.commands.terminal.command_line", *words]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    part = parts / "1" / "run.mcap.part"
    while not (part.exists() and part.stat().st_size > 200_000):
        assert process.poll() is None
        time.sleep(0.02)
    process.send_signal(number)
    _, told = process.communicate(timeout=60.0)
    assert process.returncode != EXIT_OK
    assert not data.exists()
    if number is not signal.SIGKILL:
        assert "--resume goes on" in told

    assert main(words) == EXIT_DATA
    assert "go on with --resume" in capsys.readouterr().err
    assert main([*words, "--seed", "2", "--resume"]) == EXIT_DATA
    assert "asked for otherwise (seed)" in capsys.readouterr().err
    assert main([*words, "--resume"]) == EXIT_OK
    assert "of 6 lines are there already" in capsys.readouterr().out
    dataset = Dataset.load(data, FILE.robot)
    assert len(dataset.provenance["parts"]) == 2
    assert 6 <= len(np.unique(dataset.frames.line)) <= 12
    assert not parts.exists()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--waypoints", "0"], "--waypoints: "),
        (["--duration", "0.1"], "--duration: "),
        (["--duration", "5", "--waypoints", "5"], "--duration is of designed motions"),
        (["--share", "1.5"], "--share: "),
        (["--dither", "nan"], "--dither: "),
        (["--tip-load", "-1"], "below 0"),
    ],
)
def test_explore_explains_what_it_cannot_do(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explore", str(PATH), "--out", str(tmp_path / "d.npz"), *words]) == EXIT_USAGE
    assert told in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_robot_without_emulated_devices_is_explored_by_its_daemon(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = PATH.read_text()
    real = tmp_path / "real.yaml"
    real.write_text(text[: text.index("\nemulation:") + 1])
    assert main(["explore", str(real), "--out", str(tmp_path / "d.npz")]) == EXIT_USAGE
    assert "--from" in capsys.readouterr().err


def test_pretrain_explains_what_it_cannot_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["pretrain", str(PATH), str(tmp_path / "none.npz"), "--out", str(tmp_path / "m.npz")]
    assert main(words) == EXIT_NO_INPUT
    assert "none.npz" in capsys.readouterr().err
    assert main([*words, "--epochs", "0"]) == EXIT_USAGE
    (tmp_path / "none.npz").write_bytes(b"junk")
    assert main(words) == EXIT_DATA
    assert "is not an exploration" in capsys.readouterr().err
