"""Replies become frames: poses by role, or why there is none, and the tip in the base's frame."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aurora.codec.status_bits import HandleState, PortStatus
from drivers.aurora.codec.tracking_data import ToolReading, TrackingData
from drivers.aurora.frame import Absence, FrameAssembler, SteadyBase
from drivers.pose import PlainPose
from tests.drivers.aurora.golden import DISABLED_C, MISSING_B, TOOL_A, TOOL_B

ROLES = {0x0A: "tip", 0x0B: "base"}
NO_TURN = (1.0, 0.0, 0.0, 0.0)
AT_REST = PlainPose((0.0, 0.0, 0.0), NO_TURN)


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


def test_a_tip_that_stays_in_an_old_frame_is_not_renewed_by_a_base_that_goes_on() -> None:
    assembler = FrameAssembler(ROLES, has_base=True)
    base = TOOL_B._replace(handle=0x0B, frame_number=0x148)
    assert assembler.frame_number(TrackingData((base, TOOL_A), 0)) == 0x140
    missing = TOOL_A._replace(state=HandleState.MISSING, quaternion=None, position_mm=None)
    told = TrackingData((base, missing), 0)
    assert assembler.frame_number(told) == 0x148, "that it is missing has to be told"


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


FRAME_NS = 25_000_000


def _jittering(random: np.random.Generator, at: PlainPose = AT_REST) -> PlainPose:
    """A base sensor as read: off by 0.1 mm and 1.3 mrad along each axis."""
    x, y, z = (np.array(at.position_mm) + random.normal(0.0, 0.1, 3)).tolist()
    half = random.normal(0.0, 0.5 * 0.0013, 3).tolist()
    length = math.hypot(1.0, *half)
    turn = (1.0 / length, half[0] / length, half[1] / length, half[2] / length)
    return PlainPose((x, y, z), (at @ PlainPose((0.0, 0.0, 0.0), turn)).quaternion)


def _tip_seen(base: PlainPose) -> np.ndarray:
    return np.array(PlainPose((0.0, 0.0, 180.0), NO_TURN).seen_from(base).position_mm)


def test_the_jitter_of_a_base_that_stands_still_does_not_move_a_far_tip() -> None:
    random, steady = np.random.default_rng(5), SteadyBase(1.0)
    seen = [steady.seen(_jittering(random), frame * FRAME_NS) for frame in range(2000)]
    moved = np.array([_tip_seen(base) for base in seen[200:]])
    assert moved.std(axis=0).max() < 0.05
    assert np.linalg.norm(moved.mean(axis=0) - (0.0, 0.0, 180.0)) < 0.05
    lengths = [math.hypot(*base.quaternion) for base in seen]
    assert max(abs(length - 1.0) for length in lengths) < 1e-12


def test_at_first_the_base_is_the_mean_of_what_was_seen_of_it() -> None:
    steady = SteadyBase(1e6)
    for frame, x in enumerate((1.0, 0.0, 0.5)):
        base = steady.seen(PlainPose((x, 0.0, 0.0), NO_TURN), frame * FRAME_NS)
    assert base.position_mm == pytest.approx((0.5, 0.0, 0.0))


def test_a_single_reading_far_off_is_told_and_leaves_the_base_where_it_was() -> None:
    steady = SteadyBase(1.0)
    for frame in range(100):
        steady.seen(AT_REST, frame * FRAME_NS)
    off = PlainPose((20.0, 0.0, 0.0), NO_TURN)
    assert steady.seen(off, 100 * FRAME_NS) == off
    assert steady.seen(AT_REST, 101 * FRAME_NS).position_mm == pytest.approx((0.0, 0.0, 0.0))
    assert steady.seen(off, 102 * FRAME_NS) == off, "two, but not in a row"


@pytest.mark.parametrize(
    "there",
    [
        PlainPose((3.0, 0.0, 0.0), NO_TURN),
        PlainPose((0.0, 0.0, 0.0), (math.cos(0.02), 0.0, math.sin(0.02), 0.0)),
    ],
    ids=["pushed", "turned"],
)
def test_a_base_that_leaps_is_believed_at_once_and_averaged_anew(there: PlainPose) -> None:
    random, steady = np.random.default_rng(6), SteadyBase(1.0)
    for frame in range(100):
        steady.seen(_jittering(random), frame * FRAME_NS)
    for frame in range(100, 104):
        base = steady.seen(there, frame * FRAME_NS)
        assert base.position_mm == pytest.approx(there.position_mm)
        assert base.quaternion == pytest.approx(there.quaternion)


def test_a_base_that_moves_slowly_is_followed_after_the_time_of_the_average() -> None:
    steady, speed_mm_s = SteadyBase(0.5), 1.0
    for frame in range(400):
        t_s = frame * 0.025
        base = steady.seen(PlainPose((speed_mm_s * t_s, 0.0, 0.0), NO_TURN), frame * FRAME_NS)
    assert speed_mm_s * t_s - base.position_mm[0] == pytest.approx(0.5, abs=0.02)


def test_after_a_gap_the_newest_reading_counts() -> None:
    steady = SteadyBase(1.0)
    for frame in range(100):
        steady.seen(AT_REST, frame * FRAME_NS)
    moved = PlainPose((1.0, 0.0, 0.0), NO_TURN)
    assert steady.seen(moved, 20_000_000_000).position_mm == pytest.approx(moved.position_mm)


def test_a_quaternion_and_its_negative_are_the_same_base() -> None:
    steady = SteadyBase(1.0)
    steady.seen(AT_REST, 0)
    base = steady.seen(PlainPose((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0, 0.0)), FRAME_NS)
    assert base.quaternion == pytest.approx(NO_TURN)


def test_the_tip_is_given_in_the_averaged_base_where_one_is_configured() -> None:
    frames = FrameAssembler(ROLES, True, base_averaged_s=1e6)
    assert TOOL_B.position_mm is not None
    x, y, z = TOOL_B.position_mm
    other = TOOL_B._replace(position_mm=(x + 1.0, y, z))
    first = frames.frame(TrackingData((TOOL_A, TOOL_B), 0), 0x140, 0, 0)
    second = frames.frame(TrackingData((TOOL_A, other), 0), 0x141, FRAME_NS, FRAME_NS)
    assert first.tip is not None
    assert second.tip is not None
    assert np.linalg.norm(second.tip.position_mm - first.tip.position_mm) == pytest.approx(0.5)
    assert frames.frame(TrackingData((TOOL_A, MISSING_B), 0), 0x142, 0, 0).tip is None
