"""The robot in OpenIGTLink's words: what is not known is not told."""

import numpy as np
from hypothesis import given

from daemon.bridges.openigtlink.contents import (
    StatusCode,
    ToolKind,
    read_points,
    read_poly_lines,
    read_status,
    read_string,
    read_tracking_data,
    read_transform,
)
from daemon.bridges.openigtlink.framing import packed
from daemon.bridges.openigtlink.translation import (
    body_frames,
    lost_frames,
    state_frame,
    status_frame,
    tip_frames,
    tracking_frame,
)
from daemon.messages import Body, Reason
from tests.daemon.bridges.telling import DATE_NS, PLACES, QUATERNIONS, body, status, tip


@given(PLACES, QUATERNIONS)
def test_the_tip_is_a_transform_of_its_place_and_turn(
    place: list[float], quaternion: list[float]
) -> None:
    frame = tip_frames(tip(tip_mm=place, quaternion=quaternion), DATE_NS)[0]
    transform = read_transform(frame.content)
    w, x, y, z = np.array(quaternion) / np.linalg.norm(quaternion)
    assert (frame.kind, frame.device, frame.date_ns) == ("TRANSFORM", "TipToBase", DATE_NS)
    assert np.allclose(transform[:, 3], place, rtol=1e-6)
    axis = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    assert np.allclose(transform[:, 2], axis, atol=1e-6)


def test_a_tip_that_is_not_known_is_not_told() -> None:
    assert tip_frames(tip(tip_mm=None, reference_mm=None), DATE_NS) == []
    assert tip_frames(tip(tip_mm=[1.0, float("nan"), 2.0], reference_mm=None), DATE_NS) == []
    assert tracking_frame(tip(tip_mm=None), DATE_NS) is None


def test_measured_and_reference_are_told_where_they_are_known() -> None:
    told = tip_frames(tip(measured_mm=[1.0, 2.0, 3.0]), DATE_NS)
    assert [one.device for one in told] == ["TipToBase", "MeasuredTipToBase", "ReferenceToBase"]
    pointing = tip(reference_direction=[1.0, 0.0, 0.0])
    reference = read_transform(tip_frames(pointing, DATE_NS)[-1].content)
    assert np.allclose(reference[:, 2], [1.0, 0.0, 0.0], atol=1e-6)


def test_tools_say_how_much_of_them_is_known() -> None:
    def kinds(**more: object) -> list[tuple[str, ToolKind]]:
        frame = tracking_frame(tip(**more), DATE_NS)
        assert frame is not None and frame.kind == "TDATA"
        return [(tool.name, tool.kind) for tool in read_tracking_data(frame.content)]

    six, five, place = ToolKind.SIX_DEGREES, ToolKind.FIVE_DEGREES, ToolKind.ONLY_PLACE
    assert kinds() == [("Tip", six), ("Base", six), ("Reference", place)]
    assert kinds(quaternion=None, reference_mm=None) == [("Tip", place), ("Base", six)]
    assert kinds(reference_direction=[0.0, 0.0, 1.0])[-1] == ("Reference", five)


def test_the_body_is_a_line_with_its_radius_or_points() -> None:
    line, points = body_frames(body(4), DATE_NS, ("POLYDATA", "POINT"))
    drawn = read_poly_lines(line.content)
    assert drawn.lines == ((0, 1, 2, 3),) and drawn.scalars_name == "Radius"
    assert drawn.points_mm[-1].tolist() == [0.0, 3.0, 30.0]
    assert drawn.scalars is not None and drawn.scalars.tolist() == [5.0, 4.5, 4.0, 3.5]
    dots = read_points(points.content)
    assert [dot.diameter_mm for dot in dots] == [10.0, 9.0, 8.0, 7.0]
    assert dots[-1].place_mm == (0.0, 3.0, 30.0)


def test_a_body_that_nobody_knows_is_not_told() -> None:
    assert body_frames(Body(t_ns=1, source="none"), DATE_NS) == []


def test_the_state_has_its_code_and_all_reasons() -> None:
    reasons = [
        Reason(
            name="drive_fault", severity="fault", subject="can0/3", text="überlast", remedy="wait"
        )
    ]
    for state, code in (
        ("running", StatusCode.OK),
        ("fault", StatusCode.HARDWARE_FAILURE),
        ("estop", StatusCode.PANIC),
        ("standby", StatusCode.NOT_READY),
    ):
        told = read_status(status_frame(status(state=state, reasons=reasons), DATE_NS).content)
        assert told.code == code and told.name == "drive_fault"
        assert told.text == f"{state} (simulated): can0/3: ?berlast"
    real = status(state="armed", simulated=False)
    assert read_string(state_frame(real, DATE_NS).content) == "armed"


def test_everything_fits_into_its_frame() -> None:
    for version in (1, 2):
        for frame in [
            *tip_frames(tip(measured_mm=[0.0, 0.0, 0.0]), DATE_NS),
            *body_frames(body(), DATE_NS, ("POLYDATA", "POINT")),
            status_frame(status(robot="a_robot_with_a_name_of_many_letters"), DATE_NS),
            *lost_frames("a_robot_with_a_name_of_many_letters", "gone ü", DATE_NS),
        ]:
            assert packed(frame, version)
