"""Arbitrary bytes at what reads files and sockets: robot files, captures, the control socket."""

from collections.abc import Callable

from config.yaml_document import parse_yaml
from drivers.can.capture import CaptureError, read_capture
from drivers.can.frame import pack_frame, unpack_frame
from drivers.canopen.sdo_client import SdoClient
from sim_backends.control_server import ControlServer
from sim_backends.faults import FaultError, understand


def robot_file(data: bytes) -> None:
    """Any text is read or explained."""
    document = parse_yaml(data.decode("utf-8", "replace"), "fuzz.yaml")
    for problem in document.problems:
        assert problem.line >= 1
        assert problem.column >= 1
        assert problem.message


def capture_file(data: bytes) -> None:
    """A capture is read to its end or refused."""
    try:
        for _, frame in read_capture(data):
            assert len(frame.data) <= 8
    except CaptureError:
        pass


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
