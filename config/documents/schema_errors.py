"""Schema violations in the file's own words: where they stand and what was probably meant."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from config.documents.problems import Key, Problem, did_you_mean
from config.documents.yaml_document import Location, YamlDocument

JsonSchema = Mapping[str, Any]


def schema_problems(
    document: YamlDocument,
    model: type[BaseModel],
    error: ValidationError,
    *below: str | int,
    most: int | None = None,
) -> list[Problem]:
    """Every violation in `error` as a problem in `document`, or the first `most`.

    below: keys, and places in lists, to what the model is of; none: it is of all of the document.
    """
    schema: dict[str, Any] = model.model_json_schema()
    for key in reversed(below):
        inside = {"items": schema} if isinstance(key, int) else {"properties": {key: schema}}
        schema = {**inside, "$defs": schema.get("$defs", {})}
    found = error.errors(include_url=False)[:most]
    return [_problem(document, schema, details, below) for details in found]


def _problem(
    document: YamlDocument, schema: JsonSchema, details: ErrorDetails, below: Location
) -> Problem:
    location, at_key = location_in_file(document.value, (*below, *details["loc"]))
    kind, value = details["type"], details["input"]
    if kind == "missing":
        return document.problem(location, "this key is required and is not there")
    if kind == "extra_forbidden":
        known = _known_keys(schema, document.value, location[:-1])
        hint = did_you_mean(str(location[-1]), known)
        return document.problem(location, f"unknown key{hint}", at_key=True)
    context = details.get("ctx", {})
    if kind == "literal_error":
        expected = str(context["expected"])
        hint = did_you_mean(str(value), [word.strip("'") for word in _words(expected)])
        message = f"must be {expected}, not {value!r}{hint}"
    elif kind == "union_tag_invalid":
        expected = str(context["expected_tags"])
        hint = did_you_mean(str(context["tag"]), [word.strip("'") for word in _words(expected)])
        location = (*location, str(context["discriminator"]).strip("'"))
        message = f"must be one of {expected}, not '{context['tag']}'{hint}"
    elif kind == "union_tag_not_found":
        location = (*location, str(context["discriminator"]).strip("'"))
        return document.problem(location, "this key is required and is not there")
    elif kind == "kind_refused":
        location, message = (*location, "kind"), str(context["why"])
    elif kind == "value_error":
        message = str(context["error"])
    elif kind == "string_pattern_mismatch":
        message = f"must look like {context['pattern']}, not {value!r}"
    else:
        message = details["msg"].replace("Input should", "should").replace("Keys should", "should")
        if not isinstance(value, Mapping | list):
            message += f", not {value!r}"
    return document.problem(location, message, at_key=at_key)


def _words(expected: str) -> list[str]:
    return expected.replace(" or ", ", ").split(", ")


def location_in_file(data: object, loc: Sequence[Key]) -> tuple[Location, bool]:
    """pydantic's location without what is not in the file (union tags), and whether it is a key."""
    location: Location = ()
    for index, part in enumerate(loc):
        if part == "[key]":
            return location, True
        last = index == len(loc) - 1
        if isinstance(data, Mapping) and (part in data or last):
            location, data = (*location, part), data.get(part)
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            location, data = (*location, part), data[part]
    return location, False


def _known_keys(schema: JsonSchema, data: object, location: Location) -> list[str]:
    """The keys that the schema has at `location`."""
    definitions = cast(JsonSchema, schema.get("$defs", {}))
    node = _resolve(schema, definitions, data)
    for part in location:
        data = cast(Any, data)[part]
        if isinstance(part, int):
            items = node.get("items", {})
            node = items if isinstance(items, Mapping) else {}
        else:
            properties = node.get("properties", {})
            node = properties.get(part) or _any_key(node)
        node = _resolve(node, definitions, data)
    return list(node.get("properties", {}))


def _any_key(node: JsonSchema) -> JsonSchema:
    """The schema of the values of a free mapping."""
    by_pattern = node.get("patternProperties", {}).values()
    return next(iter(by_pattern), node.get("additionalProperties") or {})


def _resolve(node: JsonSchema, definitions: JsonSchema, data: object) -> JsonSchema:
    """Follow references, and of alternatives take the one that `data` names."""
    for _ in range(8):
        if "$ref" in node:
            node = definitions[str(node["$ref"]).rsplit("/", 1)[1]]
        elif "discriminator" in node:
            tag = data.get(node["discriminator"]["propertyName"]) if isinstance(data, dict) else ""
            mapping = node["discriminator"]["mapping"]
            if tag not in mapping:
                return {}
            node = {"$ref": mapping[tag]}
        elif "anyOf" in node:
            node = next((n for n in node["anyOf"] if n.get("type") != "null"), {})
        else:
            return node
    return node
