"""One row of a study's plan: an experiment, with a controller, on a body, with a seed."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from config.emulated_plants import SoftArmPlant
from config.study import Variant
from daemon.workbench.experiments.experiment_file import ExperimentFile
from daemon.workbench.studies.study_file import StudyFile, merged
from sim_backends.plants.variation import variation


class PlanError(ValueError):
    """A study that cannot be carried out like this; the text says why."""


@dataclass(frozen=True)
class Run:
    """Says all that is to be done, in plain data: it is sent to another process."""

    experiment: str
    variant: str
    plant: int
    """The body's number. 0: as in the robot file."""
    seed: int
    file: ExperimentFile
    """With this variant's controller, and this body."""

    def __str__(self) -> str:
        return f"{self.experiment}, {self.variant}, plant {self.plant}, seed {self.seed}"

    def folder(self, root: Path) -> Path:
        """Where it leaves what comes out of it."""
        return run_folder(root, self.experiment, self.variant, self.plant, self.seed)

    @cached_property
    def fingerprint(self) -> str:
        """Of all that it depends on, but for the program."""
        parts = {
            "experiment": self.file.experiment.model_dump(mode="json"),
            "robot": self.file.robot.model_dump(mode="json"),
            "seed": self.seed,
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def plan(study: StudyFile, seeds: int, plants: int, only: Sequence[str] = ()) -> list[Run]:
    """The runs of a study, seed by seed: whatever has been done by some time is comparable.

    plants: 0 for the robot file's own. only: names of experiments and variants; none: all.
    Raises PlanError.
    """
    experiments = [name for name in study.experiments if name in only]
    variants = [variant for variant in study.study.variants if variant.variant in only]
    rows = [
        (name, variant.variant, plant, _prepared(study.experiments[name], variant, plant))
        for plant in (range(1, plants + 1) if plants else (0,))
        for name in experiments or study.experiments
        for variant in variants or study.study.variants
    ]
    return [
        Run(name, variant, plant, seed, file)
        for seed in range(1, seeds + 1)
        for name, variant, plant, file in rows
    ]


def run_folder(root: Path, experiment: str, variant: str, plant: int, seed: int) -> Path:
    """Where a run leaves what comes out of it."""
    return root / "runs" / experiment / variant / f"plant-{plant}-seed-{seed}"


def _prepared(file: ExperimentFile, variant: Variant, plant: int) -> ExperimentFile:
    """The experiment with this controller, on this body."""
    controller = merged(file.experiment.controller, variant.controller)
    experiment = file.experiment.model_copy(update={"controller": controller})
    emulation = file.robot.emulation
    if plant == 0 or emulation is None:
        return replace(file, experiment=experiment)
    if not isinstance(emulation.plant, SoftArmPlant):
        raise PlanError(
            f"{file.robot.robot} has one body only (a {emulation.plant.kind}): --plants 0"
        )
    other = emulation.model_copy(update={"plant": variation(emulation.plant, plant)})
    robot = file.robot.model_copy(update={"emulation": other})
    return replace(file, experiment=experiment, robot=robot)
