"""What a recording contains: one channel per kind of telemetry, and the devices' raw bytes.

Telemetry is JSON with a JSON Schema, which viewers read. The schemas keep to what viewers
understand: a root of type object, no references, one type per field. A viewer that gets null for a
number, or two types for a field, gives the whole channel up: what is not known is left out.

Raw channels have the message encoding `x-raw` and no schema; a description of their bytes is in
their metadata.

A message's log time is the date; the difference to the daemon's monotonic `t_ns` is in the
recording's metadata.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, Final

import msgspec

from daemon.messages import (
    RECORDED,
    Axes,
    Body,
    Event,
    InternalError,
    Loop,
    Message,
    ObstaclesTaken,
    PathPlanned,
    Risk,
    Status,
    SurroundingsChanged,
    Tip,
    tag,
)
from drivers.can.frame import CAN_FRAME, FRAME_BYTES, CanFrame, unpack_frame

TOPICS: Final[dict[type[Message], str]] = {
    Status: "/state",
    Tip: "/tip",
    Axes: "/axes",
    Risk: "/risk",
    Loop: "/loop",
    Event: "/event",
    InternalError: "/internal_error",
    Body: "/body",
    SurroundingsChanged: "/surroundings_changed",
    ObstaclesTaken: "/obstacles_taken",
    PathPlanned: "/path_planned",
}
MESSAGES: Final[dict[str, type[Message]]] = {topic: kind for kind, topic in TOPICS.items()}
assert set(TOPICS) == set(RECORDED)

TIP_POSE: Final = "/tip_pose"
RAW_TRACKER: Final = "/raw/tracker"
RAW_CAN: Final = "/raw/can/"

CONTROL_TOPICS: Final = ("/tip", "/axes", "/risk", "/event")
"""What was measured, decided, sent and told: the same in two runs of one experiment."""

# Quotes within strings are escaped, so that these stand nowhere but between two fields. A number
# that is none is null too, and a vector with such a number is left out whole.
_NULL: Final = rb'(?:null|\[[^"{}]*null[^"{}]*\])'
_NULL_FIELD: Final = re.compile(rb',"\w+":' + _NULL)
_NULL_FIRST: Final = re.compile(rb'(?<=\{)"\w+":' + _NULL + rb",?")

_FROM_TRACKER: Final = b"<"
_TO_TRACKER: Final = b">"
_DIRECTIONS: Final = {"from_device": _FROM_TRACKER, "to_device": _TO_TRACKER}
_DIRECTION_NAMES: Final = {mark[0]: name for name, mark in _DIRECTIONS.items()}

CAN_RECORD: Final = struct.Struct("<Q" + CAN_FRAME.format.lstrip("<"))
_CAN_TIME: Final = struct.Struct("<Q")
_NS_PER_S: Final = 1_000_000_000


_TRACKER_BYTES: Final = (
    "One byte, < (from the tracker) or > (to it), then the bytes as they were seen on the line."
)
_CAN_BYTES: Final = (
    "Little-endian records of 24 bytes, one per frame: monotonic time in ns (u64), then the Linux "
    "kernel's struct can_frame: identifier and flags (u32), length (u8), 3 bytes of padding, "
    "8 bytes of data. The difference of monotonic time to the date is wall_offset_ns in the "
    "metadata record 'run'."
)


@dataclass(frozen=True)
class ChannelFormat:
    """How a channel's messages are to be read, by a schema or in words."""

    message_encoding: str
    schema_name: str = ""
    schema: bytes = field(default=b"", repr=False)
    description: str = ""


def channel_format(topic: str) -> ChannelFormat:
    """The format of a topic's messages. Raises ValueError where the topic is unknown."""
    kind = MESSAGES.get(topic)
    if kind is not None:
        return ChannelFormat("json", f"tentacled.{tag(kind)}", _as_bytes(viewer_schema(kind)))
    if topic == TIP_POSE:
        return ChannelFormat("json", "foxglove.PoseInFrame", _as_bytes(_POSE_IN_FRAME))
    if topic == RAW_TRACKER:
        return ChannelFormat("x-raw", description=_TRACKER_BYTES)
    if topic.startswith(RAW_CAN) and len(topic) > len(RAW_CAN):
        return ChannelFormat("x-raw", description=_CAN_BYTES)
    raise ValueError(f"there is no channel {topic!r} in a recording")


