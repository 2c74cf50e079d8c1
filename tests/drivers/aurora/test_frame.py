"""Replies become frames: poses by role, or why there is none, and the tip in the base's frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.status_bits import HandleState, PortStatus
from drivers.aurora.codec.tracking_data import ToolReading, TrackingData
from drivers.aurora.frame import Absence, FrameAssembler
from drivers.pose import PlainPose
from tests.drivers.aurora.golden import DISABLED_C, MISSING_B, TOOL_A, TOOL_B

ROLES = {0x0A: "tip", 0x0B: "base"}


def frame_of(*readings: ToolReading, has_base: bool = True, system_status: int = 0):  # type: ignore[no-untyped-def]
    data = TrackingData(readings, system_status)
    return FrameAssembler(ROLES, has_base).frame(data, 0x140, 1_000, 2_000)


def test_the_tip_is_given_in_the_frame_of_the_base() -> None:
    frame = frame_of(TOOL_A, TOOL_B)
    assert frame.tip.position_mm == pytest.approx([12.5, -76.0, -49.5])
    assert frame.tip.quaternion == pytest.approx([0.5, 0.5, -0.5, 0.5])
    assert (frame.t_ns, frame.received_ns, frame.frame_number) == (1_000, 2_000, 0x140)


def test_a_turned_base_turns_the_tip() -> None:
    turned = TOOL_B._replace(quaternion=(math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)))
    frame = frame_of(TOOL_A, turned)
    assert frame.tip.position_mm == pytest.approx([-76.0, -12.5, -49.5])


def test_without_a_configured_base_the_tip_is_given_as_measured() -> None:
    frame = frame_of(TOOL_A, TOOL_B, has_base=False)
    assert frame.tip.position_mm == pytest.approx([12.5, -30.25, -200.0])


@pytest.mark.parametrize("base", [MISSING_B, DISABLED_C._replace(handle=0x0B), None])
def test_without_the_base_s_pose_there_is_no_tip(base: ToolReading | None) -> None:
    frame = frame_of(*([TOOL_A] if base is None else [TOOL_A, base]))
    assert frame.tip is None
    assert frame.tools["tip"].pose is not None


def test_a_sample_says_why_it_has_no_pose() -> None:
    frame = frame_of(TOOL_A, MISSING_B)
    assert frame.tools["tip"].absence is None
    assert frame.tools["base"].absence is Absence.MISSING
    frame = frame_of(DISABLED_C._replace(handle=0x0A), TOOL_B)
    assert frame.tools["tip"].absence is Absence.DISABLED


def test_out_of_volume_travels_with_the_pose() -> None:
    for bit in (PortStatus.OUT_OF_VOLUME, PortStatus.PARTIALLY_OUT_OF_VOLUME):
        frame = frame_of(TOOL_A._replace(port_status=0x31 | bit), TOOL_B)
        assert frame.tools["tip"].pose is not None
        assert not frame.tools["tip"].in_volume
        assert frame.tools["base"].in_volume


def test_bits_without_a_name_are_kept() -> None:
    frame = frame_of(TOOL_A._replace(port_status=0xFFFF0031), TOOL_B, system_status=0xF800)
    assert int(frame.tools["tip"].port_status) == 0xFFFF0031
    assert int(frame.system_status) == 0xF800


NAN = math.nan
INF = math.inf


@pytest.mark.parametrize(
    "reading",
    [
        TOOL_A._replace(quaternion=(0.0, 0.0, 0.0, 0.0)),
        TOOL_A._replace(quaternion=(1.1, 0.0, 0.0, 0.0)),
        TOOL_A._replace(quaternion=(NAN, 0.0, 0.0, 0.0)),
        TOOL_A._replace(quaternion=(INF, 0.0, 0.0, 0.0)),
        TOOL_A._replace(position_mm=(NAN, 0.0, 0.0)),
        TOOL_A._replace(position_mm=(0.0, -INF, 0.0)),
        TOOL_A._replace(position_mm=(-3.7e28, 0.0, 0.0)),
    ],
)
def test_numbers_that_are_no_pose_are_not_given_as_one(reading: ToolReading) -> None:
    frame = frame_of(reading, TOOL_B)
    assert frame.tools["tip"].absence is Absence.IMPLAUSIBLE
    assert frame.tools["tip"].pose is frame.tip is None


def test_quaternions_are_brought_to_unit_length() -> None:
    frame = frame_of(TOOL_A._replace(quaternion=(1.0001, 0.0, 0.0, 0.0)), TOOL_B)
    assert frame.tools["tip"].pose.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-15)


def test_tools_without_a_role_are_left_out_and_do_not_number_frames() -> None:
    stranger = TOOL_A._replace(handle=0x2A, frame_number=7)
    assembler = FrameAssembler(ROLES, has_base=True)
    data = TrackingData((stranger, TOOL_A, TOOL_B), 0)
    assert set(assembler.samples(data)) == {"tip", "base"}
    assert assembler.frame_number(data) == 0x140
    assert assembler.frame_number(TrackingData((stranger, DISABLED_C), 0)) is None


angles = st.floats(-np.pi, np.pi)
lengths = st.floats(-500.0, 500.0)


@given(angles, st.tuples(lengths, lengths, lengths), st.tuples(lengths, lengths, lengths))
def test_moving_base_and_tip_together_changes_nothing(
    angle: float, shift: tuple[float, float, float], tip: tuple[float, float, float]
) -> None:
    """Turned about z and shifted: the tip in the base's frame stays."""
    turn = (math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2))
    x, y, z = tip
    cosine, sine = math.cos(angle), math.sin(angle)
    moved = (
        shift[0] + cosine * x - sine * y,
        shift[1] + sine * x + cosine * y,
        shift[2] + z,
    )
    frame = frame_of(
        ToolReading(0x0A, HandleState.VALID, turn, moved, 0.0, 0x31, 8),
        ToolReading(0x0B, HandleState.VALID, turn, shift, 0.0, 0x31, 8),
    )
    assert frame.tip.position_mm == pytest.approx(tip, abs=1e-9)
    assert frame.tip.quaternion == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_the_tip_is_where_its_sensor_says_by_its_offset_and_its_rotation() -> None:
    """The sensor sits 1.5 mm behind the tip and is turned there by 90° about x."""
    half = math.sqrt(0.5)
    sensor = PlainPose((0.0, 0.0, -1.5), (half, half, 0.0, 0.0))
    from_sensor = PlainPose((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)).seen_from(sensor)
    data = TrackingData((TOOL_A, TOOL_B), 0)
    plain = frame_of(TOOL_A, TOOL_B).tip
    frame = FrameAssembler(ROLES, True, from_sensor).frame(data, 0x140, 1_000, 2_000)
    assert frame.tip is not None
    again = frame.tip.plain() @ sensor
    assert again.position_mm == pytest.approx(plain.position_mm.tolist())
    assert again.quaternion == pytest.approx(plain.quaternion.tolist())
    assert math.dist(frame.tip.position_mm.tolist(), plain.position_mm.tolist()) == pytest.approx(
        1.5
    )
    alone = FrameAssembler(ROLES, False, from_sensor).frame(data, 0x140, 1_000, 2_000).tip
    assert alone is not None
    assert math.dist(alone.position_mm.tolist(), [12.5, -30.25, -200.0]) == pytest.approx(1.5)
    sensed = frame.tools["tip"].pose
    assert sensed is not None
    assert sensed.position_mm == pytest.approx([12.5, -30.25, -200.0])
