"""Messages to bytes and back. What comes in is believed only when all of it is sound."""

import math
from contextlib import suppress
from enum import Enum
from functools import cache
from typing import Any, Final, TypeVar, cast

import msgspec

from daemon.messages import (
    Command,
    Load,
    Message,
    Obstacles,
    Setpoint,
    Surround,
    Teleoperate,
    Upload,
    tag,
)

M = TypeVar("M", bound=Message)

LARGEST_ANSWER_BYTES: Final = 262144
_MOST_BYTES: Final[dict[type[Message], int]] = {
    Load: 65536,
    Teleoperate: 16384,
    Upload: 67584,
    Surround: 65536,
    Setpoint: 1024,
    Obstacles: 4096,
}
_MOST_COMMAND_BYTES: Final = 4096
LARGEST_MESSAGE_BYTES: Final = 67584
"""An upload's part in base64, and what is said beside it."""
_OF_BYTES: Final[dict[type[Message], str]] = {Upload: "data"}
"""Under which key bytes may stand that are no text."""
_DEEPEST: Final = 16
_LONGEST_KEY_TOLD: Final = 64
_LARGEST_INT: Final = 2**63 - 1
"""In JSON a number may have any size; in msgpack, and in most languages, it may not."""
_NUMBERS: Final = frozenset((int, float))
_LONG_LIST: Final = 32


class Format(Enum):
    """How a message is written."""

    MSGPACK = "application/msgpack"
    JSON = "application/json"


class WireError(ValueError):
    """A payload that is not what it should be. `name` is that of a Refusal."""

    def __init__(self, name: str, text: str, request: str = "") -> None:
        super().__init__(text)
        self.name = name
        self.request = request
        """The sender's identifier of the request, where it could be read."""


def requested_format(encoding: object) -> Format:
    """The format that an encoding names; msgpack where it names none."""
    return Format.JSON if str(encoding).startswith(Format.JSON.value) else Format.MSGPACK


def encoding_of(kind: type[Message] | Message, form: Format = Format.MSGPACK) -> str:
    """What a message's encoding says: format, kind and version."""
    return _encoding(kind if isinstance(kind, type) else type(kind), form)


@cache
def _encoding(kind: type[Message], form: Format) -> str:
    return f"{form.value};tentacled.{tag(kind)}"


def encode(message: Message, form: Format = Format.MSGPACK) -> bytes:
    """The message as bytes."""
    if form is Format.JSON:
        return msgspec.json.encode(message)
    return msgspec.msgpack.encode(message)


def most_bytes(kind: type[Message]) -> int:
    """The size above which a message is not looked at, by the daemon or by who has asked it."""
    fallback = _MOST_COMMAND_BYTES if issubclass(kind, Command) else LARGEST_ANSWER_BYTES
    return _MOST_BYTES.get(kind, fallback)


def decode(payload: bytes, kind: type[M], form: Format = Format.MSGPACK) -> M:
    """The message of this kind in `payload`. Raises WireError."""
    return cast(M, decode_one_of(payload, (kind,), form))


def decode_one_of(
    payload: bytes, kinds: tuple[type[Message], ...], form: Format = Format.MSGPACK
) -> Message:
    """The message in `payload`, which is one of these kinds. Raises WireError."""
    raw = _raw(payload, max(most_bytes(kind) for kind in kinds), form)
    request = _request(raw)
    kind = _kind(raw.get("type"), kinds, request)
    if found := _problem(raw, _OF_BYTES.get(kind)):
        raise WireError("bad_payload", f"{found[1]} at ${found[0]}", request)
    try:
        return msgspec.convert(raw, kind)
    except (msgspec.ValidationError, OverflowError) as error:
        raise WireError("bad_payload", str(error).replace("`", ""), request) from None


def request_in(payload: bytes) -> str:
    """The sender's identifier of the request, where there is one in whatever was sent."""
    for form in (Format.JSON, Format.MSGPACK):
        with suppress(WireError):
            return _request(_raw(payload, _MOST_COMMAND_BYTES, form))
    return ""


def _request(raw: dict[str, Any]) -> str:
    """It comes back in the answer, and so must be something that can be written."""
    request = raw.get("request", "")
    return request[:64] if isinstance(request, str) and _is_text(request) else ""


