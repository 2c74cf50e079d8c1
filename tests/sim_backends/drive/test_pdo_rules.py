"""What a master may write to PDO parameters, and in which order."""

import pytest

from tests.sim_backends.drive.rig import NODE, Rig

OUT_OF_RANGE, DEVICE_STATE = 0x06090030, 0x08000022
NOT_MAPPABLE, TOO_LONG, NO_OBJECT, NO_SUBINDEX = 0x06040041, 0x06040042, 0x06020000, 0x06090011

RPDO1, TPDO1 = 0x200 + NODE, 0x40000180 + NODE
NOT_VALID = 1 << 31

CONTROLWORD, TARGET = 0x60400010, 0x607A0020
STATUSWORD, POSITION, TORQUE = 0x60410010, 0x60640020, 0x60770010


def switched_off(receive: bool) -> Rig:
    """A drive whose first PDO is not valid and has an empty mapping."""
    rig = Rig()
    rig.write(0x1400 if receive else 0x1800, 1, (RPDO1 if receive else TPDO1) | NOT_VALID)
    rig.write(0x1600 if receive else 0x1A00, 0, 0)
    return rig


def test_the_whole_sequence_and_its_read_back() -> None:
    rig = Rig()
    steps = [
        (0x1800, 1, TPDO1 | NOT_VALID),
        (0x1800, 2, 1),
        (0x1800, 3, 50),
        (0x1800, 5, 100),
        (0x1A00, 0, 0),
        (0x1A00, 1, STATUSWORD),
        (0x1A00, 2, POSITION),
        (0x1A00, 3, TORQUE),
        (0x1A00, 0, 3),
        (0x1800, 1, TPDO1),
    ]
    for index, subindex, value in steps:
        rig.write(index, subindex, value)
    assert rig.read(0x1800, 1) == TPDO1
    assert [rig.read(0x1A00, place) for place in range(4)] == [3, STATUSWORD, POSITION, TORQUE]


@pytest.mark.parametrize(
    ("index", "subindex", "value", "code"),
    [
        (0x1400, 1, RPDO1 + 1, DEVICE_STATE),  # another identifier while valid
        (0x1400, 1, (RPDO1 + 1) | NOT_VALID, 0),
        (0x1400, 1, RPDO1, 0),
        (0x1800, 3, 100, DEVICE_STATE),
        (0x1800, 6, 5, DEVICE_STATE),
        (0x1800, 2, 1, 0),
        (0x1800, 5, 100, 0),
        (0x1600, 0, 0, DEVICE_STATE),
        (0x1A00, 0, 0, DEVICE_STATE),
        (0x1600, 1, TARGET, DEVICE_STATE),
    ],
)
def test_what_may_change_while_a_pdo_is_valid(
    index: int, subindex: int, value: int, code: int
) -> None:
    assert Rig().refused(index, subindex, value) == code


@pytest.mark.parametrize("can_id", [0x000, 0x07F, 0x101, 0x180, 0x581, 0x5FF, 0x601, 0x6E0, 0x701])
def test_identifiers_that_belong_to_other_services(can_id: int) -> None:
    rig = switched_off(receive=False)
    assert rig.refused(0x1800, 1, 0x40000000 | can_id) == OUT_OF_RANGE
    assert rig.refused(0x1800, 1, 0xC0000000 | can_id) == 0


def test_29_bit_identifiers_are_refused() -> None:
    assert switched_off(receive=True).refused(0x1400, 1, 1 << 29 | 0x18DAF110) == OUT_OF_RANGE


@pytest.mark.parametrize("receive", [True, False])
@pytest.mark.parametrize("kind", [0, 1, 240, 254, 255])
def test_transmission_types(receive: bool, kind: int) -> None:
    assert Rig().refused(0x1400 if receive else 0x1800, 2, kind) == 0


@pytest.mark.parametrize(
    ("index", "kind", "code"),
    [
        (0x1400, 241, OUT_OF_RANGE),
        (0x1400, 252, OUT_OF_RANGE),
        (0x1400, 253, OUT_OF_RANGE),
        (0x1800, 241, OUT_OF_RANGE),
        (0x1800, 251, OUT_OF_RANGE),
        (0x1800, 252, 0),
        (0x1800, 253, 0),
    ],
)
def test_transmission_types_that_only_one_direction_has(index: int, kind: int, code: int) -> None:
    assert Rig().refused(index, 2, kind) == code


@pytest.mark.parametrize(
    ("receive", "entry", "code"),
    [
        (True, CONTROLWORD, 0),
        (True, TARGET, 0),
        (False, STATUSWORD, 0),
        (False, CONTROLWORD, 0),  # what can be read back can be sent
        (True, STATUSWORD, NOT_MAPPABLE),  # nobody can write the statusword
        (True, 0x60400020, NOT_MAPPABLE),  # wrong length
        (False, 0x60640010, NOT_MAPPABLE),
        (False, 0x10170010, NOT_MAPPABLE),  # not mappable
        (True, 0x60850020, 0),
        (False, 0x607D0120, NOT_MAPPABLE),
        (False, 0x12340020, NO_OBJECT),
        (False, 0x60640120, NO_SUBINDEX),
        (True, 0x00050008, 0),  # dummies, in RPDOs only
        (True, 0x00070020, 0),
        (True, 0x00070010, NOT_MAPPABLE),
        (False, 0x00050008, NOT_MAPPABLE),
        (True, 0x00010001, NO_OBJECT),  # no dummy of this EDS
        (True, 0x00050108, NO_OBJECT),
        (True, 0, 0),
    ],
)
def test_what_can_be_mapped(receive: bool, entry: int, code: int) -> None:
    rig = switched_off(receive)
    assert rig.refused(0x1600 if receive else 0x1A00, 1, entry) == code


def test_entries_change_only_while_none_counts() -> None:
    rig = switched_off(receive=False)
    rig.write(0x1A00, 1, STATUSWORD)
    rig.write(0x1A00, 0, 1)
    assert rig.refused(0x1A00, 1, POSITION) == DEVICE_STATE
    rig.write(0x1A00, 0, 0)
    assert rig.refused(0x1A00, 1, POSITION) == 0


def test_a_pdo_has_eight_bytes() -> None:
    rig = switched_off(receive=False)
    for place, entry in enumerate((POSITION, 0x606C0020, STATUSWORD), 1):
        rig.write(0x1A00, place, entry)
    assert rig.refused(0x1A00, 0, 3) == TOO_LONG
    assert rig.refused(0x1A00, 0, 2) == 0


def test_no_more_entries_count_than_there_are() -> None:
    rig = switched_off(receive=False)
    rig.write(0x1A00, 1, STATUSWORD)
    rig.write(0x1A00, 2, 0)
    assert rig.refused(0x1A00, 0, 2) == NOT_MAPPABLE
    assert rig.refused(0x1A00, 0, 9) == 0x06090031
    assert rig.refused(0x1A00, 9, STATUSWORD, 4) == NO_SUBINDEX


def test_the_rules_hold_in_operational_too() -> None:
    rig = Rig()
    rig.operational()
    assert rig.refused(0x1A00, 0, 0) == DEVICE_STATE
    rig.write(0x1800, 1, TPDO1 | NOT_VALID)
    assert rig.refused(0x1A00, 0, 0) == 0
