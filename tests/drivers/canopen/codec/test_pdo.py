"""PDO parameters and packing."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.pdo import (
    Field,
    MappingEntry,
    PdoCobId,
    PdoLayout,
    decode_mapping_entry,
    decode_pdo_cob_id,
)


@pytest.mark.parametrize(
    ("value", "cob_id"),
    [
        (0x00000185, PdoCobId(0x185)),
        (0x40000185, PdoCobId(0x185, remote_allowed=False)),
        (0xC0000185, PdoCobId(0x185, valid=False, remote_allowed=False)),
        (0x80000000, PdoCobId(0, valid=False)),
        (0x3FFFFFFF, PdoCobId(0x1FFFFFFF, extended=True)),
    ],
)
def test_cob_ids(value: int, cob_id: PdoCobId) -> None:
    assert cob_id.encode() == value
    assert decode_pdo_cob_id(value) == cob_id


@pytest.mark.parametrize("value", [-1, 0x800, 0x1FFFFFFF, 1 << 32])
def test_no_cob_id(value: int) -> None:
    with pytest.raises(CodecError):
        decode_pdo_cob_id(value)


@pytest.mark.parametrize(
    "cob_id", [PdoCobId(0x800), PdoCobId(-1), PdoCobId(1 << 29, extended=True)]
)
def test_no_such_identifier(cob_id: PdoCobId) -> None:
    with pytest.raises(CodecError):
        cob_id.encode()


@pytest.mark.parametrize(
    ("value", "entry"),
    [
        (0x60400010, MappingEntry(0x6040, 0, 16)),
        (0x607A0020, MappingEntry(0x607A, 0, 32)),
        (0x60FE0120, MappingEntry(0x60FE, 1, 32)),
    ],
)
def test_mapping_entries(value: int, entry: MappingEntry) -> None:
    assert entry.encode() == value
    assert decode_mapping_entry(value) == entry


@pytest.mark.parametrize("value", [-1, 1 << 32])
def test_no_mapping_entry(value: int) -> None:
    with pytest.raises(CodecError):
        decode_mapping_entry(value)


@pytest.mark.parametrize(
    ("fields", "values", "data"),
    [
        ([Field(16), Field(32, signed=True)], (0x000F, -2), "0f00feffffff"),
        (
            [Field(16), Field(32, signed=True), Field(16, signed=True)],
            (0x1237, 100_000, -15),
            "3712a0860100f1ff",
        ),
        ([Field(8, signed=True)], (-1,), "ff"),
        ([Field(64)], (0x0102030405060708,), "0807060504030201"),
        ([Field(1), Field(1), Field(6)], (1, 0, 0x3F), "fd"),
        ([Field(24, signed=True), Field(8)], (-2, 7), "feffff07"),
        ([Field(4), Field(16), Field(4, signed=True)], (0xA, 0xBCDE, -1), "eacdfb"),
        ([], (), ""),
    ],
)
def test_values_lie_little_endian_one_after_the_other(
    fields: list[Field], values: tuple[int, ...], data: str
) -> None:
    layout = PdoLayout(fields)
    assert layout.size == len(data) // 2
    assert layout.unpack(bytes.fromhex(data)) == values
    assert layout.pack(values).hex() == data


@pytest.mark.parametrize(
    "fields", [[Field(64), Field(8)], [Field(0)], [Field(32), Field(32), Field(1)]]
)
def test_what_fits_no_pdo(fields: list[Field]) -> None:
    with pytest.raises(CodecError):
        PdoLayout(fields)


@pytest.mark.parametrize("fields", [[Field(16), Field(16)], [Field(12), Field(20)]])
def test_wrong_values_and_lengths_are_refused(fields: list[Field]) -> None:
    layout = PdoLayout(fields)
    for values in [(1 << 20, 0), (-1, 0), (1,), (1, 2, 3)]:
        with pytest.raises(CodecError):
            layout.pack(values)
    for length in (0, 3, 5):
        with pytest.raises(CodecError, match="4 bytes"):
            layout.unpack(bytes(length))


@st.composite
def layouts_with_values(draw: st.DrawFn) -> tuple[list[Field], list[int]]:
    sizes = draw(st.lists(st.integers(1, 32), max_size=8).filter(lambda bits: sum(bits) <= 64))
    fields = [Field(bits, draw(st.booleans())) for bits in sizes]
    values = [
        draw(st.integers(-(1 << f.bits - 1), (1 << f.bits - 1) - 1))
        if f.signed
        else draw(st.integers(0, (1 << f.bits) - 1))
        for f in fields
    ]
    return fields, values


@given(layouts_with_values())
def test_roundtrip(drawn: tuple[list[Field], list[int]]) -> None:
    fields, values = drawn
    layout = PdoLayout(fields)
    assert layout.unpack(layout.pack(values)) == tuple(values)
