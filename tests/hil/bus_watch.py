"""What goes over the emulated bus, as another node on it sees it."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from drivers.can.frame import FRAME_BYTES, CanFrame, pack_frame, unpack_frame
from drivers.canopen.codec import cob_ids
from drivers.canopen.codec.sdo import UploadRequest
from drivers.cia402.objects import STATUSWORD
from drivers.cia402.power_state import PowerState, power_state
from tests.hil.daemon_rig import NODES
from tests.hil.processes import PATIENCE_S

_EMERGENCY: Final = 0x080
_RPDO: Final = 0x200


class BusWatch:
    """Another node on the emulated bus: what goes over it, and when (monotonic, s)."""

    def __init__(self, folder: Path) -> None:
        self.frames: list[tuple[float, int, bytes]] = []
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket.connect(str(folder / "can0.sock"))
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def close(self) -> None:
        with suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._socket.close()

    def emergencies(self, since_s: float) -> dict[int, tuple[float, int]]:
        """By node: when its first one came since then, and its code."""
        found: dict[int, tuple[float, int]] = {}
        for at_s, can_id, data in list(self.frames):
            node = can_id - _EMERGENCY
            if at_s >= since_s and node in NODES and len(data) >= 2:
                found.setdefault(node, (at_s, int.from_bytes(data[:2], "little")))
        return found

    def controlwords(self, since_s: float) -> list[tuple[float, int, int]]:
        """Time, node and controlword of all that the master has sent since then."""
        return [
            (at_s, can_id - _RPDO, int.from_bytes(data[:2], "little"))
            for at_s, can_id, data in list(self.frames)
            if at_s >= since_s and can_id - _RPDO in NODES
        ]

    def power_states(self) -> dict[int, PowerState]:
        """What every drive answers when it is asked for its statusword."""
        since_s = time.monotonic()
        for node in NODES:
            request = UploadRequest(STATUSWORD, 0).encode()
            self._socket.send(pack_frame(CanFrame(cob_ids.sdo_request(node), request)))
        deadline_s = since_s + PATIENCE_S
        found: dict[int, PowerState] = {}
        while len(found) < len(NODES):
            assert time.monotonic() < deadline_s, f"only {sorted(found)} have answered"
            time.sleep(0.005)
            for at_s, can_id, data in list(self.frames):
                node = can_id - cob_ids.sdo_response(NODES[0]) + NODES[0]
                asked = int.from_bytes(data[1:3], "little") == STATUSWORD
                if at_s >= since_s and node in NODES and len(data) == 8 and asked:
                    found[node] = power_state(int.from_bytes(data[4:6], "little"))
        return found

    def _read(self) -> None:
        with suppress(OSError):
            while packet := self._socket.recv(FRAME_BYTES + 1):
                if len(packet) == FRAME_BYTES:
                    can_id, data = unpack_frame(packet)
                    self.frames.append((time.monotonic(), can_id, data))


@contextmanager
def bus_watch(folder: Path) -> Iterator[BusWatch]:
    one = BusWatch(folder)
    try:
        yield one
    finally:
        one.close()
