"""The page of keys and messages."""

import ast
import inspect
from collections.abc import Iterator
from typing import Any, Final

import msgspec

from daemon import messages
from daemon.messages import COMMANDS, Message, answers, commands, status, tag, telemetry, verb
from daemon.messages import base as message_base
from daemon.remote.keys import TELEMETRY_KEYS, Keys
from daemon.remote.wire import json_schema
from tests.docs.reference.markdown import plain, schema_table, table

_HEAD = """\
# Keys and messages

What is said over zenoh. How to use it, with an example without this package:
[Remote API](../remote-api.md).

"""
_MODULES: Final = (message_base, status, telemetry, commands, answers)


def messages_page() -> str:
    """The page."""
    keys = Keys("robot").root.replace("robot", "ROBOT")
    published = [
        (f"`{keys}/{name}`", "publish, query", ", ".join(_link(kind) for kind in kinds))
        for name, kinds in TELEMETRY_KEYS.items()
    ]
    asked = [
        (f"`{keys}/cmd/USER/{verb(kind)}`", "query", f"{_link(kind)} → `Answer` or `Refusal`")
        for kind in COMMANDS
    ]
    more = [
        (f"`{keys}/setpoint/USER`", "put", _link(messages.Setpoint)),
        (f"`{keys}/obstacles/USER`", "put", _link(messages.Obstacles)),
        (f"`{keys}/whoami/USER`", "query", _link(messages.WhoAmI)),
        (f"`{keys}/events`", "query", _link(messages.Events)),
        (f"`{keys}/surroundings`", "query", _link(messages.Surroundings)),
        (f"`{keys}/surroundings/N`", "query", "part N of the mesh's bytes"),
        (f"`{keys}/schema/KIND`", "query", "JSON Schema of a kind of message; `*`: of all"),
        (f"`{keys}/alive`", "liveliness token", "the daemon's process is there"),
    ]
    parts = [
        _HEAD,
        "## Keys\n\n",
        table(("key", "how", "message"), [*published, *asked, *more]),
        "\n## Messages\n\n",
        f"{plain(messages.__doc__ or '')}\n",
    ]
    told = _field_texts()
    for name, kind in _structs():
        parts += [f"\n### {name}\n\n", *_section(name, kind, told)]
    return "".join(parts)


def _section(
    name: str, kind: type[msgspec.Struct], told: dict[str, dict[str, str]]
) -> Iterator[str]:
    mark = f"`{tag(kind)}`. " if issubclass(kind, Message) else ""
    yield f"{mark}{plain(inspect.getdoc(kind) or '')}\n\n"
    schema = _schema(kind)
    texts = {
        key: text
        for base in reversed(kind.__mro__)
        for key, text in told.get(base.__name__, {}).items()
    }
    if schema.get("properties"):
        yield schema_table(schema, told=texts)
    elif not mark:
        yield f"See {name}.\n"


def _schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    if issubclass(kind, Message):
        return json_schema(kind)
    schema = msgspec.json.schema(kind)
    found: dict[str, Any] = schema["$defs"][kind.__name__]
    return found


def _structs() -> Iterator[tuple[str, type[msgspec.Struct]]]:
    for module in _MODULES:
        for name, value in vars(module).items():
            own = isinstance(value, type) and issubclass(value, msgspec.Struct)
            if own and value.__module__ == module.__name__ and msgspec.structs.fields(value):
                yield name, value


def _link(kind: type[msgspec.Struct]) -> str:
    if not msgspec.structs.fields(kind):
        return f"`{kind.__name__}`"
    return f"[{kind.__name__}](#{kind.__name__.lower()})"


def _field_texts() -> dict[str, dict[str, str]]:
    """By class and field: the text under it, which is in the source alone."""
    found: dict[str, dict[str, str]] = {}
    for node in [node for module in _MODULES for node in ast.parse(inspect.getsource(module)).body]:
        if isinstance(node, ast.ClassDef):
            pairs = zip(node.body, node.body[1:], strict=False)
            found[node.name] = dict(one for field, after in pairs for one in _text(field, after))
    return found


def _text(field: ast.stmt, after: ast.stmt) -> Iterator[tuple[str, str]]:
    if not isinstance(field, ast.AnnAssign) or not isinstance(after, ast.Expr):
        return
    if isinstance(after.value, ast.Constant):
        yield ast.unparse(field.target), str(after.value.value)
