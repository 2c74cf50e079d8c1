"""Writes `docs/api.md` from the code: `python -m tests.daemon.api.reference > docs/api.md`."""

import inspect
from collections.abc import Iterator
from types import ModuleType

import msgspec
from pydantic import BaseModel

from daemon import api

HEAD = """\
# What others may build on

Version {version}. Everything is imported from `daemon.api`. While the version stays, names, fields
and arguments are only added. A package names the version that it is written for,
`Kind(..., api={version})`, and is refused by name where it is another one.

Generated: `python -m tests.daemon.api.reference > docs/api.md`.
"""


def reference() -> str:
    """The page."""
    parts = [HEAD.format(version=api.API_VERSION)]
    for name in api.__all__:
        value = getattr(api, name)
        if isinstance(value, ModuleType):
            parts += ["\n## messages\n\n", *(_message(*one) for one in _messages(value))]
        elif isinstance(value, type):
            parts.append(_class(name, value))
        elif inspect.isfunction(value):
            member = f"{name}{_arguments(value)}"
            parts.append(f"\n## {name}\n\n{_first(value)}\n\n```python\n{member}\n```\n")
    return "".join(parts)


def _class(name: str, value: type) -> str:
    lines = [f"\n## {name}\n\n{_first(value)}\n"]
    members = [*_fields(value), *_methods(value)]
    if members:
        lines += ["\n```python\n", *(f"{member}\n" for member in members), "```\n"]
    return "".join(lines)


def _fields(value: type) -> Iterator[str]:
    if issubclass(value, BaseModel):
        for name, field in value.model_fields.items():
            kind = str(value.__annotations__.get(name, "")) or "inherited"
            default = "" if field.is_required() else " = ..."
            yield f"{name}: {kind if kind.isidentifier() else '...'}{default}"
        return
    parameters = getattr(value, "__annotations__", {})
    defaults = getattr(value, "_field_defaults", {})
    if hasattr(value, "_fields") or hasattr(value, "__dataclass_fields__"):
        for name in parameters:
            if not name.startswith("_"):
                kept = hasattr(value, "__dataclass_fields__") and hasattr(value, name)
                yield f"{name}{' = ...' if name in defaults or kept else ''}"


def _methods(value: type) -> Iterator[str]:
    for name, member in sorted(vars(value).items()):
        public = not name.startswith("_") or name == "__init__"
        ours = getattr(member, "__module__", "").partition(".")[0] not in {"typing", "pydantic"}
        if not public or not ours or name.startswith("model_"):
            continue
        if isinstance(member, property):
            yield f"{name}  # property"
        elif isinstance(member, classmethod | staticmethod):
            yield f"{name}{_arguments(member.__func__)}  # of the class"
        elif inspect.isfunction(member):
            if name == "__init__" and hasattr(value, "__dataclass_fields__"):
                continue
            yield f"{name}{_arguments(member)}"


def _arguments(function: object) -> str:
    """Names and which may be left out; how types are spelled is no promise."""
    signature = inspect.signature(function)  # type: ignore[arg-type]
    told, keyword = [], False
    for parameter in signature.parameters.values():
        if parameter.name in {"self", "cls"}:
            continue
        if parameter.kind is parameter.KEYWORD_ONLY and not keyword:
            keyword = True
            told.append("*")
        star = "*" * (parameter.kind is parameter.VAR_POSITIONAL)
        star += "**" * (parameter.kind is parameter.VAR_KEYWORD)
        optional = "=..." if parameter.default is not parameter.empty else ""
        told.append(f"{star}{parameter.name}{optional}")
    return f"({', '.join(told)})"


def _messages(module: ModuleType) -> Iterator[tuple[str, type[msgspec.Struct]]]:
    for name, value in vars(module).items():
        if isinstance(value, type) and issubclass(value, msgspec.Struct):
            yield name, value


def _message(name: str, value: type[msgspec.Struct]) -> str:
    fields = ", ".join(
        f"{field.encode_name}{'' if field.required else ' = ...'}"
        for field in msgspec.structs.fields(value)
    )
    tag = value.__struct_config__.tag
    return f"- `{name}`{f' ({tag})' if tag else ''}: {fields or 'nothing'}\n"


def _first(value: object) -> str:
    lines = (inspect.getdoc(value) or "").strip().split("\n\n")[0]
    return " ".join(lines.split())


if __name__ == "__main__":
    print(reference(), end="")
