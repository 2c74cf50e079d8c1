"""Tables in Markdown, and JSON Schemas as tables."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

Schema = Mapping[str, Any]

_BOUNDS: Final = {
    "minimum": "≥ {}",
    "exclusiveMinimum": "> {}",
    "maximum": "≤ {}",
    "exclusiveMaximum": "< {}",
    "minItems": "at least {}",
    "maxItems": "at most {}",
}
_LONGEST_DEFAULT: Final = 60
"""Characters; what is longer is told by the kind it is of."""


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a cell may have any text on one line."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(_cell(cell) for cell in line)} |\n" for line in lines)


def plain(text: str) -> str:
    """A docstring on one line, as Markdown takes it."""
    return re.sub(r"(?<!`)([<>])(?!`)", r"\\\1", " ".join(text.split()))


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


def schema_table(schema: Schema, link: str = "", told: Mapping[str, str] | None = None) -> str:
    """The keys of an object. link: what goes before a class' name in a reference to its section;
    told: by key, what it means where the schema does not say."""
    needed = schema.get("required", ())
    rows = []
    for key, value in schema.get("properties", {}).items():
        told_by_it = value.get("description", "") or (told or {}).get(key, "")
        rows.append(
            (
                f"`{key}`",
                kind_of_value(value, link),
                "needed" if key in needed else _default(value),
                plain(told_by_it),
            )
        )
    return table(("key", "value", "without it", "meaning"), rows)


def _default(value: Schema) -> str:
    if "default" not in value or value["default"] is None:
        return "none"
    text = json.dumps(value["default"], ensure_ascii=False)
    return f"`{text}`" if len(text) <= _LONGEST_DEFAULT else "as its kind has it"


def kind_of_value(value: Schema, link: str = "") -> str:
    """What may stand there, in words."""
    if "$ref" in value:
        name = value["$ref"].rpartition("/")[2]
        return f"[{name}]({link}#{name.lower()})"
    for choice in ("anyOf", "oneOf"):
        if choice in value:
            kinds = [kind_of_value(one, link) for one in value[choice] if one.get("type") != "null"]
            return " or ".join(dict.fromkeys(kinds))
    if "allOf" in value:
        return kind_of_value(value["allOf"][0], link)
    if "const" in value:
        return f"`{value['const']}`"
    if "enum" in value:
        return ", ".join(f"`{one}`" for one in value["enum"])
    return _simple(value, link)


def _simple(value: Schema, link: str) -> str:
    kind = value.get("type", "anything")
    if isinstance(kind, list):
        return " or ".join(one for one in kind if one != "null")
    if kind == "array":
        each = [kind_of_value(one, link) for one in value.get("prefixItems", ())]
        if each:
            return f"list of {len(each)}: {', '.join(dict.fromkeys(each))}"
        of = value.get("items", {})
        return f"list of {kind_of_value(of, link)}{_bounds(value)}" if of else "list"
    if kind == "object":
        inner = [*value.get("patternProperties", {}).values()]
        more = value.get("additionalProperties")
        inner += [more] if isinstance(more, dict) else []
        return f"by name: {kind_of_value(inner[0], link)}" if inner else "object"
    return f"{kind}{_bounds(value)}"


def _bounds(value: Schema) -> str:
    told = [text.format(json.dumps(value[key])) for key, text in _BOUNDS.items() if key in value]
    return f", {', '.join(told)}" if told else ""
