"""Messages to bytes and back: what comes in is sound as a whole, or the reason is told."""

import json
import math
import tracemalloc
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.messages import (
    COMMANDS,
    TELEMETRY,
    Answer,
    Arm,
    Event,
    Load,
    Message,
    Refusal,
    Setpoint,
    SetpointRefused,
    Status,
    Stop,
    Tip,
    tag,
    verb,
)
from daemon.remote.wire import (
    Format,
    WireError,
    decode,
    decode_one_of,
    encode,
    encoding_of,
    json_schema,
    most_bytes,
    requested_format,
)
from tests.daemon.remote.rig import FakeRobot, setpoint, tip

FORMATS = list(Format)
PACK = {Format.MSGPACK: msgspec.msgpack.encode, Format.JSON: msgspec.json.encode}
finite = st.floats(allow_nan=False, allow_infinity=False)
plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | finite | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=8,
)


def problem(payload: bytes, kind: type[Message], form: Format = Format.MSGPACK) -> WireError:
    with pytest.raises(WireError) as caught:
        decode(payload, kind, form)
    return caught.value


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("message", [tip(), FakeRobot().status(), setpoint(3), Stop(request="7")])
def test_a_message_comes_back_as_it_went(message: Message, form: Format) -> None:
    assert decode(encode(message, form), type(message), form) == message


@given(st.dictionaries(st.text(max_size=8), plain, max_size=4), st.sampled_from(FORMATS))
def test_what_a_trajectory_may_hold_comes_back_as_it_went(
    trajectory: dict[str, Any], form: Format
) -> None:
    load = Load(trajectory=trajectory, cycles=3)
    assert decode(encode(load, form), Load, form) == load


@given(st.binary(max_size=200), st.sampled_from(FORMATS), st.sampled_from([*COMMANDS, Setpoint]))
def test_no_bytes_get_past_it_but_a_message(
    payload: bytes, form: Format, kind: type[Message]
) -> None:
    try:
        assert isinstance(decode(payload, kind, form), kind)
    except WireError as error:
        assert error.name in ("bad_payload", "bad_version")
        assert str(error)


@given(plain | st.dictionaries(st.sampled_from(["type", "token", "sequence", "request"]), plain))
def test_no_structure_gets_past_it_but_a_message(structure: Any) -> None:
    for form in FORMATS:
        for kind in (Stop, Setpoint, Load):
            try:
                assert isinstance(decode(PACK[form](structure), kind, form), kind)
            except WireError as error:
                assert str(error)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"position_mm": [1.0, "X", 3.0]}, "$.position_mm[1]"),
        ({"valid_s": "X"}, "$.valid_s"),
        ({"velocity_mm_s": [0.0, 0.0, "X"]}, "$.velocity_mm_s[2]"),
        ({"unknown": {"deep": [{"deeper": "X"}]}}, "$.unknown.deep[0].deeper"),
    ],
)
def test_a_number_that_is_not_finite_is_refused_with_its_place(
    number: float, change: dict[str, Any], path: str
) -> None:
    message = msgspec.to_builtins(setpoint(1)) | _with(number, change)
    error = problem(msgspec.msgpack.encode(message), Setpoint)
    assert error.name == "bad_payload"
    assert str(error) == f"{number} is not a finite number at {path}"


