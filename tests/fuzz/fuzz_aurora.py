"""What the tracker's codec and the emulated tracker make of arbitrary bytes.

Only the codec's own error is an answer; any other exception is a finding.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial

import numpy as np

from config.emulation.lab import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.commands import (
    MAX_COMMAND_BYTES,
    CommandReader,
    decode_command,
    decode_line_settings,
    encode_command,
)
from drivers.aurora.codec.crc import crc16
from drivers.aurora.codec.errors import CodecError
from drivers.aurora.codec.parameters import decode_parameters, device_names, timeouts_s
from drivers.aurora.codec.replies import (
    BINARY_HEADER,
    MAX_REPLY_BYTES,
    RESET,
    BinaryReply,
    Reply,
    TextReply,
    coded_reply,
    encode_binary_reply,
    encode_text_reply,
)
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.aurora.codec.tool_information import (
    Fields,
    decode_port_handles,
    decode_tool_information,
)
from drivers.aurora.codec.tracking_data import TrackingData, decode_bx, decode_tx
from drivers.aurora.codec.versions import ApiRevision, VersionText
from drivers.aurora.codec.volumes import decode_volumes
from drivers.aurora.frame import FrameAssembler
from drivers.pose import Pose
from sim_backends.devices.aurora.device import EmulatedAurora

_TOOLS = [
    EmulatedTool(attached_to="tip", port=1, serial="3C112801"),
    EmulatedTool(attached_to="base", port=2, serial="3C112802", degrees_of_freedom=5),
]
_UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
_BODY = {"tip": Pose(np.array([0.0, 0.0, 150.0]), _UPRIGHT), "base": Pose(np.zeros(3), _UPRIGHT)}
_ALL_FIELDS = tuple(Fields(bits) for bits in (0x0001, 0x0085, 0x0025, 0x00ED, 0x0048))
_ROLES = {0x0A: "tip", 0x0B: "base"}

_TEXT_DECODERS: tuple[Callable[[str], object], ...] = (
    decode_port_handles,
    *(partial(decode_tool_information, fields=fields) for fields in _ALL_FIELDS),
    decode_volumes,
    ApiRevision.decode,
    VersionText.decode,
    coded_reply,
    lambda text: (device_names(decode_parameters(text)), timeouts_s(decode_parameters(text))),
)


def reply_reader(data: bytes) -> None:
    """A stream of bytes as replies: bounded, and nothing with a bad checksum comes out."""
    whole, pieces = ReplyReader(), ReplyReader()
    replies = whole.feed(data)
    step = 1 + len(data) % 5
    found: list[Reply] = []
    for start in range(0, len(data), step):
        found += pieces.feed(data[start : start + step])
        assert pieces.pending <= MAX_REPLY_BYTES
    assert whole.pending <= MAX_REPLY_BYTES
    for reply in (*replies, *found):
        _check_is_in(reply, data)
        _decode(reply)


def _check_is_in(reply: Reply, data: bytes) -> None:
    """An accepted reply stands in the data as it would have been sent, checksums and all."""
    if isinstance(reply, TextReply):
        assert encode_text_reply(reply.text) in data
    elif isinstance(reply, BinaryReply):
        assert encode_binary_reply(reply.body) in data


def _decode(reply: Reply) -> None:
    if isinstance(reply, TextReply):
        _decode_text(reply.text)
    elif isinstance(reply, BinaryReply):
        with suppress(CodecError):
            _assemble(decode_bx(reply.body))


def _decode_text(text: str) -> None:
    for decode in _TEXT_DECODERS:
        with suppress(CodecError):
            decode(text)
    with suppress(CodecError):
        _assemble(decode_tx(text))


def _assemble(data: TrackingData) -> None:
    """Whatever a sound reply says, it becomes a frame whose poses are poses."""
    frame = FrameAssembler(_ROLES, has_base=True).frame(data, 0, 0, 0)
    for sample in frame.tools.values():
        assert (sample.pose is None) is (sample.absence is not None)
        if sample.pose is not None:
            assert np.isfinite(sample.pose.position_mm).all()
            assert abs(float(np.linalg.norm(sample.pose.quaternion)) - 1.0) < 1e-9


def text_replies(data: bytes) -> None:
    """Any text behind a right checksum."""
    text = data.decode("latin-1").encode("ascii", "ignore").decode("ascii").replace("\r", "")
    (reply,) = ReplyReader().feed(encode_text_reply("x" + text)) or [TextReply("x" + text)]
    _decode(reply)
    _decode_text(text)


def binary_replies(data: bytes) -> None:
    """Any body behind right checksums, and the same with one bit wrong."""
    body = data[:2000]
    wire = encode_binary_reply(body)
    (reply,) = ReplyReader().feed(wire)
    assert reply == BinaryReply(body)
    _decode(reply)
    flipped = bytearray(wire)
    bit = crc16(data) % (8 * len(wire))
    flipped[bit // 8] ^= 1 << bit % 8
    for damaged in ReplyReader().feed(bytes(flipped)):
        if isinstance(damaged, BinaryReply):
            # A wrong start can uncover a whole reply inside the body; never the outer one.
            assert len(damaged.body) <= len(body) - BINARY_HEADER.size
        elif isinstance(damaged, TextReply):
            _check_is_in(damaged, bytes(flipped))
            assert damaged.text == RESET or encode_text_reply(damaged.text) in wire


def command_reader(data: bytes) -> None:
    """A stream of bytes as commands: bounded, and nothing with a bad checksum is obeyed."""
    reader = CommandReader()
    step = 1 + len(data) % 7
    for start in range(0, len(data), step):
        for line in reader.feed(data[start : start + step]):
            with suppress(CodecError):
                command = decode_command(line)
                if line[len(command.word) :].startswith(b":"):
                    assert crc16(line[:-4]) == int(line[-4:], 16)
                decode_line_settings(command.arguments)
        assert reader.pending <= MAX_COMMAND_BYTES + 1


def emulated_tracker(data: bytes) -> None:
    """Arbitrary commands to the whole emulated device, sound ones and bytes as they are.

    With a high first byte each further line becomes a sound command, else it is sent as it is.
    Whatever the device answers is sound.
    """
    device = EmulatedAurora(EmulatedTracker(tools=_TOOLS), lambda t_ns: _BODY)
    reader, t_ns = ReplyReader(), 0
    device.port.output = lambda piece, baud_rate: _check_is_sound(reader.feed(piece))
    for line in (b"INIT:E3A5\r", b"PHSR:02E17E\r"):
        device.receive(line, device.line.baud_rate, t_ns)
        t_ns += 100_000_000
    for line in data[1:].split(b"\n")[:20]:
        if data[:1] > b"\x7f":
            word, _, arguments = line.decode("latin-1").encode("ascii", "ignore").partition(b":")
            line = encode_command(word.decode(), arguments.decode())
        device.receive(line + b"\r", device.line.baud_rate, t_ns)
        t_ns += 300_000_000
        device.advance(t_ns)


def _check_is_sound(replies: list[Reply]) -> None:
    for reply in replies:
        assert isinstance(reply, TextReply | BinaryReply), reply


TARGETS: dict[str, Callable[[bytes], None]] = {
    "aurora_reply_reader": reply_reader,
    "aurora_text_replies": text_replies,
    "aurora_binary_replies": binary_replies,
    "aurora_command_reader": command_reader,
    "aurora_emulated_tracker": emulated_tracker,
}
