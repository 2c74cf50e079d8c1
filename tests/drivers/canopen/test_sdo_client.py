"""Transfers to a node that answers by the rules, late, wrongly, or not at all."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.canopen.codec.abort_codes import AbortCode
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
)
from drivers.canopen.sdo_client import (
    LONGEST_OBJECT_BYTES,
    SdoAbortedError,
    SdoClient,
    SdoTimeoutError,
)
from sim_backends.virtual_time import run_in_virtual_time

NODE = 5


class Server:
    """A node that keeps objects, with hooks to misbehave."""

    def __init__(self) -> None:
        self.objects: dict[tuple[int, int], bytes] = {}
        self.requests: list[Request] = []
        self.answer: Callable[[Request], list[tuple[float, Response]]] = self.by_the_rules
        self.client = SdoClient(NODE, self.receive)
        self._at = (0, 0)
        self._data = bytearray()

    def receive(self, can_id: int, data: bytes) -> bool:
        assert can_id == 0x600 + NODE
        request = decode_request(data)
        self.requests.append(request)
        loop = asyncio.get_running_loop()
        for delay_s, response in self.answer(request):
            loop.call_later(delay_s, self.client.receive, response.encode(), 0)
        return True

    def by_the_rules(self, request: Request) -> list[tuple[float, Response]]:
        response = self._response(request)
        return [] if response is None else [(0.002, response)]

    def _response(self, request: Request) -> Response | None:
        match request:
            case ExpeditedDownload(index, subindex, data):
                self.objects[index, subindex] = data
                return DownloadResponse(index, subindex)
            case DownloadRequest(index, subindex):
                self._at, self._data = (index, subindex), bytearray()
                return DownloadResponse(index, subindex)
            case DownloadSegment(toggle, data, last):
                self._data += data
                if last:
                    self.objects[self._at] = bytes(self._data)
                return DownloadSegmentResponse(toggle)
            case UploadRequest(index, subindex):
                found = self.objects.get((index, subindex))
                if found is None:
                    return Abort(index, subindex, AbortCode.NO_OBJECT)
                if 1 <= len(found) <= 4:
                    return ExpeditedUpload(index, subindex, found)
                self._data = bytearray(found)
                return UploadResponse(index, subindex, len(found))
            case UploadSegmentRequest(toggle):
                segment, self._data = bytes(self._data[:7]), self._data[7:]
                return UploadSegment(toggle, segment, not self._data)
        return None


def with_server(test: Callable[[Server], Coroutine[Any, Any, None]]) -> None:
    async def run() -> None:
        await test(Server())

    run_in_virtual_time(run())


@settings(deadline=None)
@given(st.binary(max_size=100))
def test_what_is_written_is_read_back_in_one_frame_or_in_segments(data: bytes) -> None:
    async def test(server: Server) -> None:
        await server.client.write(0x2000, 1, data)
        assert server.objects[0x2000, 1] == data
        assert await server.client.read(0x2000, 1) == data

    with_server(test)


def test_an_abort_is_an_error_with_its_code_and_its_place() -> None:
    async def test(server: Server) -> None:
        with pytest.raises(SdoAbortedError, match=r"0x2001:00: 0x06020000 .*does not exist") as e:
            await server.client.read(0x2001)
        assert e.value.code == AbortCode.NO_OBJECT

    with_server(test)


def test_a_silent_node_is_asked_three_times_then_told_and_given_up() -> None:
    async def test(server: Server) -> None:
        server.answer = lambda _: []
        with pytest.raises(SdoTimeoutError, match=r"node 5 0x1000:00: no answer within 3 x 0.2 s"):
            await server.client.read(0x1000)
        assert server.requests == [UploadRequest(0x1000, 0)] * 3 + [
            Abort(0x1000, 0, AbortCode.TIMEOUT)
        ]
        assert server.client.timeouts == 3

    with_server(test)


def test_a_lost_answer_is_asked_for_again() -> None:
    async def test(server: Server) -> None:
        server.objects[0x6041, 0] = b"\x37\x06"
        server.answer = lambda request: (
            [] if len(server.requests) == 1 else server.by_the_rules(request)
        )
        assert await server.client.read(0x6041) == b"\x37\x06"
        assert server.client.timeouts == 1

    with_server(test)


def test_a_late_answer_is_not_taken_for_the_next_one() -> None:
    async def test(server: Server) -> None:
        server.objects.update({(0x1000, 0): b"\x92\x01\x00\x00", (0x6041, 0): b"\x40\x02"})

        def late(request: Request) -> list[tuple[float, Response]]:
            delay_s = 0.65 if request == UploadRequest(0x1000, 0) else 0.1
            return [(delay_s, response) for _, response in server.by_the_rules(request)]

        server.answer = late
        with pytest.raises(SdoTimeoutError):
            await server.client.read(0x1000)
        assert await server.client.read(0x6041) == b"\x40\x02"
        assert server.client.discarded >= 1

    with_server(test)


def one_at_a_time(server: Server, read_s: float, write_s: float) -> None:
    """Requests wait for each other in the node, and each takes its time."""
    free_s = 0.0

    def answer(request: Request) -> list[tuple[float, Response]]:
        nonlocal free_s
        now_s = asyncio.get_running_loop().time()
        takes_s = read_s if isinstance(request, UploadRequest) else write_s
        free_s = max(now_s, free_s) + takes_s
        return [(free_s - now_s, response) for _, response in server.by_the_rules(request)]

    server.answer = answer


def test_a_slow_write_s_second_answer_is_not_taken_for_that_to_the_read_after_it() -> None:
    async def test(server: Server) -> None:
        one_at_a_time(server, read_s=0.002, write_s=0.25)
        for value in (b"\x01", b"\x02", b"\x03"):
            await server.client.write(0x6065, 0, value)
            assert await server.client.read(0x6065) == value

    with_server(test)


def test_the_answer_to_a_transfer_that_was_cancelled_does_not_end_the_next_one() -> None:
    async def test(server: Server) -> None:
        server.objects[0x6065, 0] = b"\x01"
        one_at_a_time(server, read_s=0.15, write_s=0.002)
        with pytest.raises(TimeoutError):
            async with asyncio.timeout(0.1):
                await server.client.read(0x6065)
        await server.client.write(0x6065, 0, b"\x02")
        assert server.objects[0x6065, 0] == b"\x02"
        assert server.client.discarded == 1

    with_server(test)


def test_segments_of_a_toggle_that_does_not_alternate_end_the_transfer() -> None:
    async def test(server: Server) -> None:
        server.objects[0x1008, 0] = b"a long device name"

        def stuck(request: Request) -> list[tuple[float, Response]]:
            answers = server.by_the_rules(request)
            if isinstance(request, UploadSegmentRequest):
                return [(0.001, UploadSegment(False, b"a long ", False))]
            return answers

        server.answer = stuck
        with pytest.raises(SdoAbortedError) as error:
            await server.client.read(0x1008)
        assert error.value.code == AbortCode.TOGGLE_NOT_ALTERNATED
        assert server.requests[-1] == Abort(0x1008, 0, AbortCode.TOGGLE_NOT_ALTERNATED)

    with_server(test)


def test_an_object_of_another_length_than_was_announced_is_not_believed() -> None:
    async def test(server: Server) -> None:
        server.objects[0x1008, 0] = b"a long device name"

        def cut_off(request: Request) -> list[tuple[float, Response]]:
            if isinstance(request, UploadRequest):
                server.by_the_rules(request)
                return [(0.001, UploadResponse(0x1008, 0, 30))]
            return server.by_the_rules(request)

        server.answer = cut_off
        with pytest.raises(SdoAbortedError) as error:
            await server.client.read(0x1008)
        assert error.value.code == AbortCode.LENGTH_MISMATCH
        assert server.requests[-1] == Abort(0x1008, 0, AbortCode.LENGTH_MISMATCH)

    with_server(test)


def test_four_bytes_of_which_a_node_does_not_say_how_many_count_are_cut_to_the_object() -> None:
    async def test(server: Server) -> None:
        server.answer = lambda _: [(0.001, ExpeditedUpload(0x6061, 0, b"\x08\0\0\0", False))]
        assert await server.client.read(0x6061, size=1) == b"\x08"
        assert await server.client.read(0x6061) == b"\x08\0\0\0"

    with_server(test)


def test_an_object_without_end_is_given_up() -> None:
    async def test(server: Server) -> None:
        server.objects[0x2000, 0] = bytes(5)

        def endless(request: Request) -> list[tuple[float, Response]]:
            if isinstance(request, UploadSegmentRequest):
                return [(0.0, UploadSegment(request.toggle, bytes(7), False))]
            return server.by_the_rules(request)

        server.answer = endless
        with pytest.raises(SdoAbortedError) as error:
            await server.client.read(0x2000)
        assert error.value.code == AbortCode.OUT_OF_MEMORY
        assert len(server.requests) < LONGEST_OBJECT_BYTES / 7 + 10

    with_server(test)


def test_an_answer_of_the_wrong_kind_ends_the_transfer() -> None:
    async def test(server: Server) -> None:
        server.answer = lambda _: [(0.001, DownloadResponse(0x1000, 0))]
        with pytest.raises(SdoAbortedError) as error:
            await server.client.read(0x1000)
        assert error.value.code == AbortCode.COMMAND_INVALID

    with_server(test)


@given(st.binary(max_size=16))
def test_stray_frames_are_counted_and_change_nothing(data: bytes) -> None:
    async def test(server: Server) -> None:
        server.client.receive(data, 0)
        assert server.client.discarded == 1

    with_server(test)


def test_transfers_to_one_node_wait_for_each_other() -> None:
    async def test(server: Server) -> None:
        server.objects.update({(0x1000, n): bytes([n]) for n in range(8)})
        values = await asyncio.gather(*(server.client.read(0x1000, n) for n in range(8)))
        assert values == [bytes([n]) for n in range(8)]
        assert len(server.requests) == 8

    with_server(test)