def _with(number: float, value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _with(number, inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_with(number, inner) for inner in value]
    return number if value == "X" else value


def test_a_number_that_is_not_finite_is_refused_in_a_trajectory_too() -> None:
    load = Load(trajectory={"points": [[1.0, {"mm": math.inf}]]}, request="12")
    error = problem(encode(load), Load)
    assert str(error) == "inf is not a finite number at $.trajectory.points[0][1].mm"
    assert error.request == "12"


@pytest.mark.parametrize("text", [b'{"a": NaN}', b'{"a": Infinity}', b'{"a": 1e999}'])
def test_json_has_no_way_round_that(text: bytes) -> None:
    payload = b'{"type":"load/1","trajectory":' + text + b"}"
    assert problem(payload, Load, Format.JSON).name == "bad_payload"


@pytest.mark.parametrize(
    ("content", "name", "text"),
    [
        ({"type": "arm/2", "request": "q"}, "bad_version", "version 1 of 'arm' is spoken here"),
        ({"type": "arm"}, "bad_version", "not none"),
        ({"type": "stop/1"}, "bad_payload", "'arm/1' belongs here, not 'stop/1'"),
        ({"request": "q"}, "bad_payload", r"\$.type is missing: 'arm/1' belongs here"),
        ({"type": 1}, "bad_payload", r"\$.type is missing"),
        ({"type": "arm/1", "token": 3}, "bad_payload", r"Expected str, got int - at \$.token"),
        ([], "bad_payload", "a message is a map"),
        (None, "bad_payload", "a message is a map"),
    ],
)
def test_the_reason_is_told(content: Any, name: str, text: str) -> None:
    for form in FORMATS:
        with pytest.raises(WireError, match=text) as caught:
            decode(PACK[form](content), Arm, form)
        assert caught.value.name == name
        if isinstance(content, dict) and "request" in content:
            assert caught.value.request == "q"


def test_empty_broken_deep_and_long_payloads_are_refused() -> None:
    assert str(problem(b"", Arm)) == "the payload is empty"
    assert "this is no application/json" in str(problem(b"{", Arm, Format.JSON))
    assert "this is no application/msgpack" in str(problem(b"\xc1", Arm))
    assert str(problem(b"\x91" * 4000, Arm)) == "nested too deeply"
    deep: list[Any] = []
    for _ in range(100):
        deep = [deep]
    load = Load(trajectory={"deep": deep})
    assert "nested too deeply" in str(problem(encode(load), Load))
    long = encode(Arm(request="x" * 5000))
    assert str(problem(long, Arm)) == f"{len(long)} bytes are more than 4096"


def test_many_places_under_a_long_key_take_no_more_room_than_others() -> None:
    """The path of each would be as long as the key: a gigabyte, and a second of the loop."""
    load = Load(trajectory={"k" * 32000: [True] * 32000})
    payload = encode(load)
    tracemalloc.start()
    try:
        assert decode(payload, Load) == load
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak_bytes < 20 * len(payload)


def test_a_long_key_is_told_cut_off() -> None:
    load = Load(trajectory={"k" * 32000: [math.nan]})
    error = problem(encode(load), Load)
    assert str(error) == f"nan is not a finite number at $.trajectory.{'k' * 64}[0]"


@pytest.mark.parametrize("wrong", [math.nan, 2**64 - 1, b"", [math.inf]])
@pytest.mark.parametrize("place", [0, 17, 99])
def test_one_wrong_thing_in_a_long_list_is_found(wrong: Any, place: int) -> None:
    points: list[Any] = [0.5, 7] * 50
    points[place] = wrong
    error = problem(encode(Load(trajectory={"points": points})), Load)
    assert f"at $.trajectory.points[{place}]" in str(error)


def test_only_a_load_may_be_long() -> None:
    points = [[float(n), 0.0, 100.0] for n in range(1500)]
    load = Load(trajectory={"points": points})
    assert most_bytes(Stop) < len(encode(load)) < most_bytes(Load)
    assert decode(encode(load), Load) == load


@pytest.mark.parametrize("form", FORMATS)
def test_a_path_of_as_many_places_as_are_answered_can_be_read(form: Format) -> None:
    at = [n / 7.0 for n in range(1000)]
    path = {"t_s": at, "u": [[x] * 6 for x in at], "tip_mm": [[x] * 3 for x in at]}
    answer = Answer(request="1", state="armed", path=path)
    assert decode(encode(answer, form), Answer, form) == answer


def test_bytes_and_dates_have_no_place() -> None:
    message = {"type": "load/1", "trajectory": {"raw": b"abc"}}
    assert "a bytes has no place at $.trajectory.raw" in str(
        problem(msgspec.msgpack.encode(message), Load)
    )
    extension = {"type": "load/1", "trajectory": {"x": msgspec.msgpack.Ext(5, b"abc")}}
    assert "has no place" in str(problem(msgspec.msgpack.encode(extension), Load))


def test_fields_that_a_newer_client_has_added_are_ignored() -> None:
    content = {"type": "arm/1", "request": "q", "gently": True}
    assert decode(msgspec.msgpack.encode(content), Arm) == Arm(request="q")


def test_where_several_kinds_come_the_tag_says_which() -> None:
    refused = SetpointRefused(sequence=3, reason="late", user="alice")
    assert decode_one_of(encode(refused), (Event, SetpointRefused)) == refused
    with pytest.raises(WireError, match="'event/1' or 'setpoint_refused/1' belongs here"):
        decode_one_of(encode(tip()), (Event, SetpointRefused))


def test_the_encoding_says_format_kind_and_version() -> None:
    assert encoding_of(Tip) == "application/msgpack;tentacled.tip/1"
    assert encoding_of(tip(), Format.JSON) == "application/json;tentacled.tip/1"
    assert requested_format("application/json") is Format.JSON
    assert requested_format("application/json;tentacled.tip/1") is Format.JSON
    for other in ("application/msgpack", "zenoh/bytes", "", None):
        assert requested_format(other) is Format.MSGPACK


@pytest.mark.parametrize("kind", [*TELEMETRY, *COMMANDS, Setpoint])
def test_a_schema_is_an_object_at_its_root_and_knows_the_tag(kind: type[Message]) -> None:
    schema = json_schema(kind)
    json.dumps(schema)
    assert schema["type"] == "object"
    assert schema["properties"]["type"]["enum"] == [kind.__struct_config__.tag]
    for reference in _references(schema):
        assert reference.removeprefix("#/$defs/") in schema["$defs"]


def _references(schema: Any) -> list[str]:
    if isinstance(schema, dict):
        own = [schema["$ref"]] if "$ref" in schema else []
        return own + [found for inner in schema.values() for found in _references(inner)]
    if isinstance(schema, list):
        return [found for inner in schema for found in _references(inner)]
    return []


def test_each_command_has_a_verb_of_its_own() -> None:
    assert len({verb(kind) for kind in COMMANDS}) == len(COMMANDS)
    assert verb(Stop()) == "stop"
    assert Status in TELEMETRY


odd = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.sampled_from([2**63, 2**64 - 1, 2**64, -(2**63), -(2**64), 10**400])
    | st.floats()
    | st.text(st.characters(), max_size=8)
    | st.sampled_from(["\ud800", "\x00", "1e400"]),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3)
    ),
    max_leaves=8,
)


