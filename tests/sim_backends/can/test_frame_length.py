"""Lengths of CAN frames, against a simulation of the wire bit by bit."""

from hypothesis import example, given
from hypothesis import strategies as st

from drivers.can.frame import EXTENDED_FLAG, REMOTE_FLAG, STANDARD_ID_MASK, worst_case_bits
from sim_backends.devices.can.frame_length import frame_bits


def bits_of(value: int, count: int) -> list[int]:
    return [value >> shift & 1 for shift in reversed(range(count))]


def crc15(bits: list[int]) -> list[int]:
    """The shift register of ISO 11898-1, as drawn there."""
    register = [0] * 15
    for bit in bits:
        feedback = bit ^ register[0]
        register = [*register[1:], 0]
        if feedback:
            register = [r ^ p for r, p in zip(register, bits_of(0x4599, 15), strict=True)]
    return register


def with_stuff_bits(bits: list[int]) -> list[int]:
    sent: list[int] = []
    for bit in bits:
        sent.append(bit)
        if len(sent) >= 5 and len(set(sent[-5:])) == 1:
            sent.append(1 - bit)
    return sent


def wire(can_id: int, data: bytes) -> list[int]:
    """All bits of a frame as they are on the wire."""
    remote = 1 if can_id & REMOTE_FLAG else 0
    if can_id & EXTENDED_FLAG:
        number = can_id & 0x1FFFFFFF
        header = [0, *bits_of(number >> 18, 11), 1, 1, *bits_of(number, 18), remote, 0, 0]
    else:
        header = [0, *bits_of(can_id & STANDARD_ID_MASK, 11), remote, 0, 0]
    body = [] if remote else [bit for byte in data for bit in bits_of(byte, 8)]
    frame = [*header, *bits_of(len(data), 4), *body]
    delimiters_end_and_interframe = [1, 0, 1] + [1] * 7 + [1] * 3
    return with_stuff_bits(frame + crc15(frame)) + delimiters_end_and_interframe


can_ids = st.one_of(
    st.integers(0, 0x7FF),
    st.integers(0, 0x7FF).map(lambda can_id: can_id | REMOTE_FLAG),
    st.integers(0, 0x1FFFFFFF).map(lambda can_id: can_id | EXTENDED_FLAG),
    st.integers(0, 0x1FFFFFFF).map(lambda can_id: can_id | EXTENDED_FLAG | REMOTE_FLAG),
)
# Much of what brings stuff bits is runs, which random bytes hardly have.
payloads = st.one_of(
    st.binary(max_size=8), st.lists(st.sampled_from([0x00, 0xFF, 0x0F, 0xF0, 0x1F]), max_size=8)
).map(bytes)


@given(can_ids, payloads)
@example(0x000, bytes(8))
@example(0x7FF, b"\xff" * 8)
@example(EXTENDED_FLAG, bytes(7))
def test_length_is_that_of_the_simulated_wire(can_id: int, data: bytes) -> None:
    assert frame_bits(can_id, data) == len(wire(can_id, data))


@given(can_ids, payloads)
def test_no_frame_is_longer_than_the_worst_case(can_id: int, data: bytes) -> None:
    sent = 0 if can_id & REMOTE_FLAG else len(data)
    assert frame_bits(can_id, data) <= worst_case_bits(sent, bool(can_id & EXTENDED_FLAG))


def test_a_sync_is_51_bits_long() -> None:
    assert frame_bits(0x080, b"") == 51


def test_stuff_bits_can_make_a_frame_longer_by_a_tenth() -> None:
    assert frame_bits(0x000, bytes(8)) - frame_bits(0x2AA, b"\x55" * 8) > 10
