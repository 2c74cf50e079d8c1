"""A scenario: what happens to an emulated lab, and when."""

from typing import Annotated

from pydantic import Field, model_validator

from config.documents.model import ConfigModel, Name, NotNegative


class ScenarioEvent(ConfigModel):
    """One thing that happens."""

    at_s: NotNegative
    """Time since the lab started."""

    inject: str | None = None
    """A fault, as `tentacled inject` takes it: `tracker.missing=0.5s`."""

    tip_load_g: NotNegative | None = None
    """What hangs on the tip from now on."""

    @model_validator(mode="after")
    def _exactly_one_thing(self) -> "ScenarioEvent":
        if (self.inject is None) == (self.tip_load_g is None):
            raise ValueError("say either inject or tip_load_g")
        return self


class Scenario(ConfigModel):
    """One scenario file."""

    scenario: Name
    description: str = ""
    events: Annotated[list[ScenarioEvent], Field(min_length=1)]
