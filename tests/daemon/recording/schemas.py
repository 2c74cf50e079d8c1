"""Recorded messages against the schemas of their own channels, read from the file itself."""

import json
from pathlib import Path
from typing import Any, Final

from mcap.reader import make_reader

_TYPES: Final[dict[str, tuple[type, ...]]] = {
    "object": (dict,),
    "array": (list,),
    "string": (str,),
    "boolean": (bool,),
    "integer": (int,),
    "number": (int, float),
}
_KNOWN: Final = {
    *("type", "title", "description", "properties", "items", "enum", "minimum", "maximum")
}


def contradictions(schema: dict[str, Any], value: Any, place: str) -> list[str]:
    """Where `value` is not as `schema` says, in the words of JSON Schema that viewers know."""
    assert set(schema) <= _KNOWN, f"{place}: {set(schema) - _KNOWN}"
    kinds = _TYPES[schema["type"]]
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        return [f"{place}: {value!r} is no {schema['type']}"]
    if isinstance(value, dict):
        unknown = [f"{place}.{name}: undeclared" for name in value.keys() - schema["properties"]]
        inner = schema["properties"].items()
        return unknown + [
            text
            for name, part in inner
            if name in value
            for text in contradictions(part, value[name], f"{place}.{name}")
        ]
    if isinstance(value, list):
        return [
            text for one in value for text in contradictions(schema["items"], one, place + "[]")
        ]
    outside = not schema.get("minimum", value) <= value <= schema.get("maximum", value)
    if outside or value not in schema.get("enum", [value]):
        return [f"{place}: {value!r} is not one of those declared"]
    return []


def recording_contradictions(path: Path) -> tuple[dict[str, int], list[str]]:
    """How many messages each topic has, and what is not as its channel says."""
    counts: dict[str, int] = {}
    found: list[str] = []
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
            if schema is None:
                if not channel.metadata.get("description"):
                    found.append(f"{channel.topic}: neither schema nor description")
                continue
            assert channel.message_encoding == "json"
            value = json.loads(message.data, parse_constant=float)
            found += contradictions(json.loads(schema.data), value, channel.topic)
    return counts, sorted(set(found))
