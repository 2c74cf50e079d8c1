"""The emulated tracker on a bench: commands go in, replies come out, time is ours."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from config.emulation.lab import EmulatedTool, EmulatedTracker
from drivers.aurora.codec.commands import encode_command
from drivers.aurora.codec.replies import Reply, TextReply
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.pose import Pose
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.faults import understand

UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])
TIP = EmulatedTool(attached_to="tip", port=1, serial="3C112801")
BASE = EmulatedTool(attached_to="base", port=2, serial="3C112802")
EXACT: Mapping[str, Any] = {
    "distortion_rms_mm": 0.0,
    "distortion_rms_rad": 0.0,
    "jitter_mm": 0.0,
    "jitter_rad": 0.0,
    "outliers_per_s": 0.0,
}
S = 1_000_000_000


def still(t_ns: int) -> Mapping[str, Pose]:
    """A tip 150 mm above the base."""
    return {
        "tip": Pose(np.array([0.0, 0.0, 150.0]), UPRIGHT),
        "base": Pose(np.zeros(3), UPRIGHT),
    }


class Bench:
    """One device, talked to at the rate it has."""

    def __init__(self, *tools: EmulatedTool, seed: int = 0, **settings: Any) -> None:
        config = EmulatedTracker(tools=list(tools or (TIP, BASE)), **{**EXACT, **settings})
        self.device = EmulatedAurora(config, still, seed)
        self.device.port.output = self._hear
        self.t_ns = 0
        self.outputs: list[tuple[int, bytes, int]] = []
        """Host time, bytes, and the rate they were sent at."""

    def _hear(self, data: bytes, baud_rate: int) -> None:
        self.outputs.append((self.device._agenda.now_ns, data, baud_rate))

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        self.t_ns += round(seconds * S)
        self.device.advance(self.t_ns)

    def send(self, data: bytes, baud_rate: int | None = None) -> None:
        """Send bytes, at the device's own rate unless said otherwise."""
        self.device.receive(data, baud_rate or self.device.line.baud_rate, self.t_ns)

    def replies(self) -> list[Reply]:
        """All that came since the last call, read at the right rate."""
        reader, found = ReplyReader(), []
        for _, data, _ in self.outputs:
            found += reader.feed(data)
        self.outputs.clear()
        return found

    def ask(self, text: str, wait_s: float = 0.5) -> str:
        """The reply to `WORD:arguments`; nothing where none comes."""
        word, _, arguments = text.partition(":")
        self.replies()
        self.send(encode_command(word, arguments))
        self.wait(wait_s)
        found = self.replies()
        assert len(found) <= 1
        if not found:
            return ""
        assert isinstance(found[0], TextReply), found
        return found[0].text

    def set_up(self, *enabled: str) -> None:
        """Initialise, and bring the tools up to PENA."""
        assert self.ask("INIT:") == "OKAY"
        while (handles := self.ask("PHSR:02")) != "00":
            for at in range(2, len(handles), 5):
                assert self.ask(f"PINIT:{handles[at : at + 2]}") == "OKAY"
        for handle in enabled or ("0A", "0B"):
            assert self.ask(f"PENA:{handle}D") == "OKAY"

    def inject(self, order: str) -> None:
        """Carry out a fault: `bad_crc=3`."""
        understand({"tracker": self.device}, f"tracker.{order}").carry_out(self.t_ns)
