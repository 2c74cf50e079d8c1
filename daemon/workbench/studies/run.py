"""One row of a study's plan: an experiment, with a controller, on a body, with a seed."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Final, Literal

import msgspec

from config.axis import AxisBase
from config.emulation.plants import ConcentricTubesPlant
from config.tasks.controllers import ControllerOptions, load_controller_options
from config.tasks.experiment import Pretraining
from config.tasks.study import Variant
from daemon.files import write_whole
from daemon.host.processes import Share
from daemon.learning.forward.forward_fit import ForwardFit
from daemon.recording.result import Result
from daemon.recording.run_folder import formatted_json
from daemon.workbench.experiments.experiment_file import ExperimentFile, changed, known_plant
from daemon.workbench.experiments.measures import Measures
from daemon.workbench.experiments.named_files import experiment_contents, robot_contents
from daemon.workbench.studies.study_file import StudyFile, merged
from sim_backends.lab.bodies import another_body
from sim_backends.plants.concentric.body_error import matched_variation
from sim_backends.plants.concentric.relative import RelativeRangeError

_ASKED: Final = "forward_jacobian"
"""Whose model answers: it is the one that every learning controller begins with."""
_OF_WHO_IS_ASKED: Final = {"damping_mm", "posture_gain_per_s"}


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
    asked: ControllerOptions | None = None
    """The controller that is first asked, by a model of the body that is known before, whether the
    axes are fast enough for the path: the same for all controllers. None: nobody is asked."""

    def __str__(self) -> str:
        return f"{self.experiment}, {self.variant}, plant {self.plant}, seed {self.seed}"

    @property
    def foreseen(self) -> bool:
        """Whether somebody is first asked."""
        return self.asked is not None

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
        known = known_plant(self.file)
        if known is not None:
            parts["known"] = known.model_dump(mode="json")
        robot_file = replace(self.file.file, robot=self.file.robot)
        files = {**robot_contents(robot_file), **experiment_contents(self.file)}
        if files:
            parts["files"] = files
        if self.asked is not None:
            asked = self.asked.model_dump(include=_OF_WHO_IS_ASKED, exclude_defaults=True)
            if asked:
                parts["asked"] = asked
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def plan(study: StudyFile, seeds: int, plants: int, only: Sequence[str] = ()) -> list[Run]:
    """The runs of a study, seed by seed: whatever has been done by some time is comparable.

    plants: 0 for the robot file's own. only: names of experiments and variants; none: all.
    Raises PlanError.
    """
    experiments = [name for name in study.experiments if name in only]
    variants = [variant for variant in study.study.variants if variant.variant in only]
    asked = {name: _asked(study.experiments[name]) for name in study.cells}
    rows = [
        (name, variant.variant, plant, _prepared(study, name, variant, plant))
        for plant in _numbers(study, plants)
        for name in experiments or study.experiments
        for variant in variants or study.study.variants
    ]
    return [
        Run(name, variant, plant, seed, file, asked.get(name))
        for seed in range(1, seeds + 1)
        for name, variant, plant, file in rows
    ]


def _numbers(study: StudyFile, plants: int) -> Sequence[int]:
    """Of the bodies; 0: the robot file's own."""
    first = study.study.first_plant
    return range(first, first + plants) if plants else (0,)


def run_folder(root: Path, experiment: str, variant: str, plant: int, seed: int) -> Path:
    """Where a run leaves what comes out of it."""
    return root / "runs" / experiment / variant / f"plant-{plant}-seed-{seed}"


def shared(runs: Sequence[Run], share: Share) -> list[Run]:
    """Those of a share, in the order of the plan. Which these are, the order of
    fingerprints decides: shares are alike in what they cost, and none has what another has."""
    ordered = sorted(runs, key=lambda run: (run.fingerprint, str(run)))
    mine = {id(run) for number, run in enumerate(ordered) if share.has(number)}
    return [run for run in runs if id(run) in mine]


def _asked(file: ExperimentFile) -> ControllerOptions:
    """With the damping and the posture of the experiment's own controller."""
    stated = file.experiment.controller.model_dump(include=_OF_WHO_IS_ASKED)
    return load_controller_options({**stated, "kind": _ASKED})


