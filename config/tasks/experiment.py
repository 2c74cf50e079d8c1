"""An experiment: robot, trajectory, load and controller, giving a table and a recording."""

from typing import Annotated, Any

from pydantic import Field, model_validator

from config.documents.model import ConfigModel, Name, NotNegative, Positive
from config.tasks.controllers import ControllerOptions
from config.tasks.trajectory import TrajectoryOptions


class Happening(ConfigModel):
    """One thing that happens during the experiment. Say one of `at_s`, `at_cycle`."""

    at_s: NotNegative | None = None
    """Time since the trajectory began."""

    at_cycle: Annotated[int, Field(ge=0)] | None = None
    """When this cycle of the trajectory begins, from 0."""

    tip_load_g: NotNegative | None = None
    """What hangs on the tip from now on."""

    fill_g_s: Positive | None = None
    """... reached by so much in a second, as water does that is poured in; else at once."""

    inject: str | None = None
    """A fault, as `tentacled inject` takes it."""

    @model_validator(mode="after")
    def _one_time_and_one_thing(self) -> "Happening":
        if (self.at_s is None) == (self.at_cycle is None):
            raise ValueError("say either at_s or at_cycle")
        if (self.tip_load_g is None) == (self.inject is None):
            raise ValueError("say either tip_load_g or inject")
        if self.fill_g_s is not None and self.tip_load_g is None:
            raise ValueError("fill_g_s needs a tip_load_g to fill up to")
        return self


class Pretraining(ConfigModel):
    """What the controller knows before it begins: a body, with nothing at its tip.

    The model is made in virtual time when it is needed first, and kept. How motions become samples
    is chosen as it serves learning; a study may take worse ones, as others had them.
    """

    waypoints: Annotated[int, Field(ge=1)] | None = None
    """Random places of the axes, from all of their travel, that were gone to, one after the other.
    None: some seconds of designed motions instead."""

    dither_share: Annotated[float, Field(ge=0.0, le=0.25)] | None = None
    """Of the lines to waypoints, as a share of each axis' travel. 0: they are straight, and all
    samples of a line go the same way. None: as an exploration does it."""

    home_every: Annotated[int, Field(ge=0)] | None = None
    """Every so many lines one leads home; 0: none. None: as an exploration does it."""

    fields: Annotated[int, Field(ge=1)] | None = None
    """How many receptive fields. None: one for every hundred samples."""

    sample_tip_mm: Positive | None = None
    """A sample ends when the tip has moved so far ..."""

    sample_travel_share: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """... or the axes together so far, as a share of their travel."""

    averaged_share: Annotated[float, Field(ge=0.0, le=0.5)] | None = None
    """Each end of a sample is the mean of so much of its frames. 0: a single frame."""

    lag_s: NotNegative | None = None
    """How much later than its axes the body is taken to move. None: as the motions show it."""

    test_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0
    """Of the lines to waypoints, that are kept back to see how well the others foretell them."""

    plant: dict[str, Any] | None = None
    """Of the body that it knows: overrides of the robot file's `emulation.plant`, so `{}` is the
    robot file's own. None: the body of the experiment."""

    seed: Annotated[int, Field(ge=0)] | None = None
    """Of what is explored, and of the emulated devices meanwhile. None: the experiment's own, and
    so the same tracker."""

    @model_validator(mode="after")
    def _lines_lead_to_waypoints(self) -> "Pretraining":
        for name in ("dither_share", "home_every"):
            if getattr(self, name) is not None and self.waypoints is None:
                raise ValueError(f"`{name}` is of lines to `waypoints`: say how many")
        return self


class Experiment(ConfigModel):
    """One experiment file."""

    experiment: Name
    description: str = ""
    robot: str
    """The robot file, relative to this file; `builtin:soft_arm` for one that is shipped."""
    trajectory: TrajectoryOptions
    controller: ControllerOptions
    pretraining: Pretraining | None = None
    """For controllers that know a model. None: what their own `model` says."""
    tip_load_g: NotNegative = 0.0
    """From the start."""
    happenings: list[Happening] = Field(default_factory=list)
    plant: dict[str, Any] = Field(default_factory=dict)
    """Overrides of the robot file's `emulation.plant`: another body, the same robot. `body: worn`
    takes a named one, and whatever stands beside it comes on top."""
    tracking_error_mm: Positive | None = None
    """How far the tip may stay from its reference before it is held, for who is to be seen going
    on beyond what the robot file allows. None: as that says."""
    risk: bool = True
    """Whether the gate asks for the risk that the robot file names."""
    blend_speed_mm_s: Positive = 5.0
    """How fast the tip is led to the start, at most: slower where a model says that the axes would
    have to hurry."""
    seed: Annotated[int, Field(ge=0)] = 1
    """Of everything random, unless `--seed` says another."""
    longest_s: Positive = 3600.0
    """The experiment is given up after this long."""
