"""What every part of the schema shares: unknown keys refused, nothing coerced, nothing mutable."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Final, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    StringConstraints,
    ValidationError,
)

from config.documents.schema_errors import schema_problems
from config.documents.yaml_document import YamlDocument

# Options that come in a message instead of a file: checked alike, told alike, without lines.


M = TypeVar("M", bound=BaseModel)


_MOST_TOLD: Final = 16
"""Problems of one message: to look for what was meant by each of ten thousand takes a second, which
whoever has to read the message does not have, and makes an answer that is too long to be sent."""
_LONGEST_TOLD: Final = 400


class OptionsError(ValueError):
    """Options that cannot be used, with the problems found in them."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__(self.problems)  # as it is made again on the other side of a process

    def __str__(self) -> str:
        return "; ".join(self.problems)


def checked_options(model: type[M], key: str, mapping: Mapping[str, Any]) -> M:
    """`model` with `mapping` under `key`. Raises OptionsError that names every wrong key, or the
    first ones of very many."""
    value = {key: dict(mapping)}
    try:
        return model.model_validate(value)
    except ValidationError as error:
        found = schema_problems(YamlDocument("", value), model, error, most=_MOST_TOLD)
        told = [_cut(f"{one.key_path}: {one.message}") for one in found]
        more = error.error_count() - len(found)
        raise OptionsError([*told, f"and {more} more"] if more else told) from None


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST_TOLD else f"{text[:_LONGEST_TOLD]} ..."


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

LONGEST_DRIVE_TIME_S: Final = 65.0
DriveTime = Annotated[float, Field(ge=0.001, le=LONGEST_DRIVE_TIME_S)]
"""A time that a drive is told in milliseconds of 16 bits, of which none says: never."""


def _a_rotation(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    if not any(quaternion):
        raise ValueError("zero is no rotation")
    return quaternion


Quaternion = Annotated[
    tuple[float, float, float, float], Field(strict=False), AfterValidator(_a_rotation)
]
"""Scalar first; its length does not matter."""
Vector3 = Annotated[tuple[float, float, float], Field(strict=False)]
