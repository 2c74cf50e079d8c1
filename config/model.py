"""What every part of the schema shares: unknown keys refused, nothing coerced, nothing mutable."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints


class ConfigModel(BaseModel):
    """A part of a configuration file."""

    model_config = ConfigDict(
        extra="forbid",
        frozen=True,
        strict=True,
        allow_inf_nan=False,
        use_attribute_docstrings=True,
        validate_default=True,
    )


Name = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]{0,62}$")]
"""A lower-case word: it becomes part of remote keys, file names and table heads."""

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
NodeId = Annotated[int, Field(ge=1, le=127)]
Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