@given(st.data(), st.sampled_from([*COMMANDS, Setpoint]))
def test_what_is_believed_can_be_said_again_and_what_is_not_can_be_refused(
    data: st.DataObject, kind: type[Message]
) -> None:
    """Whatever stands in whichever field: what was let in is answered, recorded and published."""
    fields = {name: data.draw(odd) for name in kind.__struct_fields__ if data.draw(st.booleans())}
    payload = json.dumps({"type": tag(kind), **fields}).encode()
    try:
        message = decode(payload, kind, Format.JSON)
    except WireError as error:
        refusal = Refusal(request=error.request, state="", name=error.name, text=str(error))
        for form in FORMATS:
            assert decode(encode(refusal, form), Refusal, form) == refusal
    else:
        for form in FORMATS:
            assert decode(encode(message, form), kind, form) == message


@pytest.mark.parametrize("sequence", [2**63, 2**64, 10**30, -(2**63) - 1])
def test_a_number_that_msgpack_cannot_hold_is_refused_by_its_place(sequence: int) -> None:
    payload = json.dumps(
        {"type": "setpoint/1", "token": "", "sequence": sequence, "position_mm": [], "valid_s": 1}
    ).encode()
    error = problem(payload, Setpoint, Format.JSON)
    assert error.name == "bad_payload"
    assert str(error).endswith("at $.sequence")


def test_an_integer_of_thousands_of_digits_is_refused() -> None:
    payload = b'{"type": "setpoint/1", "sequence": ' + b"9" * 900 + b"}"
    assert problem(payload, Setpoint, Format.JSON).name == "bad_payload"
    payload = b'{"type": "load/1", "trajectory": {"n": ' + b"9" * 5000 + b"}}"
    assert problem(payload, Load, Format.JSON).name == "bad_payload"
