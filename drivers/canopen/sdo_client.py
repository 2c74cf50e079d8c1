"""Reading and writing a node's objects over SDO, one transfer at a time.

A transfer is a generator: it yields what to send and is sent what came back, so the whole protocol
reads from top to bottom and knows neither a bus nor a clock. `SdoClient` runs it on a bus.
"""

import asyncio
from collections.abc import Callable, Generator
from typing import Final, TypeVar

from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.abort_codes import AbortCode
from drivers.canopen.codec.error import CodecError
from drivers.canopen.codec.sdo import (
    EXPEDITED_BYTES,
    SEGMENT_BYTES,
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
    decode_response,
)

LONGEST_OBJECT_BYTES: Final = 65_536

T = TypeVar("T")

Upload = Generator[Request, Response, bytes]
Download = Generator[Request, Response, None]


class SdoError(RuntimeError):
    """An object could not be read or written; the text says which and why."""


class SdoAbortedError(SdoError):
    """The node refused, or what it answered was refused. `code` is the abort code."""

    def __init__(self, abort: Abort, why: str = "") -> None:
        super().__init__(f"{abort}{why}")
        self.code = abort.code


class SdoViolatedError(SdoAbortedError):
    """The node answered against the protocol, and we have refused that."""

    def __init__(self, abort: Abort) -> None:
        super().__init__(abort, "; its answer is none to this")


class SdoTimeoutError(SdoError):
    """The node did not answer."""


class _ProtocolError(Exception):
    """The node answered against the protocol: we abort with `code`."""

    def __init__(self, code: AbortCode) -> None:
        super().__init__(code)
        self.code = code


def upload(index: int, subindex: int, size: int | None = None) -> Upload:
    """Read an object, in one frame or in segments. size: what it has, for a node that sends four
    bytes and does not say how many of them count."""
    response = yield UploadRequest(index, subindex)
    if isinstance(response, ExpeditedUpload):
        return response.data if response.sized else response.data[:size]
    if not isinstance(response, UploadResponse):
        raise _ProtocolError(AbortCode.COMMAND_INVALID)
    announced, data, toggle, last = response.size, bytearray(), False, False
    while not last:
        response = yield UploadSegmentRequest(toggle)
        if not isinstance(response, UploadSegment):
            raise _ProtocolError(AbortCode.COMMAND_INVALID)
        if response.toggle != toggle:
            raise _ProtocolError(AbortCode.TOGGLE_NOT_ALTERNATED)
        data += response.data
        if len(data) > LONGEST_OBJECT_BYTES:
            raise _ProtocolError(AbortCode.OUT_OF_MEMORY)
        toggle, last = not toggle, response.last
    if announced is not None and len(data) != announced:
        raise _ProtocolError(AbortCode.LENGTH_MISMATCH)
    return bytes(data)


def download(index: int, subindex: int, data: bytes) -> Download:
    """Write an object, in one frame or in segments."""
    if 1 <= len(data) <= EXPEDITED_BYTES:
        response = yield ExpeditedDownload(index, subindex, data)
        if not isinstance(response, DownloadResponse):
            raise _ProtocolError(AbortCode.COMMAND_INVALID)
        return
    response = yield DownloadRequest(index, subindex, len(data))
    if not isinstance(response, DownloadResponse):
        raise _ProtocolError(AbortCode.COMMAND_INVALID)
    toggle = False
    for start in range(0, len(data) or 1, SEGMENT_BYTES):
        segment = data[start : start + SEGMENT_BYTES]
        response = yield DownloadSegment(toggle, segment, start + SEGMENT_BYTES >= len(data))
        if not isinstance(response, DownloadSegmentResponse):
            raise _ProtocolError(AbortCode.COMMAND_INVALID)
        if response.toggle != toggle:
            raise _ProtocolError(AbortCode.TOGGLE_NOT_ALTERNATED)
        toggle = not toggle