def _prepared(study: StudyFile, name: str, variant: Variant, plant: int) -> ExperimentFile:
    """The experiment with this controller, on this body."""
    file, body_error_mm = study.experiments[name], study.study.body_error_mm
    if variant.plant:
        file = changed(file, {"plant": {**file.experiment.plant, **variant.plant}})
    controller = merged(file.experiment.controller, variant.controller)
    gain_per_s = getattr(controller, "gain_per_s", None)
    if name in study.cells and gain_per_s is not None:
        share = study.cells[name].gain
        controller = controller.model_copy(update={"gain_per_s": share * gain_per_s})
    pretraining = _pretraining(file.experiment.pretraining, variant.pretraining)
    update = {"controller": controller, "pretraining": pretraining}
    experiment = file.experiment.model_copy(update=update)
    emulation = file.robot.emulation
    if plant == 0 or emulation is None:
        return replace(file, experiment=experiment)
    if body_error_mm is None:
        other = another_body(emulation, plant)
    elif isinstance(emulation.plant, ConcentricTubesPlant):
        tubes = _other_tubes(emulation.plant, tuple(file.robot.axes), plant, body_error_mm)
        other = emulation.model_copy(update={"plant": tubes})
    else:
        raise PlanError(f"nothing tells how far another {emulation.plant.kind} is off")
    robot = file.robot.model_copy(update={"emulation": other})
    return replace(file, experiment=experiment, robot=robot)


def _pretraining(own: Pretraining | None, on_top: Pretraining | None) -> Pretraining | None:
    if own is None or on_top is None:
        return own if on_top is None else on_top
    given = {name: getattr(on_top, name) for name in on_top.model_fields_set}
    return own.model_copy(update=given)


def _other_tubes(
    plant: ConcentricTubesPlant, axes: tuple[AxisBase, ...], number: int, mean_mm: float
) -> ConcentricTubesPlant:
    """Another set of tubes, as far off as is wanted. Raises PlanError."""
    key = (plant.model_dump_json(), number, mean_mm)
    if key not in _MATCHED:
        try:
            _MATCHED[key] = matched_variation(plant, axes, number, mean_mm)
        except RelativeRangeError as error:
            raise PlanError(str(error)) from None
    return _MATCHED[key]


_MATCHED: Final[dict[tuple[str, int, float], ConcentricTubesPlant]] = {}
"""It takes half a second to find one, and every run on the same body asks."""


# What became of one run of a study: a file in its folder, by which it is known to be done.


OUTCOME_FILE: Final = "outcome.json"

Verdict = Literal["finished", "held", "unstable", "failed", "refused"]


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """One run. Fields are only added, and have a default."""

    experiment: str
    variant: str
    plant: int
    seed: int
    fingerprint: str
    """Of the run's own: another one, and it has to be done again."""
    failure: str = ""
    """Why it was given up; empty: it came to its end."""
    refused: bool = False
    """Whether it was given up before anything moved, because the path cannot be followed."""
    measures: Measures | None = None
    """None: it left no steps."""
    result: Result | None = None
    """None: it failed before anything was recorded."""
    fit: ForwardFit | None = None
    """Of the model that its controller began with. None: it had none."""
    commit: str | None = None
    """Of the program, with a `+` where files differed from it; its version where it was installed.
    None: nothing was recorded."""

    def verdict(self, unstable_above_mm: float) -> Verdict:
        """In one word: the worst that can be said."""
        if self.refused:
            return "refused"
        if self.failure or self.result is None:
            return "failed"
        if any(cycle.max_mm >= unstable_above_mm for cycle in self.result.cycles):
            return "unstable"
        return "held" if self.result.holds else "finished"


def write_outcome(folder: Path, outcome: Outcome) -> None:
    """Raises OSError."""
    write_whole(folder / OUTCOME_FILE, formatted_json(outcome))


def read_outcome(run: Run, root: Path) -> Outcome | None:
    """None: this run has not been done yet, or under other conditions."""
    try:
        data = (run.folder(root) / OUTCOME_FILE).read_bytes()
        outcome = msgspec.json.decode(data, type=Outcome)
    except (OSError, msgspec.MsgspecError):
        return None
    return outcome if outcome.fingerprint == run.fingerprint else None
