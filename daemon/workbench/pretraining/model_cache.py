"""Models of emulated robots, made when they are first asked for, and kept.

A model belongs to the robot file with everything in it, the emulated body included, and to how it
was made. Where any of this changes, there is another model.
"""

import hashlib
import json
import tempfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from config.exploration import WaypointExploration
from config.loader import RobotFile
from daemon.files import models_directory
from daemon.learning.forward.pretrained_model import KIND, PretrainedModel
from daemon.learning.forward.pretraining import PretrainingSettings, pretrain
from daemon.npz_file import ModelError
from daemon.workbench.experiments.trial import Tell
from daemon.workbench.pretraining.explore import config_sha256, explore

_RECIPE: Final = 1
"""Another number for models that come out otherwise from the same settings."""
_KEY_DIGITS: Final = 16


def pretrained(
    file: RobotFile,
    waypoints: int = 80,
    seed: int = 1,
    tell: Tell = lambda _: None,
    directory: Path | None = None,
) -> Path:
    """The model of this emulated robot with nothing at its tip: found, or made in virtual time.

    It is learnt from everything that the exploration saw; nothing is kept back for a test. The same
    arguments give the same model. Not to be called from an event loop: it runs one of its own.
    tell: hears what is done, where something has to be. directory: instead of the usual one.
    Raises TrialError and PretrainingError where the robot cannot be explored, OSError.
    """
    options = WaypointExploration(kind="waypoint_exploration", waypoints=waypoints)
    settings = PretrainingSettings(test_share=0.0, seed=seed)
    folder = models_directory() if directory is None else directory
    path = folder / f"{file.robot.robot}-{_key(file, options, settings, seed)}.npz"
    if _usable(path, file):
        return path
    folder.mkdir(parents=True, exist_ok=True)
    tell(f"exploring {file.robot.robot} in virtual time: {waypoints} waypoints")
    with tempfile.TemporaryDirectory(prefix="tentacled-") as run:
        dataset = explore(file, options, seed, Path(run), tell)
    tell(f"learning from {dataset.frames.duration_s:.0f} s of motion")
    PretrainedModel.of(pretrain(dataset, settings), dataset).save(path)
    tell(f"the model is kept in {path}")
    return path


def _usable(path: Path, file: RobotFile) -> bool:
    try:
        PretrainedModel.load(path, file.robot)
    except (ModelError, FileNotFoundError):
        return False
    return True


def _key(
    file: RobotFile, options: WaypointExploration, settings: PretrainingSettings, seed: int
) -> str:
    made_of: dict[str, Any] = {
        "config": config_sha256(file),
        "exploration": options.model_dump(mode="json"),
        "pretraining": asdict(settings),
        "seed": seed,
        "version": version("tentacled"),
        "format": KIND,
        "recipe": _RECIPE,
    }
    text = json.dumps(made_of, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_KEY_DIGITS]
