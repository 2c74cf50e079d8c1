"""From the tracker's bytes to a pose: CPU time of decoding, and a live tracker on a pty."""

import asyncio
import json
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from config.tracker import ToolSelector, Tracker
from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.aurora.codec.replies import BinaryReply, encode_binary_reply
from drivers.aurora.codec.reply_reader import ReplyReader
from drivers.aurora.codec.tracking_data import TrackingData, decode_bx, encode_bx
from drivers.aurora.frame import FrameAssembler, TrackerFrame
from drivers.aurora.frame_clock import FrameClock
from drivers.aurora.tracker import AuroraTracker
from drivers.serial_port import serial_port_opener
from tests.benchmarks.timing import Figures, end_process, percentiles, pieces
from tests.drivers.aurora.golden import TOOL_A, TOOL_B

REPLIES = 10_000
MEASURED_S = 8.0
_WARM_FRAMES = 80
_BARE = struct.Struct("<7f")


LINES = ((2, 115200), (4, 115200), (2, 921600))
"""Sensors, and baud rate."""
_COMES_WITHIN_S = 120.0
"""The first frames. On a busy machine the port has to be opened several times."""


def measure(tiny: bool = False) -> Figures:
    """All figures of the tracker."""
    lines, measured_s = (LINES[:1], 0.5) if tiny else (LINES, MEASURED_S)
    named = {"decode_2_tools": partial(decoding, 100 if tiny else REPLIES)}
    for tools, baud_rate in lines:
        named[f"live_{tools}_tools_{baud_rate}_baud"] = partial(live, tools, baud_rate, measured_s)
    return pieces(named)


def live(tools: int, baud_rate: int, measured_s: float) -> Figures:
    """A tracker on a pty."""
    return run_in_real_time(_live(tools, baud_rate, measured_s))


def decoding(count: int) -> Figures:
    """Reply bytes to TrackerFrame, beside taking nothing but 14 floats out of the same bytes."""
    replies = [_reply(8 * index) for index in range(count)]
    reader, clock = ReplyReader(), FrameClock(320.0)
    assembler = FrameAssembler({10: "tip", 11: "base"}, has_base=True)
    ours, bare = [], []
    for index, reply in enumerate(replies):
        start = time.perf_counter_ns()
        (whole,) = reader.feed(reply)
        assert isinstance(whole, BinaryReply)
        data = decode_bx(whole.body)
        number = assembler.frame_number(data)
        assert number is not None
        t_ns = clock.observe(number, 25_000_000 * index)
        assembler.frame(data, number, t_ns, 25_000_000 * index)
        middle = time.perf_counter_ns()
        _BARE.unpack_from(reply, 9)
        _BARE.unpack_from(reply, 51)
        bare.append(time.perf_counter_ns() - middle)
        ours.append(middle - start)
    figures = percentiles(ours, 1e-3)
    return {"us": figures, "ratio_to_bare_unpack": round(sum(ours) / sum(bare), 1)}


def _reply(frame_number: int) -> bytes:
    readings = tuple(tool._replace(frame_number=frame_number) for tool in (TOOL_A, TOOL_B))
    return encode_binary_reply(encode_bx(TrackingData(readings, 0)))


async def _live(tools: int, baud_rate: int, measured_s: float) -> Figures:
    clock = MonotonicClock()
    frames: list[TrackerFrame] = []
    delays_ns: list[int] = []

    def on_frame(frame: TrackerFrame) -> None:
        frames.append(frame)
        delays_ns.append(clock.now_ns() - frame.received_ns)

    with _emulated(tools) as port:
        roles = {
            ("tip", "base", "third", "fourth")[n]: ToolSelector(port=n + 1) for n in range(tools)
        }
        config = Tracker.model_validate({"port": port, "baud_rate": baud_rate, "tools": roles})
        tracker = AuroraTracker(config, serial_port_opener(port, clock), clock, on_frame)
        running = asyncio.create_task(tracker.run())
        async with asyncio.timeout(_COMES_WITHIN_S):
            while len(frames) < _WARM_FRAMES:
                await asyncio.sleep(0.05)
        frames.clear()
        delays_ns.clear()
        before, missed = time.process_time(), tracker.status.counters.missed
        await asyncio.sleep(measured_s)
        spent = time.process_time() - before
        lost = tracker.status.counters.missed - missed
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
    return {
        "tools": tools,
        "baud_rate": baud_rate,
        "frames_per_s": round(len(frames) / measured_s, 2),
        "missed": lost,
        "cpu_percent": round(100 * spent / measured_s, 2),
        "read_to_pose_us": percentiles(delays_ns, 1e-3),
        "measured_to_read_ms": percentiles([f.received_ns - f.t_ns for f in frames], 1e-6),
    }


@contextmanager
def _emulated(tools: int) -> Iterator[str]:
    there = [
        {"attached_to": ("tip", "base")[n % 2], "port": n + 1, "serial": f"3C11280{n + 1}"}
        for n in range(tools)
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "tests.witnesses.aurora_process", json.dumps({"tools": there})],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    try:
        yield process.stdout.readline().strip()
    finally:
        end_process(process)
