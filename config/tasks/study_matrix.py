"""A matrix of experiments: one for each of its bodies, paths, speeds, loads and gains together."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from config.documents.model import ConfigModel, Name, NotNegative, Positive
from config.emulation.bodies import BodyName
from config.tasks.experiment import Happening


class MatrixPath(ConfigModel):
    """A path, at one speed or at several."""

    path: Name
    trajectory: dict[str, Any]
    """As an experiment has it; without `cycle_s` where there are speeds."""
    speeds_mm_s: list[Positive] = Field(default_factory=list)
    """Of the tip, in the mean over a cycle: each makes an experiment. None: as the trajectory has
    it."""


class MatrixLoad(ConfigModel):
    """What hangs on the tip, and what happens to it."""

    load: Name
    tip_load_g: NotNegative = 0.0
    """From the start."""
    happenings: list[Happening] = Field(default_factory=list)


class StudyMatrix(ConfigModel):
    """Experiments that differ from one in a body, a path, a load and a gain: all together."""

    robot: Name
    """As tables call it; becomes part of the experiments' names."""
    experiment: Annotated[str, Field(min_length=1)]
    """The file of the one experiment, relative to this one: robot, controller, pre-training."""
    bodies: list[BodyName] = Field(default_factory=list)
    """Named ones. What controllers know before they begin is the body without them. None: the
    experiment's own."""
    paths: Annotated[list[MatrixPath], Field(min_length=1)]
    loads: Annotated[list[MatrixLoad], Field(min_length=1)] = Field(
        default_factory=lambda: [MatrixLoad(load="empty")]
    )
    gains: Annotated[list[Positive], Field(min_length=1)] = Field(default_factory=lambda: [1.0])
    """Of every controller that has a gain, as shares of its own."""


class Judged(ConfigModel):
    """Which controller is judged, and by what."""

    ours: Name
    """The variant that should be best, or within noise of the best, in every cell."""
    without_learning: Name | None = None
    """The variant than which it should be nowhere worse by more than noise."""
    share_best: Annotated[float, Field(gt=0.0, le=1.0)] = 0.95
    """Of the cells in which it should be best or within noise."""
    never_above: Annotated[float, Field(ge=1.0)] = 1.2
    """Times the best one's error, in no cell."""


class Range(ConfigModel):
    """Within which an option is sought."""

    low: float
    high: float
    log: bool = False
    """Whether its decades count alike, not its steps."""

    @model_validator(mode="after")
    def _rises(self) -> "Range":
        if not self.low < self.high:
            raise ValueError("low is below high")
        if self.log and self.low <= 0.0:
            raise ValueError("what is sought by decades is above 0")
        return self


class Tuned(ConfigModel):
    """What a search found."""

    tuned: Name
    """The study that it was sought with."""
    search: str
    """How, in words."""
    variants: dict[Name, dict[str, float]]
    """Options of each of its variants."""
