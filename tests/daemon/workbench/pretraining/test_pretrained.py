"""An experiment's controller gets the model of the experiment's body, without the load."""

import os
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import pytest

from config.loader import RobotFile, load_robot
from config.tasks.experiment import Pretraining
from daemon.learning.forward.pretraining import PretrainingError
from daemon.workbench.experiments.experiment_file import load_experiment
from daemon.workbench.experiments.trial import TrialError
from daemon.workbench.pretraining import model_cache

SOFT_ARM = Path(str(files("config") / "robots" / "soft_arm.yaml"))

EXPERIMENT = """
experiment: learner
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 8, cycle_s: 4}
controller: {kind: forward_jacobian}
pretraining: {waypoints: 12}
tip_load_g: 14.2
plant: {mass_g: 50.0}
"""


class Made:
    """Stands for the making of models."""

    def __init__(self) -> None:
        self.asked: list[tuple[RobotFile, Pretraining, int]] = []

    def __call__(
        self, file: RobotFile, how: Pretraining, seed: int, tell: object, **more: object
    ) -> Path:
        self.asked.append((file, how, seed))
        return Path("made.npz")


def kept_with(monkeypatch: pytest.MonkeyPatch, fit: object) -> None:
    """Every model that is asked for was made before, and explains what it was judged by so far."""
    monkeypatch.setattr(model_cache, "_usable", lambda path, file: SimpleNamespace(fit=fit))


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Made:
    one = Made()
    monkeypatch.setattr(model_cache, "pretrained", one)
    return one


def controller_of(tmp_path: Path, text: str, seed: int = 7) -> object:
    path = tmp_path / "experiment.yaml"
    path.write_text(text)
    given = load_experiment(path)
    return model_cache.with_model(given, seed, lambda _: None).experiment.controller


def test_the_model_is_of_this_body_with_nothing_at_its_tip(made: Made, tmp_path: Path) -> None:
    controller = controller_of(tmp_path, EXPERIMENT)
    assert getattr(controller, "model", None) == "made.npz"
    ((file, how, seed),) = made.asked
    emulation = file.robot.emulation
    assert emulation is not None
    assert getattr(emulation.plant, "mass_g", None) == 50.0
    assert emulation.tip_load_g == 0.0
    assert (how.waypoints, seed) == (12, 7)


@pytest.mark.parametrize(("asked", "model"), [("true", "builtin:tendon_arm.npz"), ("false", None)])
def test_where_nobody_is_asked_for_the_risk_nobody_is_while_the_body_is_explored(
    made: Made, tmp_path: Path, asked: str, model: str | None
) -> None:
    tendons = EXPERIMENT.replace("soft_arm", "tendon_arm").replace("mass_g", "pretension_n")
    controller_of(tmp_path, f"{tendons}risk: {asked}\n")
    ((file, _, _),) = made.asked
    assert file.robot.risk.model == model


def test_what_is_in_the_files_that_a_robot_names_makes_it_another_model(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The gate asks for the risk while the body is explored: by the body's model, in the mesh."""
    kept_with(monkeypatch, fit=None)
    shipped = Path(str(files("config") / "robots" / "tendon_arm.yaml")).read_text()
    robot = tmp_path / "robot.yaml"
    robot.write_text(shipped.replace("builtin:tendon_arm.npz", "body.npz"))
    body = tmp_path / "body.npz"
    body.write_bytes(b"as it was learnt first")
    first = model_cache.pretrained(load_robot(robot))
    assert model_cache.pretrained(load_robot(robot)) == first
    body.write_bytes(b"as it was learnt again")
    os.utime(body, ns=(0, 0))
    assert model_cache.pretrained(load_robot(robot)) != first


@pytest.mark.parametrize(("r2", "told"), [(0.03, ["the model explains 3%"]), (0.9, [])])
def test_a_model_that_says_nothing_of_the_body_is_told_each_time_it_is_used(
    monkeypatch: pytest.MonkeyPatch, r2: float, told: list[str]
) -> None:
    kept_with(monkeypatch, fit=SimpleNamespace(r2=r2))
    heard: list[str] = []
    model_cache.pretrained(load_robot(SOFT_ARM), tell=heard.append)
    assert [line[: len("the model explains 3%")] for line in heard] == told


def test_a_seed_of_its_own_makes_one_model_for_all_seeds(made: Made, tmp_path: Path) -> None:
    controller_of(tmp_path, EXPERIMENT.replace("waypoints: 12", "waypoints: 12, seed: 3"))
    assert [seed for _, _, seed in made.asked] == [3]


@pytest.mark.parametrize(
    ("change", "model"),
    [
        (("kind: forward_jacobian", "kind: forward_jacobian, model: mine.npz"), "mine.npz"),
        (("kind: forward_jacobian", "kind: broyden"), None),
        (("pretraining: {waypoints: 12}\n", ""), None),
    ],
)
def test_no_model_is_made_where_none_is_wanted(
    made: Made, tmp_path: Path, change: tuple[str, str], model: str | None
) -> None:
    controller = controller_of(tmp_path, EXPERIMENT.replace(*change))
    assert getattr(controller, "model", None) == model
    assert made.asked == []


def test_what_cannot_be_learnt_is_a_failure_of_the_trial(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def cannot(*_: object, **more: object) -> Path:
        raise PretrainingError("3 lines are too few")

    monkeypatch.setattr(model_cache, "pretrained", cannot)
    with pytest.raises(TrialError, match="3 lines are too few"):
        controller_of(tmp_path, EXPERIMENT)
