"""A study: experiments with several controllers, over seeds and bodies, side by side."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from config.documents.model import ConfigModel, Name, Positive
from config.emulation.bodies import BodyName
from config.tasks.experiment import Pretraining
from config.tasks.study_matrix import Judged, Range, StudyMatrix

PerCycle = Annotated[tuple[Positive | None, ...], Field(min_length=1, strict=False)]
Text = Annotated[str, Field(min_length=1)]


class Published(ConfigModel):
    """What a paper says of one experiment, cycle by cycle. null: it gives no figure there."""

    mean_mm: PerCycle
    std_mm: PerCycle
    max_mm: PerCycle


class PoseFigures(ConfigModel):
    """Root mean squares over a whole trajectory, coordinate by coordinate."""

    x_mm: Positive
    y_mm: Positive
    z_mm: Positive
    angle_deg: Positive | None = None


class StudyRow(ConfigModel):
    """One experiment, as a table has it."""

    experiment: Text
    """Its file, relative to this one."""
    label: Text
    body: BodyName | None = None
    """Carried out on this named body, as the experiment of that name with `_` and the body's name
    behind; what controllers know before they begin is the body without it. None: on its own."""
    published: Published | None = None
    aim_mm: PerCycle | None = None
    """What the mean error should come to in each cycle, the median over all runs. null: no aim."""
    published_pose: dict[Name, PoseFigures] = Field(default_factory=dict)
    """What a paper says of this experiment, by the variant that carries it out as the paper did."""
    aim_pose: dict[Name, PoseFigures] = Field(default_factory=dict)
    """What the errors by coordinate should come to, the median over all runs, by variant."""
    first_no_worse_than: Name | None = None
    """The experiment whose first cycle should not be better than this one's."""


class StudyTable(ConfigModel):
    """Experiments that belong together."""

    title: Text
    rows: Annotated[list[StudyRow], Field(min_length=1)]


class StudyFigure(ConfigModel):
    """A picture for each variant: path, a corner, and the error over time, row by row."""

    figure: Name
    """Begins the name of its files."""
    title: Text
    experiments: Annotated[list[Name], Field(min_length=1)]


class Variant(ConfigModel):
    """A controller that takes part."""

    variant: Name
    label: Text
    controller: dict[str, Any] = Field(default_factory=dict)
    """What is set on top of the experiment's own controller. With another `kind`, what both kinds
    have in common is kept."""
    pretraining: Pretraining | None = None
    """What is set on top of the experiment's own pre-training."""
    plant: dict[str, Any] = Field(default_factory=dict)
    """What is set on top of the experiment's own `plant`: this column is of another body."""
    tune: Annotated[dict[str, Range], Field(max_length=4)] = Field(default_factory=dict)
    """Options that `tentacled tune` seeks, and within which range."""


class Study(ConfigModel):
    """One study file."""

    study: Name
    description: str = ""
    source: str = ""
    """Who published what is `published`."""
    tables: list[StudyTable] = Field(default_factory=list)
    matrix: list[StudyMatrix] = Field(default_factory=list)
    """Experiments made of one another, beside those of the tables: cells of a bench."""
    judged: Judged | None = None
    """What is said of a controller over all cells. None: nothing."""
    tuned: Text | None = None
    """What `tentacled tune` wrote, relative to this file: set on top of the variants that it
    names."""
    figures: list[StudyFigure] = Field(default_factory=list)
    variants: Annotated[list[Variant], Field(min_length=1)]
    seeds: Annotated[int, Field(ge=1)] = 5
    """Every experiment is carried out with seeds 1 to this."""
    plants: Annotated[int, Field(ge=0)] = 3
    """... on so many bodies, none like the other. 0: on the robot file's own."""
    first_plant: Annotated[int, Field(ge=1)] = 1
    """Number of the first of them: another one begins another series of bodies."""
    body_error_mm: Positive | None = None
    """How far those bodies' tips are, in the mean over their configurations, from the robot file's
    own. None: as one made body differs from the next."""
    unstable_above_mm: Positive = 20.0
    """A run whose error comes to this within a cycle is told as unstable."""

    @model_validator(mode="after")
    def _says_what_is_run(self) -> "Study":
        if not self.tables and not self.matrix:
            raise ValueError("say tables, or a matrix, or both")
        known = {variant.variant for variant in self.variants}
        judged = self.judged
        asked = [] if judged is None else [judged.ours, judged.without_learning]
        unknown = [name for name in asked if name not in {None, *known}]
        if unknown:
            raise ValueError(f"judged: there is no variant {unknown[0]}")
        return self

    @model_validator(mode="after")
    def _names_are_names_of_one(self) -> "Study":
        for what, names in (
            ("variant", [variant.variant for variant in self.variants]),
            (
                "experiment",
                [f"{row.experiment}{f' ({row.body})' if row.body else ''}" for row in self.rows],
            ),
            ("figure", [figure.figure for figure in self.figures]),
        ):
            twice = sorted({name for name in names if names.count(name) > 1})
            if twice:
                raise ValueError(f"the {what} {twice[0]} is there twice")
        return self

    @property
    def rows(self) -> list[StudyRow]:
        """Of all tables."""
        return [row for table in self.tables for row in table.rows]
