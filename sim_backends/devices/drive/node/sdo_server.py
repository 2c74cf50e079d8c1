"""The SDO server: answers one request at a time, some milliseconds after it came."""

from collections.abc import Callable
from dataclasses import dataclass

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
    decode_request,
)
from sim_backends.devices.can.port import Port
from sim_backends.devices.drive.node.object_dictionary import (
    MAX_OBJECT_BYTES,
    ObjectDictionary,
    SdoAbortError,
)


@dataclass
class _Transfer:
    """A segmented transfer under way: what is still to be sent, or what has come so far."""

    index: int
    subindex: int
    download: bool
    data: bytearray
    size: int | None = None
    toggle: bool = False


@dataclass
class SdoTrouble:
    """What a fault makes the server do."""

    silent: bool = False
    late_ns: int = 0
    abort_code: int = 0
    aborts: int = 0
    """Requests still to be aborted with `abort_code`."""
    toggle_errors: int = 0
    """Segments still to be sent with the wrong toggle bit."""


class SdoServer:
    """Answers under `can_id`. delay_ns(): how long the next answer takes."""

    def __init__(
        self,
        objects: ObjectDictionary,
        port: Port,
        can_id: int,
        delay_ns: Callable[[], int],
    ) -> None:
        self._objects = objects
        self._port = port
        self._can_id = can_id
        self._delay_ns = delay_ns
        self._transfer: _Transfer | None = None
        self._busy_until_ns = 0
        self.extra_delay_ns = 0
        """Added to the next answer: what the access at hand takes, like storing parameters."""
        self.trouble = SdoTrouble()

    def stop(self) -> None:
        """Forget the transfer under way."""
        self._transfer = None
        self._busy_until_ns = 0

    def received(self, _can_id: int, data: bytes, t_ns: int) -> None:
        """A frame from a client. One that comes before the last answer is lost."""
        if self.trouble.silent or t_ns < self._busy_until_ns:
            return
        answer = self._answer(data, t_ns)
        if answer is None:
            return
        delay_ns = self._delay_ns() + self.extra_delay_ns + self.trouble.late_ns
        self.extra_delay_ns = 0
        self._busy_until_ns = t_ns + delay_ns
        self._port.send(self._can_id, answer.encode(), t_ns + delay_ns)

    def _answer(self, data: bytes, t_ns: int) -> Response | None:
        try:
            request = decode_request(data)
        except CodecError:
            return self._undecodable(data)
        if isinstance(request, Abort):
            self._transfer = None
            return None
        try:
            return self._carry_out(request, t_ns)
        except SdoAbortError as refusal:
            index, subindex = _object_of(request, self._transfer)
            self._transfer = None
            return Abort(index, subindex, refusal.code)

    def _undecodable(self, data: bytes) -> Response | None:
        """Block transfers and unknown commands are refused; a frame of another length is none."""
        if len(data) != 8:
            return None
        self._transfer = None
        index = int.from_bytes(data[1:3], "little")
        return Abort(index, data[3], AbortCode.COMMAND_INVALID)

    def _carry_out(self, request: Request, t_ns: int) -> Response:
        trouble = self.trouble
        if trouble.aborts > 0:
            trouble.aborts -= 1
            index, subindex = _object_of(request, self._transfer)
            self._transfer = None
            return Abort(index, subindex, trouble.abort_code)
        match request:
            case UploadRequest(index, subindex):
                return self._begin_upload(index, subindex, t_ns)
            case ExpeditedDownload(index, subindex, data, sized):
                self._transfer = None
                self._objects.download(index, subindex, data, sized, t_ns)
                return DownloadResponse(index, subindex)
            case DownloadRequest(index, subindex, size):
                return self._begin_download(index, subindex, size)
            case UploadSegmentRequest(toggle):
                return self._upload_segment(toggle)
            case DownloadSegment():
                return self._download_segment(request, t_ns)
        raise SdoAbortError(AbortCode.COMMAND_INVALID)

    def _begin_upload(self, index: int, subindex: int, t_ns: int) -> Response:
        self._transfer = None
        data = self._objects.upload(index, subindex, t_ns)
        if 0 < len(data) <= EXPEDITED_BYTES:
            return ExpeditedUpload(index, subindex, data)
        self._transfer = _Transfer(index, subindex, False, bytearray(data))
        return UploadResponse(index, subindex, len(data))

    def _upload_segment(self, toggle: bool) -> Response:
        transfer = self._next_segment(toggle, download=False)
        piece = bytes(transfer.data[:SEGMENT_BYTES])
        del transfer.data[:SEGMENT_BYTES]
        last = not transfer.data
        if last:
            self._transfer = None
        if self.trouble.toggle_errors > 0:
            self.trouble.toggle_errors -= 1
            toggle = not toggle
        return UploadSegment(toggle, piece, last)

    def _begin_download(self, index: int, subindex: int, size: int | None) -> Response:
        self._transfer = None
        self._objects.writable(index, subindex)
        if size is not None and size > MAX_OBJECT_BYTES:
            raise SdoAbortError(AbortCode.TOO_LONG)
        self._transfer = _Transfer(index, subindex, True, bytearray(), size)
        return DownloadResponse(index, subindex)

    def _download_segment(self, segment: DownloadSegment, t_ns: int) -> Response:
        transfer = self._next_segment(segment.toggle, download=True)
        transfer.data += segment.data
        if len(transfer.data) > MAX_OBJECT_BYTES:
            raise SdoAbortError(AbortCode.OUT_OF_MEMORY)
        if segment.last:
            if transfer.size is not None and len(transfer.data) != transfer.size:
                raise SdoAbortError(AbortCode.LENGTH_MISMATCH)
            data = bytes(transfer.data)
            self._objects.download(transfer.index, transfer.subindex, data, True, t_ns)
            self._transfer = None
        return DownloadSegmentResponse(segment.toggle)

    def _next_segment(self, toggle: bool, *, download: bool) -> _Transfer:
        transfer = self._transfer
        if transfer is None or transfer.download != download:
            raise SdoAbortError(AbortCode.COMMAND_INVALID)
        if toggle != transfer.toggle:
            raise SdoAbortError(AbortCode.TOGGLE_NOT_ALTERNATED)
        transfer.toggle = not transfer.toggle
        return transfer


def _object_of(request: Request, transfer: _Transfer | None) -> tuple[int, int]:
    """Which object a request is about, for the abort that answers it."""
    if isinstance(request, UploadRequest | ExpeditedDownload | DownloadRequest):
        return request.index, request.subindex
    return (0, 0) if transfer is None else (transfer.index, transfer.subindex)
