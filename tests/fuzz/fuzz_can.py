"""Arbitrary bytes at everything that reads CAN: SLCAN, the CANopen codecs, the emulated drive."""

from collections.abc import Callable, Iterator
from pathlib import Path

from drivers.can.slcan import (
    MAX_LINE_BYTES,
    LineReader,
    SlcanError,
    decode_command,
    decode_reply,
    encode_command,
    encode_reply,
)
from drivers.canopen.codec.data_types import DataType, decode_value, encode_value
from drivers.canopen.codec.emcy import decode_emergency
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.nmt import (
    decode_heartbeat,
    decode_nmt_command,
    encode_heartbeat,
    encode_nmt_command,
)
from drivers.canopen.codec.pdo import Field, PdoLayout, decode_mapping_entry, decode_pdo_cob_id
from drivers.canopen.codec.sdo import decode_request, decode_response
from drivers.canopen.codec.sync import decode_sync, encode_sync
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.drive.drive import EmulatedDrive

_STEPPER = Path(__file__).parents[2] / "config" / "eds" / "stepper.eds"
_NODE = 5
_MS = 1_000_000


def slcan_reader(data: bytes) -> None:
    """Lines in whatever pieces; what is decoded can be encoded again."""
    reader = LineReader()
    for piece in _pieces(data):
        for line in reader.feed(piece):
            assert len(line) <= MAX_LINE_BYTES + 1
            _slcan_line(line)
        assert len(reader._line) <= MAX_LINE_BYTES + 1


def slcan_lines(data: bytes) -> None:
    """The whole input as one line."""
    _slcan_line(data)


def _slcan_line(line: bytes) -> None:
    try:
        command = decode_command(line)
    except SlcanError:
        pass
    else:
        assert decode_command(encode_command(command)[:-1]) == command
    try:
        reply = decode_reply(line)
    except SlcanError:
        pass
    else:
        encode_reply(reply)


def canopen_services(data: bytes) -> None:
    """The data of a frame, to every decoder of a service."""
    _decoded(lambda: encode_nmt_command(*decode_nmt_command(data)) == data)
    _decoded(lambda: encode_heartbeat(*decode_heartbeat(data)) == data)
    _decoded(lambda: encode_sync(decode_sync(data)) == data)
    _decoded(lambda: decode_emergency(data).encode()[: len(data)] == data)
    _decoded(lambda: decode_request(decode_request(data).encode()) == decode_request(data))
    _decoded(lambda: decode_response(decode_response(data).encode()) == decode_response(data))


def canopen_values(data: bytes) -> None:
    """Values of every type; PDO parameters; PDOs of any layout."""
    for data_type in DataType:
        _decoded(
            lambda data_type=data_type: (  # type: ignore[misc]
                encode_value(data_type, decode_value(data_type, data)) == data
            )
        )
    number = int.from_bytes(data[:5], "little")
    _decoded(lambda: decode_pdo_cob_id(number).encode() == number)
    _decoded(lambda: decode_mapping_entry(number).encode() == number)
    fields = [Field(byte & 0x7F, bool(byte & 0x80)) for byte in data[:9]]
    _decoded(lambda: _pdo_roundtrip(PdoLayout(fields), data[9:]))


def _pdo_roundtrip(layout: PdoLayout, data: bytes) -> bool:
    values = layout.unpack(data)
    return layout.unpack(layout.pack(values)) == values


def emulated_drive(data: bytes) -> None:
    """Frames to a drive: identifier and length in two bytes each, then the data.

    Whatever comes, it lives on and answers an SDO when it has had time to boot again.
    """
    bus = CanBus(1_000_000)
    master = bus.attach("master", 64)
    answers: list[bytes] = []
    master.listen({0x580 + _NODE: lambda _id, answer, _t: answers.append(answer)})
    drive = EmulatedDrive(bus, _NODE, _STEPPER)
    drive.power_on(0)
    bus.advance(310 * _MS)
    for can_id, payload in _frames(data):
        master.send(can_id, payload, bus.now_ns)
        bus.advance(bus.now_ns + 3 * _MS)
        assert len(bus.queue.heap) < 1000
    master.send(0x000, bytes((0x82, _NODE)), bus.now_ns)
    bus.advance(bus.now_ns + 1000 * _MS)
    answers.clear()
    master.send(0x600 + _NODE, bytes.fromhex("4000100000000000"), bus.now_ns)
    bus.advance(bus.now_ns + 1000 * _MS)
    assert answers == [bytes.fromhex("4300100092010400")]


def _frames(data: bytes) -> Iterator[tuple[int, bytes]]:
    """What a drive listens to comes often, anything else sometimes."""
    services = (0x000, 0x080, 0x100, 0x200 + _NODE, 0x300 + _NODE, 0x600 + _NODE, 0x77F)
    at = 0
    while at + 3 <= len(data):
        chosen, low, length = data[at], data[at + 1], data[at + 2] % 9
        can_id = services[chosen % 8] if chosen % 8 < len(services) else chosen << 3 | low & 7
        yield can_id & 0x7FF, data[at + 3 : at + 3 + length]
        at += 3 + length


def _pieces(data: bytes) -> Iterator[bytes]:
    size = 1 + (data[0] % 17 if data else 0)
    for start in range(0, len(data), size):
        yield data[start : start + size]


def _decoded(roundtrip: Callable[[], bool]) -> None:
    try:
        same = roundtrip()
    except CodecError:
        return
    assert same


TARGETS: dict[str, Callable[[bytes], None]] = {
    "slcan_reader": slcan_reader,
    "slcan_lines": slcan_lines,
    "canopen_services": canopen_services,
    "canopen_values": canopen_values,
    "emulated_drive": emulated_drive,
}