def _raw(payload: bytes, most: int, form: Format) -> dict[str, Any]:
    if not payload:
        raise WireError("bad_payload", "the payload is empty")
    if len(payload) > most:
        raise WireError("bad_payload", f"{len(payload)} bytes are more than {most}")
    try:
        decoder = msgspec.json.decode if form is Format.JSON else msgspec.msgpack.decode
        raw = decoder(payload)
    except RecursionError:
        raise WireError("bad_payload", "nested too deeply") from None
    except (msgspec.MsgspecError, UnicodeDecodeError, TypeError, ValueError) as error:
        raise WireError("bad_payload", f"this is no {form.value}: {error}") from None
    if not isinstance(raw, dict):
        raise WireError("bad_payload", "a message is a map")
    return raw


def _kind(wire_tag: object, kinds: tuple[type[Message], ...], request: str) -> type[Message]:
    for kind in kinds:
        if wire_tag == tag(kind):
            return kind
    spoken = " or ".join(f"'{tag(kind)}'" for kind in kinds)
    if not isinstance(wire_tag, str) or not _is_text(wire_tag):
        raise WireError("bad_payload", f"$.type is missing: {spoken} belongs here", request)
    name, _, version = wire_tag[:64].partition("/")
    for kind in kinds:
        ours, _, our_version = tag(kind).partition("/")
        if name == ours:
            text = f"version {our_version} of '{ours}' is spoken here, not {version or 'none'}"
            raise WireError("bad_version", text, request)
    raise WireError("bad_payload", f"{spoken} belongs here, not '{wire_tag[:64]}'", request)


def _problem(value: object, of_bytes: str | None, depth: int = 0) -> tuple[str, str] | None:
    """The first thing that must not be anywhere in a message, with where it is from here. of_bytes:
    the one key of the message itself under which bytes may stand.

    A path is put together on the way back only: those of all places, under a long key, would take
    a gigabyte. A message may have 65 thousand places, and the loop waits for this.
    """
    if depth > _DEEPEST:
        return "", "nested too deeply"
    if isinstance(value, dict):
        for key, inner in value.items():
            if not isinstance(key, str) or not _is_text(key):
                return "", "a map's keys are words, which is not so"
            if key == of_bytes and isinstance(inner, bytes):
                continue
            if found := _problem(inner, None, depth + 1):
                return f".{key[:_LONGEST_KEY_TOLD]}{found[0]}", found[1]
    elif isinstance(value, list):
        inmost = depth == _DEEPEST
        if len(value) >= _LONG_LIST and not inmost and _are_sound_numbers(value):
            return None
        for n, inner in enumerate(value):
            if found := _problem(inner, None, depth + 1):
                return f"[{n}]{found[0]}", found[1]
    elif text := _wrong(value):
        return "", text
    return None


def _are_sound_numbers(values: list[Any]) -> bool:
    """Whether a list has nothing but numbers that may be there: a long one mostly is so, and to
    look at each number by itself takes ten times as long."""
    return (
        _NUMBERS.issuperset(map(type, values))
        and min(values) >= -_LARGEST_INT
        and max(values) <= _LARGEST_INT
        and all(map(math.isfinite, values))
    )


def _wrong(value: object) -> str:
    """What is wrong with a value that holds no others; empty: nothing."""
    if isinstance(value, float):
        return "" if math.isfinite(value) else f"{value} is not a finite number"
    if isinstance(value, int):
        in_range = -_LARGEST_INT <= value <= _LARGEST_INT
        return "" if in_range else "a number with so many digits has no place"
    if isinstance(value, str):
        return "" if _is_text(value) else "it is not text"
    return "" if value is None else f"a {type(value).__name__} has no place"


def _is_text(value: str) -> bool:
    """Whether it can be written again: halves of surrogate pairs cannot."""
    try:
        value.encode()
    except UnicodeEncodeError:
        return False
    return True


def json_schema(kind: type[Message]) -> dict[str, Any]:
    """The JSON Schema of a kind of message, its root an object and not a reference."""
    schema = msgspec.json.schema(kind)
    parts: dict[str, Any] = schema.pop("$defs", {})
    root = parts.pop(kind.__name__)
    flat = {"$schema": "https://json-schema.org/draft/2020-12/schema", **root}
    return {**flat, "$defs": parts} if parts else flat