class SdoClient:
    """The SDO channel to one node. Transfers queue up; an unanswered one is tried again."""

    def __init__(
        self,
        node: int,
        send: Callable[[int, bytes], bool],
        *,
        timeout_s: float = 0.2,
        attempts: int = 3,
    ) -> None:
        self.response_id = cob_ids.sdo_response(node)
        self.timeouts = 0
        self.discarded = 0
        """Answers to nothing that is being asked: late ones, mostly."""
        self.unasked = 0
        """Of these, those that are not late: somebody has answered twice."""
        self._node = node
        self._request_id = cob_ids.sdo_request(node)
        self._send = send
        self._timeout_s = timeout_s
        self._attempts = attempts
        self._one_at_a_time = asyncio.Lock()
        self._requested: tuple[int, int] | None = None
        self._request: Request | None = None
        self._owed = 0
        """Requests that were given up: so many answers may come yet, and are not the next one's."""
        self._answer: asyncio.Future[Response] | None = None

    async def read(self, index: int, subindex: int = 0, size: int | None = None) -> bytes:
        """The bytes of an object. size: how many it has, where that is known. Raises SdoError."""
        async with self._one_at_a_time:
            return await self._run(index, subindex, lambda: upload(index, subindex, size))

    async def write(self, index: int, subindex: int, data: bytes) -> None:
        """Set an object. Raises SdoError."""
        async with self._one_at_a_time:
            await self._run(index, subindex, lambda: download(index, subindex, data))

    def receive(self, data: bytes, t_ns: int) -> None:
        """A frame from the node's SDO server. Never raises."""
        del t_ns
        try:
            response = decode_response(data)
        except CodecError:
            self.discarded += 1
            return
        waiting = self._answer is not None and not self._answer.done()
        late = self._owed > 0 and not _answers(self._request, response)
        if self._answer is None or not waiting or late or not self._is_for_us(response):
            self.discarded += 1
            self.unasked += not self._owed
            self._owed = max(0, self._owed - 1)
            return
        self._answer.set_result(response)

    def _is_for_us(self, response: Response) -> bool:
        if isinstance(response, UploadSegment | DownloadSegmentResponse):
            return isinstance(self._request, UploadSegmentRequest | DownloadSegment)
        return (response.index, response.subindex) == self._requested

    async def _run(
        self, index: int, subindex: int, transfer: Callable[[], Generator[Request, Response, T]]
    ) -> T:
        self._requested = (index, subindex)
        try:
            for attempt in range(1, self._attempts + 1):
                try:
                    return await self._attempt(transfer())
                except TimeoutError:
                    self.timeouts += 1
                    if attempt < self._attempts:
                        continue
                    self._transmit(Abort(index, subindex, AbortCode.TIMEOUT))
                except _ProtocolError as error:
                    abort = Abort(index, subindex, error.code)
                    self._transmit(abort)
                    raise SdoViolatedError(abort) from None
            where = f"node {self._node} 0x{index:04X}:{subindex:02X}"
            waited = f"{self._attempts} x {self._timeout_s:g} s"
            raise SdoTimeoutError(f"{where}: no answer within {waited}")
        finally:
            self._requested = self._request = self._answer = None

    async def _attempt(self, transfer: Generator[Request, Response, T]) -> T:
        request = next(transfer)
        while True:
            self._request = request
            self._answer = asyncio.get_running_loop().create_future()
            self._transmit(request)
            try:
                async with asyncio.timeout(self._timeout_s):
                    response = await self._answer
            except (TimeoutError, asyncio.CancelledError):
                self._owed += 1
                raise
            if isinstance(response, Abort):
                raise SdoAbortedError(response)
            try:
                request = transfer.send(response)
            except StopIteration as end:
                return end.value  # type: ignore[no-any-return]

    def _transmit(self, request: Request) -> None:
        self._send(self._request_id, request.encode())


def _answers(request: Request | None, response: Response) -> bool:
    """Whether a node that keeps to the protocol may say this to `request`."""
    match request:
        case UploadSegmentRequest(toggle):
            fits = isinstance(response, UploadSegment) and response.toggle == toggle
        case DownloadSegment(toggle):
            fits = isinstance(response, DownloadSegmentResponse) and response.toggle == toggle
        case UploadRequest():
            fits = isinstance(response, ExpeditedUpload | UploadResponse)
        case _:
            fits = isinstance(response, DownloadResponse)
    return fits or isinstance(response, Abort)
