"""The pages of what files may say: robots, experiments, scenarios, studies, and kinds."""

from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from config.documents.kinds import GROUPS, entries, kind_of
from config.robot import Robot
from config.tasks.experiment import Experiment
from config.tasks.scenario import Scenario
from config.tasks.study import Study
from tests.docs.reference.markdown import Schema, plain, schema_table

_CONFIGURATION = """\
# Configuration

What robot files, experiments, scenarios and studies may say. `tentacled check FILE` finds what is
wrong with one; editors complete a robot file by its JSON Schema (`tentacled schema`). What the
`kind:` of a controller, a plant or a trajectory takes stands in [Kinds](kinds.md).
"""
_KINDS = """\
# Kinds

Controllers, plants and trajectories that a file may name by `kind:`, with their options. A package
can bring more: [Your own controller](../your-own-controller.md). `tentacled plugins` lists what is
there.
"""
_TITLES = {
    "tentacled.controllers": "Controllers",
    "tentacled.plants": "Plants",
    "tentacled.trajectories": "Trajectories",
}


def configuration_page() -> str:
    """Of all files."""
    kinds = _classes_of_kinds()
    told: set[str] = set()
    parts = [_CONFIGURATION]
    for title, model in (
        ("Robot file", Robot),
        ("Experiment", Experiment),
        ("Scenario", Scenario),
        ("Study", Study),
    ):
        schema = model.model_json_schema()
        parts += [f"\n## {title}\n\n", *_section(schema)]
        for name, one in schema.get("$defs", {}).items():
            if name not in told and name not in kinds:
                told.add(name)
                parts += [f"\n### {name}\n\n", *_section(one)]
    return _linked("".join(parts), kinds, "kinds.md")


def kinds_page() -> str:
    """Of all that has a `kind`."""
    parts, told = [_KINDS], set(_classes_of_kinds())
    for group in GROUPS:
        parts.append(f"\n## {_TITLES[group]}\n")
        inner: dict[str, Schema] = {}
        for name, entry in entries(group).items():
            if entry.shipped:
                schema = _schema(kind_of(group, name).options)
                parts += [f"\n### {name}\n\n", *_section(schema)]
                inner |= schema.get("$defs", {})
        for name, one in inner.items():
            if name not in told:
                told.add(name)
                parts += [f"\n### {name}\n\n", *_section(one)]
    return "".join(parts)


def _section(schema: Schema) -> Iterator[str]:
    if schema.get("description"):
        yield f"{plain(schema['description'])}\n\n"
    if schema.get("properties"):
        yield schema_table(schema)


def _schema(model: type[BaseModel]) -> dict[str, Any]:
    return model.model_json_schema()


def _classes_of_kinds() -> Mapping[str, str]:
    """The name of each kind, by the name of its class of options."""
    return {
        kind_of(group, name).options.__name__: name
        for group in GROUPS
        for name, entry in entries(group).items()
        if entry.shipped
    }


def _linked(text: str, kinds: Mapping[str, str], page: str) -> str:
    """What is a kind stands on another page, under its own name."""
    for name, kind in kinds.items():
        text = text.replace(f"[{name}](#{name.lower()})", f"[`{kind}`]({page}#{kind})")
    return text
