"""The SDO server, by its frames."""

import pytest

from tests.sim_backends.drive.rig import MS, NODE, Refused, Rig

ABORTED = 0x80


def hexed(data: bytes | None) -> str:
    return "" if data is None else data.hex()


def abort_code(data: bytes | None) -> int:
    assert data is not None
    assert data[0] == ABORTED
    return int.from_bytes(data[4:], "little")


def ask(rig: Rig, request: str) -> bytes | None:
    return rig.ask(bytes.fromhex(request))


@pytest.mark.parametrize(
    ("request_", "answer"),
    [
        ("4000100000000000", "4300100092010400"),  # U32
        ("4001100000000000", "4f01100000000000"),  # U8
        ("4017100000000000", "4b17100000000000"),  # U16
        ("4060600000000000", "4f60600001000000"),  # I8
        ("4018100200000000", "43181002e1570000"),  # sub-index
        ("407d600100000000", "437d600100000080"),  # I32, lowest
        ("2f60600008000000", "6060600000000000"),
        ("2b17100064000000", "6017100000000000"),
        ("2383600010270000", "6083600000000000"),
        ("2260600008ffffff", "6060600000000000"),  # size not told: one byte counts
    ],
)
def test_expedited_transfers(request_: str, answer: str) -> None:
    assert hexed(ask(Rig(), request_)) == answer


@pytest.mark.parametrize(
    ("request_", "code"),
    [
        ("4034120000000000", 0x06020000),  # no object
        ("4000100100000000", 0x06090011),  # no sub-index
        ("4018100500000000", 0x06090011),
        ("2300100000000000", 0x06010002),  # read only
        ("2f41600000000000", 0x06010002),
        ("2b60600008000000", 0x06070012),  # too long
        ("2f17100064000000", 0x06070013),  # too short
        ("2f29100103000000", 0x06090031),  # too high
        ("2b07 60 00ffff0000", 0x06090032),  # too low
        ("2b5a600004000000", 0x06090030),  # none of its values
        ("2f60600004000000", 0x06090030),
        ("2f98600005000000", 0x06090030),
        ("c608100015000000", 0x05040001),  # block download
        ("a408100000000000", 0x05040001),  # block upload
        ("e000000000000000", 0x05040001),
        ("6000000000000000", 0x05040001),  # a segment of nothing
        ("0000000000000000", 0x05040001),
        ("2108100005000000", 0x06010002),  # segmented, to a read-only object
    ],
)
def test_what_is_refused_and_why(request_: str, code: int) -> None:
    rig = Rig()
    request_ = request_.replace(" ", "")
    answer = ask(rig, request_)
    assert abort_code(answer) == code
    assert answer is not None
    if request_[:2] not in ("60", "00"):
        assert answer[1:4].hex() == request_[2:8]
    assert hexed(ask(rig, "4000100000000000")) == "4300100092010400"


def test_a_long_object_comes_in_segments() -> None:
    rig = Rig()
    assert hexed(ask(rig, "4008100000000000")) == "4108100016000000"
    text = b""
    for toggle in (0x60, 0x70, 0x60, 0x70):
        answer = rig.ask(bytes((toggle, *bytes(7))))
        assert answer is not None
        assert answer[0] & 0x10 == toggle & 0x10
        text += answer[1 : 8 - (answer[0] >> 1 & 7)]
        last = answer[0] & 1
    assert last
    assert text == b"Emulated stepper drive"
    assert abort_code(rig.ask(bytes((0x60, *bytes(7))))) == 0x05040001


def test_an_object_can_be_written_in_segments() -> None:
    rig = Rig()
    assert hexed(ask(rig, "2183600004000000")) == "6083600000000000"
    assert hexed(ask(rig, "0710270000000000")) == "2000000000000000"
    assert rig.read(0x6083) == 10_000


def test_segments_need_not_be_full() -> None:
    rig = Rig()
    ask(rig, "2083600000000000")  # size not told
    assert hexed(ask(rig, "0c10000000000000")) == "2000000000000000"
    assert hexed(ask(rig, "1927000000000000")) == "3000000000000000"
    assert rig.read(0x6083) == 10_000


def test_the_toggle_bit_must_alternate() -> None:
    rig = Rig()
    ask(rig, "4008100000000000")
    ask(rig, "6000000000000000")
    assert abort_code(ask(rig, "6000000000000000")) == 0x05030000
    ask(rig, "2183600004000000")
    assert abort_code(ask(rig, "1710270000000000")) == 0x05030000


@pytest.mark.parametrize(
    ("segment", "code"),
    [("0910270000000000", 0x06070010), ("0d10000000000000", 0x06070010)],
)
def test_a_download_must_be_as_long_as_told(segment: str, code: int) -> None:
    rig = Rig()
    ask(rig, "2183600004000000")
    assert abort_code(ask(rig, segment)) == code


def test_no_object_is_as_long_as_that() -> None:
    rig = Rig()
    assert abort_code(ask(rig, "21836000ffffff00")) == 0x06070012
    ask(rig, "2083600000000000")
    answer = None
    for number in range(200):
        answer = rig.ask(bytes((0x10 * (number % 2), *bytes(7))))
        if answer is not None and answer[0] == ABORTED:
            break
    assert abort_code(answer) == 0x05040005


def test_a_new_request_ends_the_transfer_under_way() -> None:
    rig = Rig()
    ask(rig, "4008100000000000")
    assert hexed(ask(rig, "4000100000000000")) == "4300100092010400"
    assert abort_code(ask(rig, "6000000000000000")) == 0x05040001


def test_an_abort_of_the_client_is_not_answered() -> None:
    rig = Rig()
    ask(rig, "4008100000000000")
    assert ask(rig, "8008100000000405") is None
    assert abort_code(ask(rig, "6000000000000000")) == 0x05040001


@pytest.mark.parametrize("length", [0, 1, 7])
def test_a_frame_of_another_length_is_no_request(length: int) -> None:
    assert Rig().ask(bytes(length)) is None


def test_answers_take_their_time_and_are_given_one_at_a_time() -> None:
    rig = Rig(sdo_delay_s=0.005)
    rig.master.send(0x600 + NODE, bytes.fromhex("4000100000000000"), rig.bus.now_ns)
    rig.master.send(0x600 + NODE, bytes.fromhex("4001100000000000"), rig.bus.now_ns)
    asked_ns = rig.bus.now_ns
    rig.run(30)
    (answer,) = [entry for entry in rig.heard if entry[0] == 0x580 + NODE]
    assert answer[1].hex() == "4300100092010400"
    assert 3 * MS < answer[2] - asked_ns < 8 * MS


def test_a_read_shows_the_moment_of_the_request() -> None:
    rig = Rig()
    rig.enable(3)
    rig.set(0x60FF, 10_000)
    rig.run(500)
    before = rig.position
    assert rig.read(0x6064, signed=True) == pytest.approx(before, abs=5)
    assert rig.position > before + 50


def test_writing_outside_of_the_limits_leaves_the_value() -> None:
    rig = Rig()
    with pytest.raises(Refused):
        rig.write(0x1029, 1, 7)
    assert rig.read(0x1029, 1) == 0
