"""What a recording contains can be read by viewers, and raw bytes come back as they were."""

import json
import math
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from daemon.messages import RECORDED, LeaseStatus, Risk, Status
from daemon.recording.format.can_batches import CanBatches
from daemon.recording.format.channels import (
    MESSAGES,
    TIP_POSE,
    channel_format,
    read_can_payload,
    read_tracker_payload,
    telemetry_payload,
    tip_pose,
    tracker_payload,
)
from drivers.can.frame import CanFrame
from tests.daemon.recording.schemas import contradictions
from tests.daemon.recording.synthetic_run import messages

SCALARS = {"boolean", "string", "number", "integer"}


def problems(schema: dict[str, Any], place: str) -> list[str]:
    """What Lichtblick's reader of JSON Schemas would stumble over: it takes only the plainest."""
    kind = schema.get("type")
    if kind == "object":
        inner = schema["properties"].items()
        return [text for name, part in inner for text in problems(part, f"{place}.{name}")]
    if kind == "array":
        return problems(schema["items"], f"{place}[]")
    return [] if kind in SCALARS else [f"{place}: type {kind}"]


def test_every_kind_of_telemetry_has_a_channel() -> None:
    assert set(MESSAGES.values()) == set(RECORDED)


@pytest.mark.parametrize("topic", [*MESSAGES, TIP_POSE])
def test_schemas_use_only_what_viewers_understand(topic: str) -> None:
    told = channel_format(topic)
    schema = msgspec.json.decode(told.schema)
    assert told.message_encoding == "json"
    assert schema["type"] == "object"
    assert problems(schema, topic) == []


def test_schemas_name_every_field_of_what_is_recorded() -> None:
    for message in messages(cycles=1, cycle_s=2.0):
        topic = next(topic for topic, kind in MESSAGES.items() if isinstance(message, kind))
        schema = msgspec.json.decode(channel_format(topic).schema)
        recorded = msgspec.json.decode(msgspec.json.encode(message))
        assert set(recorded) <= set(schema["properties"])


def test_what_is_not_known_is_left_out_and_comes_back_as_not_known() -> None:
    status = msgspec.structs.replace(
        next(message for message in messages(cycles=1, cycle_s=2.0) if isinstance(message, Status)),
        lease=LeaseStatus(holder=None, expires_in_s=None),
        recording='a,"b":null,{"c":null,"d":[null]',
        tip_mm=[1.0, math.nan, 2.0],
        error_mm=math.inf,
    )
    payload = telemetry_payload(status)
    assert (
        contradictions(json.loads(channel_format("/state").schema), json.loads(payload), "") == []
    )
    back = msgspec.json.decode(payload, type=Status)
    assert back == msgspec.structs.replace(status, tip_mm=None, error_mm=None)


@given(st.lists(st.none() | st.floats() | st.lists(st.floats(), max_size=3), max_size=4))
def test_any_vector_with_a_number_that_is_none_is_left_out_whole(means: list[Any]) -> None:
    risk = next(one for one in messages(cycles=1, cycle_s=2.0) if isinstance(one, Risk))
    risk = msgspec.structs.replace(risk, means_mm=means, detail='[null],"x":null')
    found = json.loads(telemetry_payload(risk))
    written = json.loads(msgspec.json.encode(risk))
    sound = "null" not in json.dumps(written.pop("means_mm"))
    assert ("means_mm" in found) == sound
    found.pop("means_mm", None)
    assert found == {name: value for name, value in written.items() if value is not None}


@pytest.mark.parametrize("topic", ["", "/nothing", "/raw/can/", "/raw/canine"])
def test_unknown_channels_are_refused(topic: str) -> None:
    with pytest.raises(ValueError, match="there is no channel"):
        channel_format(topic)


@settings(deadline=None)
@given(st.sampled_from(["from_device", "to_device"]), st.binary())
def test_tracker_bytes_come_back(direction: str, data: bytes) -> None:
    assert read_tracker_payload(tracker_payload(direction, data)) == (direction, data)


