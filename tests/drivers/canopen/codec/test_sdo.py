"""SDO frames, byte by byte."""

from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.canopen.codec.abort_codes import AbortCode, abort_text
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.sdo import (
    Abort,
    DownloadRequest,
    DownloadResponse,
    DownloadSegment,
    DownloadSegmentResponse,
    ExpeditedDownload,
    ExpeditedUpload,
    Request,
    Response,
    UploadRequest,
    UploadResponse,
    UploadSegment,
    UploadSegmentRequest,
    decode_request,
    decode_response,
)

REQUESTS: list[tuple[str, Request]] = [
    ("4000100000000000", UploadRequest(0x1000, 0)),
    ("4018100100000000", UploadRequest(0x1018, 1)),
    ("6000000000000000", UploadSegmentRequest(False)),
    ("7000000000000000", UploadSegmentRequest(True)),
    ("2f60600008000000", ExpeditedDownload(0x6060, 0, b"\x08")),
    ("2b1710006400 0000", ExpeditedDownload(0x1017, 0, b"\x64\x00")),
    ("27002001aabbcc00", ExpeditedDownload(0x2000, 1, b"\xaa\xbb\xcc")),
    ("237a607801000080", ExpeditedDownload(0x607A, 0x78, b"\x01\x00\x00\x80")),
    ("22406000 0f000000", ExpeditedDownload(0x6040, 0, b"\x0f\x00\x00\x00", sized=False)),
    ("2108100015000000", DownloadRequest(0x1008, 0, 21)),
    ("2008100000000000", DownloadRequest(0x1008, 0, None)),
    ("0074656e7461636c", DownloadSegment(False, b"tentacl", last=False)),
    ("1b65640000000000", DownloadSegment(True, b"ed", last=True)),
    ("80086000 22000008", Abort(0x6008, 0, AbortCode.DEVICE_STATE)),
]

RESPONSES: list[tuple[str, Response]] = [
    ("4300100092010200", ExpeditedUpload(0x1000, 0, b"\x92\x01\x02\x00")),
    ("4741600037120000", ExpeditedUpload(0x6041, 0, b"\x37\x12\x00")),
    ("4b41600037120000", ExpeditedUpload(0x6041, 0, b"\x37\x12")),
    ("4f61600008000000", ExpeditedUpload(0x6061, 0, b"\x08")),
    ("4241600037120000", ExpeditedUpload(0x6041, 0, b"\x37\x12\x00\x00", sized=False)),
    ("4108100016000000", UploadResponse(0x1008, 0, 22)),
    ("4008100000000000", UploadResponse(0x1008, 0, None)),
    ("00456d756c617465", UploadSegment(False, b"Emulate", last=False)),
    ("1d65000000000000", UploadSegment(True, b"e", last=True)),
    ("6060600000000000", DownloadResponse(0x6060, 0)),
    ("2000000000000000", DownloadSegmentResponse(False)),
    ("3000000000000000", DownloadSegmentResponse(True)),
    ("80086000 00000206", Abort(0x6008, 0, AbortCode.NO_OBJECT)),
]


@pytest.mark.parametrize(("data", "request_"), REQUESTS)
def test_requests(data: str, request_: Request) -> None:
    assert request_.encode().hex() == data.replace(" ", "")
    assert decode_request(bytes.fromhex(data)) == request_


@pytest.mark.parametrize(("data", "response"), RESPONSES)
def test_responses(data: str, response: Response) -> None:
    assert response.encode().hex() == data.replace(" ", "")
    assert decode_response(bytes.fromhex(data)) == response


@pytest.mark.parametrize("first", [0xA0, 0xC0, 0xE0])
def test_block_transfers_are_not_spoken(first: int) -> None:
    data = bytes((first, 0, 0, 0, 0, 0, 0, 0))
    with pytest.raises(CodecError):
        decode_request(data)
    with pytest.raises(CodecError):
        decode_response(data)


@pytest.mark.parametrize("length", [0, 1, 7, 9])
def test_a_frame_has_eight_bytes(length: int) -> None:
    with pytest.raises(CodecError, match="8 bytes"):
        decode_request(bytes(length))
    with pytest.raises(CodecError, match="8 bytes"):
        decode_response(bytes(length))


@pytest.mark.parametrize(
    "frame",
    [
        ExpeditedDownload(0x1000, 0, b""),
        ExpeditedDownload(0x1000, 0, bytes(5)),
        ExpeditedDownload(0x1000, 0, bytes(2), sized=False),
        DownloadSegment(False, bytes(8), last=False),
    ],
)
def test_what_does_not_fit(frame: Request) -> None:
    with pytest.raises(CodecError):
        frame.encode()


def test_aborts_say_where_and_why() -> None:
    assert str(Abort(0x1A00, 1, 0x08000022)) == (
        "0x1A00:01: 0x08000022 (data cannot be transferred or stored in the present device state)"
    )
    assert abort_text(0x12345678) == "unknown abort code"
    assert all(abort_text(code) != "unknown abort code" for code in AbortCode)


indices, subindices = st.integers(0, 0xFFFF), st.integers(0, 0xFF)
small = st.binary(min_size=1, max_size=4)
segments = st.binary(max_size=7)
sizes = st.none() | st.integers(0, 0xFFFFFFFF)
aborts = st.builds(Abort, indices, subindices, st.integers(0, 0xFFFFFFFF))


@given(
    st.one_of(
        st.builds(UploadRequest, indices, subindices),
        st.builds(UploadSegmentRequest, st.booleans()),
        st.builds(ExpeditedDownload, indices, subindices, small),
        st.builds(DownloadRequest, indices, subindices, sizes),
        st.builds(DownloadSegment, st.booleans(), segments, st.booleans()),
        aborts,
    )
)
def test_requests_survive(request_: Request) -> None:
    assert decode_request(request_.encode()) == request_


@given(
    st.one_of(
        st.builds(ExpeditedUpload, indices, subindices, small),
        st.builds(UploadResponse, indices, subindices, sizes),
        st.builds(UploadSegment, st.booleans(), segments, st.booleans()),
        st.builds(DownloadResponse, indices, subindices),
        st.builds(DownloadSegmentResponse, st.booleans()),
        aborts,
    )
)
def test_responses_survive(response: Response) -> None:
    assert decode_response(response.encode()) == response


@given(st.binary(max_size=10))
def test_any_bytes_are_a_frame_or_an_error(data: bytes) -> None:
    with suppress(CodecError):
        decode_request(data)
    with suppress(CodecError):
        decode_response(data)
