"""The predefined connection set."""

from collections.abc import Callable

import pytest

from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.error import CodecError


def test_identifiers_of_node_5() -> None:
    assert (cob_ids.NMT, cob_ids.SYNC, cob_ids.TIME) == (0x000, 0x080, 0x100)
    assert cob_ids.emergency(5) == 0x085
    assert [cob_ids.tpdo(5, n) for n in (1, 2, 3, 4)] == [0x185, 0x285, 0x385, 0x485]
    assert [cob_ids.rpdo(5, n) for n in (1, 2, 3, 4)] == [0x205, 0x305, 0x405, 0x505]
    assert (cob_ids.sdo_response(5), cob_ids.sdo_request(5)) == (0x585, 0x605)
    assert cob_ids.heartbeat(127) == 0x77F


@pytest.mark.parametrize(
    "of_node",
    [cob_ids.emergency, cob_ids.sdo_response, cob_ids.sdo_request, cob_ids.heartbeat],
)
@pytest.mark.parametrize("node", [-1, 0, 128])
def test_there_is_no_such_node(of_node: Callable[[int], int], node: int) -> None:
    with pytest.raises(CodecError, match="1 to 127"):
        of_node(node)


@pytest.mark.parametrize("number", [0, 5])
def test_only_four_pdos_are_predefined(number: int) -> None:
    with pytest.raises(CodecError, match="PDO"):
        cob_ids.tpdo(1, number)
    with pytest.raises(CodecError, match="PDO"):
        cob_ids.rpdo(1, number)
