"""Reads a study file, and the experiments that it names: sound, or every problem at once."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from config.documents.model import OptionsError
from config.documents.problems import ConfigError, Problem, did_you_mean_file
from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import YamlDocument, read_yaml
from config.paths import is_file
from config.tasks.controllers import (
    ControllerOptions,
    controller_type,
    load_controller_options,
)
from config.tasks.study import Study, StudyRow, Variant
from config.tasks.study_matrix import Tuned
from daemon.workbench.experiments.experiment_file import (
    ExperimentFile,
    load_experiment,
    on_body,
    other_plant,
)
from daemon.workbench.studies.study_matrix import Cell, expanded


@dataclass(frozen=True)
class StudyFile:
    """A sound study. Experiments have their own names, whatever their files are called."""

    path: Path
    study: Study
    experiments: Mapping[str, ExperimentFile]
    """By name, in the order of the tables."""
    rows: Mapping[str, StudyRow]
    """By the experiment's name."""
    cells: Mapping[str, Cell] = field(default_factory=dict)
    """Of those experiments that a matrix is made of, what it is made of."""
    searched: str = ""
    """How the variants were tuned; empty: nobody says."""


def load_study(path: Path) -> StudyFile:
    """Raises ConfigError with every problem of the study, or of the first wrong experiment."""
    document = read_yaml(path)
    if document.problems:
        raise ConfigError(document.problems)
    try:
        study = Study.model_validate(document.value)
    except ValidationError as error:
        raise ConfigError(schema_problems(document, Study, error)) from None
    experiments: dict[str, ExperimentFile] = {}
    rows: dict[str, StudyRow] = {}
    problems: list[Problem] = []
    for table_number, table in enumerate(study.tables):
        for row_number, row in enumerate(table.rows):
            where = ("tables", table_number, "rows", row_number, "experiment")
            file = path.parent / row.experiment
            if not is_file(file):
                text = f"there is no file {file}{did_you_mean_file(file)}"
                problems.append(document.problem(where, text))
                continue
            loaded = load_experiment(file)
            if row.body is not None:
                loaded = on_body(loaded, row.body)
            name = loaded.experiment.experiment
            if name in experiments:
                problems.append(document.problem(where, f"another one is called {name} too"))
            experiments[name], rows[name] = loaded, row
    cells: dict[str, Cell] = {}
    for made in expanded(document, study, path.parent, problems):
        name = made.cell.name
        if name in experiments:
            problems.append(document.problem(("matrix",), f"another one is called {name} too"))
        experiments[name], rows[name], cells[name] = made.file, made.row, made.cell
    study, searched = _with_tuned(document, study, path.parent, problems)
    problems += _unknown_names(document, study, set(experiments))
    problems += _unfit_variants(document, study, experiments)
    if problems:
        raise ConfigError(problems)
    return StudyFile(path, study, experiments, rows, cells, searched)


def _with_tuned(
    document: YamlDocument, study: Study, folder: Path, problems: list[Problem]
) -> tuple[Study, str]:
    """The study with what a search found on top of its variants, and how it was found."""
    if study.tuned is None:
        return study, ""
    path = folder / study.tuned
    if not is_file(path):
        text = f"there is no file {path}{did_you_mean_file(path)}"
        problems.append(document.problem(("tuned",), text))
        return study, ""
    tuned = load_tuned(path)
    variants = [
        one.model_copy(update={"controller": {**one.controller, **tuned.variants[one.variant]}})
        if one.variant in tuned.variants
        else one
        for one in study.variants
    ]
    return study.model_copy(update={"variants": variants}), tuned.search


def load_tuned(path: Path) -> Tuned:
    """Raises ConfigError with every problem of the file."""
    document = read_yaml(path)
    if document.problems:
        raise ConfigError(document.problems)
    try:
        return Tuned.model_validate(document.value)
    except ValidationError as error:
        raise ConfigError(schema_problems(document, Tuned, error)) from None


def merged(options: ControllerOptions, overrides: Mapping[str, Any]) -> ControllerOptions:
    """The options with others on top; of another kind's, those that this kind has too.

    Raises OptionsError.
    """
    other = controller_type(str(overrides.get("kind", options.kind)))
    if other is None:
        return load_controller_options(dict(overrides))  # which says that there is no such kind
    given = options.model_dump(exclude_unset=True)
    kept = {key: value for key, value in given.items() if key in other.model_fields}
    if other is not type(options):
        kept.pop("kind", None)
    return load_controller_options({**kept, **overrides})


def _unknown_names(document: YamlDocument, study: Study, known: set[str]) -> list[Problem]:
    problems = []
    for number, figure in enumerate(study.figures):
        for index, name in enumerate(figure.experiments):
            if name not in known:
                where = ("figures", number, "experiments", index)
                problems.append(document.problem(where, f"no table has an experiment {name}"))
    for table_number, table in enumerate(study.tables):
        for row_number, row in enumerate(table.rows):
            if row.first_no_worse_than not in {None, *known}:
                place = ("tables", table_number, "rows", row_number, "first_no_worse_than")
                text = f"no table has an experiment {row.first_no_worse_than}"
                problems.append(document.problem(place, text))
    return problems


def _unfit_variants(
    document: YamlDocument, study: Study, experiments: Mapping[str, ExperimentFile]
) -> list[Problem]:
    """A variant's options must be right for every experiment."""
    problems = []
    for number, variant in enumerate(study.variants):
        for name, file in experiments.items():
            try:
                merged(file.experiment.controller, variant.controller)
            except OptionsError as error:
                where = ("variants", number, "controller")
                problems.append(document.problem(where, f"with {name}: {error}"))
                break
            if wrong := _unfit_plant(document, file, number, variant):
                problems += wrong
                break
    return problems


def _unfit_plant(
    document: YamlDocument, file: ExperimentFile, number: int, variant: Variant
) -> list[Problem]:
    where, emulation = ("variants", number, "plant"), file.robot.emulation
    if not variant.plant or emulation is None:
        return []
    try:
        other_plant(emulation.plant, {**file.experiment.plant, **variant.plant})
    except ValidationError as error:
        return schema_problems(document, type(emulation.plant), error, *where)
    return []