@pytest.mark.parametrize("payload", [b"", b"x123"])
def test_tracker_messages_without_direction_are_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match="begins with"):
        read_tracker_payload(payload)


FRAME = st.tuples(st.integers(0, 2**32 - 1), st.binary(max_size=8))
TRAFFIC = st.tuples(
    st.sampled_from(["can0", "can1"]), st.lists(FRAME, max_size=4), st.integers(0, 30_000_000)
)
"""Bus, frames of one moment, and how much later that is than the one before."""


@settings(deadline=None)
@given(st.lists(TRAFFIC, max_size=40))
def test_frames_come_back_from_their_batches_in_order(
    traffic: list[tuple[str, list[tuple[int, bytes]], int]],
) -> None:
    written: list[tuple[str, int, bytes]] = []
    batches = CanBatches(lambda *message: written.append(message))
    sent: dict[str, list[tuple[int, CanFrame]]] = {}
    batches.begin()
    t_ns = 0
    for bus, frames, later_ns in traffic:
        t_ns += later_ns
        if len(frames) == 1:
            batches.of(bus).received(*frames[0], t_ns)
        else:
            batches.of(bus).sent(frames, t_ns)
        for can_id, data in frames:
            sent.setdefault(f"/raw/can/{bus}", []).append((t_ns, CanFrame(can_id, data)))
    batches.flush()
    back: dict[str, list[tuple[int, CanFrame]]] = {}
    for topic, first_ns, payload in written:
        records = list(read_can_payload(payload))
        assert records[0][0] == first_ns
        assert records[-1][0] - first_ns < 50_000_000
        back.setdefault(topic, []).extend(records)
    assert back == sent


def test_frames_that_come_together_fill_a_batch_no_further_than_those_that_come_alone() -> None:
    written: list[tuple[str, int, bytes]] = []
    batches = CanBatches(lambda *message: written.append(message))
    batches.begin()
    frames = [(number, bytes(8)) for number in range(1100)]
    batches.of("can0").sent(frames, 1)
    for can_id, data in frames:
        batches.of("can1").received(can_id, data, 1)
    batches.flush()
    payloads = {
        bus: [payload for topic, _, payload in written if topic.endswith(bus)]
        for bus in ("can0", "can1")
    }
    assert payloads["can0"] == payloads["can1"]
    assert len(payloads["can0"]) == 3


def test_frames_before_and_after_a_recording_are_not_in_it() -> None:
    written: list[bytes] = []
    batches = CanBatches(lambda *message: written.append(message[2]))
    tap = batches.of("can0")
    tap.received(1, b"before", 1)
    batches.begin()
    tap.sent([(2, b"within")], 2)
    batches.of("can1").received(3, b"within", 2)
    batches.flush()
    batches.end()
    tap.received(4, b"after", 3)
    tap.sent([(5, b"after")], 3)
    batches.flush()
    frames = [frame.can_id for one in written for _, frame in read_can_payload(one)]
    assert frames == [2, 3]


def test_a_cut_can_message_is_refused() -> None:
    with pytest.raises(ValueError, match="multiple of 24"):
        list(read_can_payload(bytes(25)))


def test_the_tip_is_a_pose_in_metres_for_3d_viewers() -> None:
    tip = b'{"tip_mm":[1000.0,-2000.0,3.0],"quaternion":[1.0,0.1,0.2,0.3]}'
    told = tip_pose(tip, 12_000_000_034)
    assert told is not None
    pose = msgspec.json.decode(told)
    assert pose["timestamp"] == {"sec": 12, "nsec": 34}
    assert pose["pose"]["position"] == {"x": 1.0, "y": -2.0, "z": 0.003}
    assert pose["pose"]["orientation"] == {"w": 1.0, "x": 0.1, "y": 0.2, "z": 0.3}


@pytest.mark.parametrize("tip", [b'{"tip_mm":null}', b'{"tip_mm":[1.0,null,2.0]}', b"{}"])
def test_an_unknown_tip_has_no_pose(tip: bytes) -> None:
    assert tip_pose(tip, 0) is None
