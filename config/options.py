"""Options that come in a message instead of a file: checked alike, told alike, without lines."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from config.schema_errors import schema_problems
from config.yaml_document import YamlDocument

M = TypeVar("M", bound=BaseModel)


class OptionsError(ValueError):
    """Options that cannot be used, with every problem found in them."""

    def __init__(self, problems: Sequence[str]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(self.problems))


def checked_options(model: type[M], key: str, mapping: Mapping[str, Any]) -> M:
    """`model` with `mapping` under `key`. Raises OptionsError that names every wrong key."""
    value = {key: dict(mapping)}
    try:
        return model.model_validate(value)
    except ValidationError as error:
        found = schema_problems(YamlDocument("", value), model, error)
        raise OptionsError([f"{one.key_path}: {one.message}" for one in found]) from None