def viewer_schema(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """A struct's JSON Schema in the words that viewers understand."""
    schema = msgspec.json.schema(kind)
    definitions = schema.get("$defs", {})
    return _simplified(schema, definitions)


def message_time_ns(message: Message) -> int:
    """When a telemetry message is from, on the monotonic clock."""
    t_ns: int = message.t_ns  # type: ignore[attr-defined]
    return t_ns


def telemetry_payload(message: Message) -> bytes:
    """A telemetry message as it is recorded: JSON without the fields that are not known."""
    payload = _ENCODER.encode(message)
    for kind in (_NULL_FIELD, _NULL_FIRST):
        if b"null" not in payload:  # most have none after the first
            break
        payload = kind.sub(b"", payload)
    return payload


def tracker_payload(direction: str, data: bytes) -> bytes:
    """A message of /raw/tracker. direction: `from_device` or `to_device`."""
    return _DIRECTIONS[direction] + data


def read_tracker_payload(payload: bytes) -> tuple[str, bytes]:
    """Direction and bytes of a message of /raw/tracker. Raises ValueError."""
    name = _DIRECTION_NAMES.get(payload[0]) if payload else None
    if name is None:
        raise ValueError("a message of /raw/tracker begins with '<' or '>'")
    return name, payload[1:]


def read_can_payload(payload: bytes) -> Iterator[tuple[int, CanFrame]]:
    """Monotonic time in ns and frame of each record of a /raw/can message. Raises ValueError."""
    size = CAN_RECORD.size
    if len(payload) % size:
        raise ValueError(f"a message of {RAW_CAN} is a multiple of {size} bytes")
    for offset in range(0, len(payload), size):
        (t_ns,) = _CAN_TIME.unpack_from(payload, offset)
        yield t_ns, unpack_frame(payload[offset + size - FRAME_BYTES : offset + size])


def tip_pose(payload: bytes, wall_ns: int) -> bytes | None:
    """What a 3-D viewer wants of a message of /tip; None where the tip is not known. Metres."""
    try:
        tip = _TIP_DECODER.decode(payload)
    except msgspec.MsgspecError:  # a number that is none, for example
        return None
    if tip.tip_mm is None or len(tip.tip_mm) != 3:
        return None
    x, y, z = tip.tip_mm
    w, i, j, k = tip.quaternion or (1.0, 0.0, 0.0, 0.0)
    sec, nsec = divmod(wall_ns, _NS_PER_S)
    pose = _Pose(_Vector3(x * 1e-3, y * 1e-3, z * 1e-3), _Quaternion(i, j, k, w))
    return _ENCODER.encode(_PoseInFrame(_Time(sec, nsec), "base", pose))


class _TipPose(msgspec.Struct):
    """The part of a Tip that a pose is made of."""

    tip_mm: list[float] | None = None
    quaternion: tuple[float, float, float, float] | None = None


_TIP_DECODER: Final = msgspec.json.Decoder(_TipPose)


class _Time(msgspec.Struct, gc=False):
    sec: int
    nsec: int


class _Vector3(msgspec.Struct, gc=False):
    x: float
    y: float
    z: float


class _Quaternion(msgspec.Struct, gc=False):
    x: float
    y: float
    z: float
    w: float


class _Pose(msgspec.Struct, gc=False):
    position: _Vector3
    orientation: _Quaternion


class _PoseInFrame(msgspec.Struct, gc=False):
    """What `_POSE_IN_FRAME` describes."""

    timestamp: _Time
    frame_id: str
    pose: _Pose


_ENCODER: Final = msgspec.json.Encoder()


def _simplified(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    """References replaced by what they mean, `x or null` by x, enumerations given a type."""
    if "$ref" in schema:
        return _simplified(definitions[schema["$ref"].rsplit("/", 1)[1]], definitions)
    if "anyOf" in schema:
        (present,) = (option for option in schema["anyOf"] if option.get("type") != "null")
        described = {"description": "left out where it is not known"}
        return {**described, **_simplified(present, definitions)}
    kept: dict[str, Any] = {key: schema[key] for key in ("title", "description") if key in schema}
    if "enum" in schema:
        return {**kept, "type": "string", "enum": schema["enum"]}
    kept["type"] = schema["type"]
    if schema["type"] == "object":
        fields = schema["properties"].items()
        kept["properties"] = {name: _simplified(inner, definitions) for name, inner in fields}
    elif schema["type"] == "array":
        kept["items"] = _simplified(schema["items"], definitions)
    return kept


def _numbers(title: str, names: str) -> dict[str, Any]:
    fields = {name: {"type": "number"} for name in names}
    return {"title": title, "type": "object", "properties": fields}


_POSE_IN_FRAME: Final = {
    "title": "foxglove.PoseInFrame",
    "type": "object",
    "properties": {
        "timestamp": {
            "title": "time",
            "type": "object",
            "properties": {
                "sec": {"type": "integer", "minimum": 0},
                "nsec": {"type": "integer", "minimum": 0, "maximum": _NS_PER_S - 1},
            },
        },
        "frame_id": {"type": "string"},
        "pose": {
            "title": "foxglove.Pose",
            "type": "object",
            "properties": {
                "position": _numbers("foxglove.Vector3", "xyz"),
                "orientation": _numbers("foxglove.Quaternion", "xyzw"),
            },
        },
    },
}


def _as_bytes(schema: dict[str, Any]) -> bytes:
    return msgspec.json.encode(schema)
