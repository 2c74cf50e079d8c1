"""The real driver and the emulated tracker on a wire in virtual time."""

import asyncio
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager, suppress
from typing import Any

import numpy as np

from config.emulation.lab import EmulatedTool, EmulatedTracker
from config.tracker import ToolSelector, Tracker
from drivers.aurora.codec.commands import encode_command
from drivers.aurora.frame import TrackerFrame
from drivers.aurora.link import Direction
from drivers.aurora.tracker import AuroraTracker, TrackerState
from drivers.conditions import ConditionChange
from drivers.pose import Pose
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.aurora.wires import aurora_stream_opener
from sim_backends.faults import understand
from sim_backends.virtual_time import virtual_clock

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
"""A tracker without errors."""


def emulated(*tools: EmulatedTool, **settings: Any) -> EmulatedTracker:
    """An emulated tracker; tip and base are plugged in where nothing else is said."""
    return EmulatedTracker(tools=list(tools or (TIP, BASE)), **settings)


def configured(**settings: Any) -> Tracker:
    """The driver's configuration for it."""
    tools = {"tip": ToolSelector(port=1), "base": ToolSelector(port=2)}
    return Tracker(**{"port": "lab:aurora", "tools": tools} | settings)


def telltale_poses(t_ns: int) -> Mapping[str, Pose]:
    """A tip whose x (1 mm per s, modulo 100 s) tells when it was measured."""
    tip_mm = np.array([t_ns * 1e-9 % 100.0, 0.0, 150.0])
    return {"tip": Pose(tip_mm, UPRIGHT), "base": Pose(np.zeros(3), UPRIGHT)}


def measured_s(frame: TrackerFrame) -> float:
    """When the emulated tracker measured this frame, modulo 100 s, as its tip tells."""
    assert frame.tip is not None
    return float(frame.tip.position_mm[0])


class Rig:
    """One tracker and its driver, and all that came out."""

    def __init__(
        self,
        device_config: EmulatedTracker | None = None,
        config: Tracker | None = None,
        seed: int = 0,
    ) -> None:
        self.clock = virtual_clock()
        self.device = EmulatedAurora(device_config or emulated(**EXACT), telltale_poses, seed)
        self.open_stream = aurora_stream_opener(self.device, self.clock)
        self.frames: list[TrackerFrame] = []
        self.changes: list[ConditionChange] = []
        self.traffic: list[tuple[Direction, bytes, int]] = []
        self.tracker = AuroraTracker(
            config or configured(),
            self.open_stream,
            self.clock,
            self.frames.append,
            self.changes.append,
            lambda direction, data, t_ns: self.traffic.append((direction, data, t_ns)),
        )

    def inject(self, order: str) -> None:
        """Carry out a fault: `bad_crc=3`."""
        understand({"tracker": self.device}, f"tracker.{order}").carry_out(self.clock.now_ns())

    def raised(self) -> set[str]:
        """Names of all conditions that were ever raised."""
        return {change.active.condition.name for change in self.changes if change.present}

    def holding(self) -> set[str]:
        """Names of those that hold now."""
        return {active.condition.name for active in self.tracker.status.conditions}

    def sent(self) -> list[bytes]:
        """The commands that the driver sent."""
        return [data for direction, data, _ in self.traffic if direction == "to_device"]


class Ears:
    """A receiver that only listens."""

    def __init__(self) -> None:
        self.heard = bytearray()
        self.lost: OSError | None = None

    def bytes_received(self, data: bytes, t_ns: int) -> None:
        self.heard += data

    def stream_lost(self, error: OSError) -> None:
        self.lost = error


async def leave_behind(rig: Rig, *commands: tuple[str, int], wait_s: float = 0.5) -> bytes:
    """Be an earlier client that sends these commands at these rates and goes without a word.

    Returns what it heard. It goes `wait_s` after its last command.
    """
    ears = Ears()
    stream = await rig.open_stream(ears)
    for index, (command, baud_rate) in enumerate(commands):
        word, _, arguments = command.partition(":")
        stream.set_baud_rate(baud_rate)
        stream.write(encode_command(word, arguments))
        await asyncio.sleep(wait_s if index + 1 == len(commands) else 0.5)
    stream.close()
    return bytes(ears.heard)


@asynccontextmanager
async def running(rig: Rig) -> AsyncIterator[None]:
    """The driver at work; cancelled at the end."""
    task = asyncio.create_task(rig.tracker.run())
    try:
        yield
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task


def is_tracking(rig: Rig) -> bool:
    return rig.tracker.status.state is TrackerState.TRACKING


async def until_tracking(rig: Rig, within_s: float = 30.0) -> None:
    """Wait until frames come."""
    async with asyncio.timeout(within_s):
        before = len(rig.frames)
        while not is_tracking(rig) or len(rig.frames) == before:
            await asyncio.sleep(0.01)
