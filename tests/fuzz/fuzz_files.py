"""Arbitrary bytes at what reads files and sockets: robot files, captures, the control socket."""

from collections.abc import Callable
from contextlib import suppress

from config.documents.yaml_document import parse_yaml
from drivers.can.capture import CaptureError, capture_header, capture_record, read_capture
from drivers.can.frame import CanFrame, pack_frame, unpack_frame
from drivers.canopen.sdo_client import SdoClient
from sim_backends.faults import FaultError, understand
from sim_backends.lab.lab_ports import ControlServer

_CAPTURES_END_NS = 10**9 << 32
"""In 2106 the seconds of a capture overflow."""

_CAPTURED_SIZES = b"\x10\0\0\0" * 2


def robot_file(data: bytes) -> None:
    """Any text is read or explained."""
    document = parse_yaml(data.decode("utf-8", "replace"), "fuzz.yaml")
    for problem in document.problems:
        assert problem.line >= 1
        assert problem.column >= 1
        assert problem.message


def capture_file(data: bytes) -> None:
    """A capture is read to its end or refused: as it is, behind a sound header, and as records.

    What is read can be written, and is the same when read again.
    """
    _read_capture(data)
    _read_capture(capture_header() + data)
    # Each piece is a time and a frame; between them stands the frame's size, twice.
    pieces = [data[start : start + 24] for start in range(0, len(data), 24)]
    records = b"".join(piece[:8] + _CAPTURED_SIZES + piece[8:] for piece in pieces)
    _read_capture(capture_header() + records)


def _read_capture(content: bytes) -> None:
    records: list[tuple[int, CanFrame]] = []
    with suppress(CaptureError):
        records.extend(read_capture(content))
    datable = [(t_ns, frame) for t_ns, frame in records if t_ns < _CAPTURES_END_NS]
    again = b"".join(capture_record(t_ns, frame.can_id, frame.data) for t_ns, frame in datable)
    assert list(read_capture(capture_header() + again)) == datable


def kernel_frame(data: bytes) -> None:
    """Sixteen bytes are a frame, or are refused."""
    try:
        frame = unpack_frame(data)
    except ValueError:
        return
    assert unpack_frame(pack_frame(frame)) == frame


def sdo_client(data: bytes) -> None:
    """Frames that nobody asked for change nothing."""
    client = SdoClient(5, lambda _id, _data: True)
    client.receive(data[:8], 0)
    assert client.discarded == 1


def control_socket(data: bytes) -> None:
    """Every line gets an answer."""
    server = ControlServer({"state": lambda request: {"n": len(request)}})
    for line in data.split(b"\n"):
        assert isinstance(server.answer(line)["ok"], bool)


def fault_order(data: bytes) -> None:
    """An order is understood or explained."""
    try:
        understand({}, data.decode("utf-8", "replace"))
    except FaultError as error:
        assert str(error)


TARGETS: dict[str, Callable[[bytes], None]] = {
    "robot_file": robot_file,
    "capture_file": capture_file,
    "kernel_frame": kernel_frame,
    "sdo_client": sdo_client,
    "control_socket": control_socket,
    "fault_order": fault_order,
}
