"""What the robot tells, as OpenIGTLink messages.

The protocol knows no frame that a transform is in: its name says it. Everything is in the frame of
the base sensor, in mm; how that lies in a picture of the patient is the user's registration.
"""

from typing import Final

import numpy as np

from daemon.bridges.openigtlink.contents import (
    Point,
    PolyLines,
    StatusCode,
    StatusContent,
    Tool,
    ToolKind,
    Transform,
    ascii_only,
    pack_points,
    pack_poly_lines,
    pack_status,
    pack_string,
    pack_tracking_data,
    pack_transform,
)
from daemon.bridges.openigtlink.framing import Frame
from daemon.bridges.poses import is_place, quaternion_along, rotation, unit_quaternion
from daemon.messages import Body, Status, Tip
from safety.states import OperatingState

TIP: Final = "TipToBase"
MEASURED: Final = "MeasuredTipToBase"
REFERENCE: Final = "ReferenceToBase"
BODY: Final = "Body"
BODY_POINTS: Final = "BodyPoints"
STATE: Final = "State"
TOOLS: Final = "Tools"
KINDS: Final = ("TRANSFORM", "TDATA", "POLYDATA", "POINT", "STATUS", "STRING", "CAPABILITY")

_NAME: Final = 20
_CODES: Final = {
    OperatingState.FAULT.value: StatusCode.HARDWARE_FAILURE,
    OperatingState.ESTOP.value: StatusCode.PANIC,
    OperatingState.STANDBY.value: StatusCode.NOT_READY,
}


def tip_frames(tip: Tip, date_ns: int) -> list[Frame]:
    """TRANSFORM of where the tip is, was measured, and should be; of what is known of it."""
    frames = []
    for device, transform in (
        (TIP, _pose(tip.tip_mm, tip.quaternion)),
        (MEASURED, _pose(tip.measured_mm, tip.measured_quaternion or tip.quaternion)),
        (REFERENCE, _reference(tip)),
    ):
        if transform is not None:
            frames.append(Frame("TRANSFORM", device, pack_transform(transform), date_ns))
    return frames


def tracking_frame(tip: Tip, date_ns: int) -> Frame | None:
    """TDATA of tip, base and reference; None where the tip is not known."""
    pose = _pose(tip.tip_mm, tip.quaternion)
    if pose is None:
        return None
    whole = unit_quaternion(tip.quaternion) is not None
    kind = ToolKind.SIX_DEGREES if whole else ToolKind.ONLY_PLACE
    tools = [Tool("Tip", kind, pose), Tool("Base", ToolKind.SIX_DEGREES, np.eye(4)[:3])]
    if (reference := _reference(tip)) is not None:
        pointing = tip.reference_direction is not None
        kind = ToolKind.FIVE_DEGREES if pointing else ToolKind.ONLY_PLACE
        tools.append(Tool("Reference", kind, reference))
    return Frame("TDATA", TOOLS, pack_tracking_data(tools), date_ns)


def body_frames(body: Body, date_ns: int, kinds: tuple[str, ...] = ("POLYDATA",)) -> list[Frame]:
    """The body's centreline with its radius; nothing where nobody knows it.

    kinds: POLYDATA is one line through its points, POINT the points themselves.
    """
    points = body.centreline_mm
    if not points or not all(map(is_place, points)):
        return []
    radius = body.radius_mm or []
    radius = radius if len(radius) == len(points) else [0.0] * len(points)
    frames = []
    if "POLYDATA" in kinds:
        line = PolyLines(np.array(points), (tuple(range(len(points))),), np.array(radius), "Radius")
        frames.append(Frame("POLYDATA", BODY, pack_poly_lines(line), date_ns))
    if "POINT" in kinds:
        dots = [
            Point(f"Body-{number}", BODY, (x, y, z), 2.0 * r)
            for number, ((x, y, z), r) in enumerate(zip(points, radius, strict=True))
        ]
        frames.append(Frame("POINT", BODY_POINTS, pack_points(dots), date_ns))
    return frames


def status_frame(status: Status, date_ns: int) -> Frame:
    """STATUS of the robot: the worst reason is its name, and every reason its text."""
    code = _CODES.get(status.state, StatusCode.OK)
    worst = status.reasons[0].name if status.reasons else ""
    content = StatusContent(code, worst, in_words(status))
    return Frame("STATUS", device_of(status.robot), pack_status(content), date_ns)


def state_frame(status: Status, date_ns: int) -> Frame:
    """STRING of the state and its reasons: for what reads no STATUS."""
    return Frame("STRING", STATE, pack_string(in_words(status)), date_ns)


def lost_frames(robot: str, why: str, date_ns: int) -> list[Frame]:
    """STATUS and STRING of a daemon that is not heard."""
    text = f"not connected: {why}"
    content = StatusContent(StatusCode.TIME_OUT, "not_connected", text)
    return [
        Frame("STATUS", device_of(robot), pack_status(content), date_ns),
        Frame("STRING", STATE, pack_string(text), date_ns),
    ]


def in_words(status: Status) -> str:
    """State and reasons in a line, and that nothing of it is real where nothing is."""
    simulated = " (simulated)" if status.simulated else ""
    reasons = "; ".join(f"{reason.subject}: {reason.text}" for reason in status.reasons)
    return f"{status.state}{simulated}{': ' if reasons else ''}{reasons}"


def device_of(robot: str) -> str:
    """A robot's name where a device is named."""
    return ascii_only(robot, _NAME)


def _reference(tip: Tip) -> Transform | None:
    return _pose(tip.reference_mm, quaternion_along(tip.reference_direction))


def _pose(
    place_mm: list[float] | None, quaternion: list[float] | tuple[float, ...] | None
) -> Transform | None:
    """None where the place is not known. Of a tip that is only a place, no turn is told."""
    if place_mm is None or not is_place(place_mm):
        return None
    turned = rotation(unit_quaternion(quaternion) or (1.0, 0.0, 0.0, 0.0))
    return np.column_stack([turned, place_mm])
