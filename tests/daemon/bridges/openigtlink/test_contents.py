"""The contents of OpenIGTLink's messages: to bytes and back, and as pyigtl has them."""

import struct
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from daemon.bridges.openigtlink.contents import (
    Point,
    PolyLines,
    StatusContent,
    Tool,
    ToolKind,
    ascii_only,
    pack_points,
    pack_poly_lines,
    pack_start_tracking,
    pack_status,
    pack_string,
    pack_tracking_data,
    pack_transform,
    read_points,
    read_poly_lines,
    read_start_tracking,
    read_status,
    read_string,
    read_tracking_data,
    read_transform,
)
from daemon.bridges.openigtlink.framing import FramingError
from tests.daemon.bridges.telling import NUMBERS

NAMES = st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=20)
BYTES = st.integers(0, 255)
TRANSFORMS = st.lists(NUMBERS, min_size=12, max_size=12).map(lambda n: np.reshape(n, (3, 4)))
POINTS = st.builds(
    Point,
    name=NAMES,
    group=NAMES,
    place_mm=st.tuples(NUMBERS, NUMBERS, NUMBERS),
    diameter_mm=NUMBERS,
    colour=st.tuples(BYTES, BYTES, BYTES, BYTES),
    owner=NAMES,
)


@st.composite
def poly_lines(draw: st.DrawFn) -> PolyLines:
    count = draw(st.integers(0, 8))
    numbers = draw(st.lists(NUMBERS, min_size=3 * count, max_size=3 * count))
    index = st.integers(0, max(0, count - 1))
    lines = draw(st.lists(st.lists(index, max_size=5).map(tuple), max_size=3).map(tuple))
    scalars = draw(st.none() | st.lists(NUMBERS, min_size=count, max_size=count).map(np.array))
    name = draw(NAMES) if scalars is not None else ""
    return PolyLines(np.reshape(np.array(numbers), (count, 3)), lines, scalars, name)


@given(TRANSFORMS)
def test_a_transform_comes_back(transform: np.ndarray) -> None:
    assert np.array_equal(read_transform(pack_transform(transform)), transform)


@given(st.lists(st.tuples(NAMES, st.sampled_from(ToolKind), TRANSFORMS), max_size=3))
def test_tools_come_back(tools: list[tuple[str, ToolKind, np.ndarray]]) -> None:
    came = read_tracking_data(pack_tracking_data([Tool(*tool) for tool in tools]))
    assert [(one.name, one.kind) for one in came] == [tool[:2] for tool in tools]
    assert all(np.array_equal(a.transform, b[2]) for a, b in zip(came, tools, strict=True))


@given(st.lists(POINTS, max_size=4))
def test_points_come_back(points: list[Point]) -> None:
    assert read_points(pack_points(points)) == points


@given(poly_lines())
def test_lines_come_back(body: PolyLines) -> None:
    came = read_poly_lines(pack_poly_lines(body))
    assert np.array_equal(came.points_mm, body.points_mm)
    assert came.lines == body.lines and came.scalars_name == body.scalars_name
    if body.scalars is None:
        assert came.scalars is None
    else:
        assert came.scalars is not None and np.array_equal(came.scalars, body.scalars)


@given(st.integers(0, 65535), NAMES, st.text(max_size=80), st.integers(-(2**63), 2**63 - 1))
def test_a_status_comes_back_in_ascii(code: int, name: str, text: str, subcode: int) -> None:
    came = read_status(pack_status(StatusContent(code, name, text, subcode)))
    wanted = StatusContent(code, name, ascii_only(text).rstrip(), subcode)
    assert came == wanted


@given(st.text(max_size=200))
def test_a_string_comes_back_in_ascii(text: str) -> None:
    assert read_string(pack_string(text)) == ascii_only(text)


@given(st.integers(-5, 10_000))
def test_a_wish_for_tracking_data_comes_back(resolution_ms: int) -> None:
    assert read_start_tracking(pack_start_tracking(resolution_ms)) == max(0, resolution_ms)


@pytest.mark.parametrize(
    "read",
    [
        read_transform,
        read_tracking_data,
        read_points,
        read_poly_lines,
        read_status,
        read_string,
        read_start_tracking,
    ],
)
@given(content=st.binary(max_size=300))
def test_any_bytes_are_a_content_or_refused(
    read: Callable[[bytes], object], content: bytes
) -> None:
    with suppress(FramingError):
        read(content)


def test_sizes_are_those_of_the_protocol() -> None:
    """As its pages give them: 48 bytes, 70 a tool, 136 a point, 40 before points of POLYDATA."""
    here = np.eye(4)[:3]
    assert len(pack_transform(here)) == 48
    assert len(pack_tracking_data([Tool("Tip", ToolKind.SIX_DEGREES, here)])) == 70
    assert len(pack_points([Point("a", "b", (0.0, 0.0, 0.0), 1.0)])) == 136
    assert len(pack_poly_lines(PolyLines(np.zeros((2, 3)), ((0, 1),)))) == 40 + 24 + 12
    assert len(pack_status(StatusContent(1))) == 31
    assert len(pack_start_tracking(20)) == 36


@given(TRANSFORMS)
def test_pyigtl_reads_the_same_transform(transform: np.ndarray) -> None:
    messages = pytest.importorskip("pyigtl.messages")
    there = messages.TransformMessage()
    there._unpack_content(pack_transform(transform))
    assert np.array_equal(there.matrix[:3], transform)
    assert messages.TransformMessage(np.vstack([transform, [0, 0, 0, 1]]))._pack_content() == (
        pack_transform(transform)
    )


@given(st.lists(POINTS, min_size=1, max_size=4))
def test_pyigtl_reads_the_same_points(points: list[Point]) -> None:
    there = pytest.importorskip("pyigtl.messages").PointMessage()
    there._unpack_content(pack_points(points))
    assert there.positions == [point.place_mm for point in points]
    assert there.diameters == [point.diameter_mm for point in points]
    assert there.names == [point.name for point in points]


def test_pyigtl_writes_the_same_line() -> None:
    messages = pytest.importorskip("pyigtl.messages")
    places = np.arange(12, dtype=np.float32).reshape(4, 3)
    lines = np.array([4, 0, 1, 2, 3])
    theirs = messages.PolyDataMessage(points=places, lines=lines)._pack_content()
    assert theirs == pack_poly_lines(PolyLines(places.astype(float), ((0, 1, 2, 3),)))


def test_an_attribute_begins_after_an_even_name() -> None:
    """Names are padded: the numbers behind an odd one and behind an even one are both found."""
    for name in ("Radius", "Width"):
        body = PolyLines(np.zeros((2, 3)), ((0, 1),), np.array([1.0, 2.0]), name)
        content = pack_poly_lines(body)
        assert content.endswith(struct.pack(">2f", 1.0, 2.0)) and len(content) % 2 == 0
