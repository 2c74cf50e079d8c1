"""What recording costs the loop: per call, and per control step with all that belongs to it."""

import asyncio
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.messages import Axes, Message, Risk, Status, Tip
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.flight_recorder import FlightRecorder, Recorder
from daemon.recording.run_reader import RunReader
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.daemon.recording.synthetic_run import HEADER, messages

STEPS = 1500
STEP_S = 0.005
FRAMES_PER_STEP = 60
"""Six axes at 100 Hz, both directions, between two tracker frames."""
_NS_TO_US = 1e-3


def measure(tiny: bool = False) -> Figures:
    """Per-call cost in µs of both recorders, and what the recorder's process can take."""
    steps = 20 if tiny else STEPS
    return pieces(
        {
            "flight": lambda: run_in_real_time(_paced(FlightRecorder(), steps)),
            "direct": lambda: run_in_real_time(_paced(DirectRecorder(), steps)),
            "flood": lambda: run_in_real_time(_flood(0.1 if tiny else 1.0)),
        }
    )


async def _paced(recorder: Recorder, steps: int) -> Figures:
    """A run's messages at five times their pace: the recorder process has its work beside."""
    kinds: tuple[type[Message], ...] = (Status, Tip, Axes, Risk)
    samples = {
        kind: next(message for message in messages(1, 2.0) if isinstance(message, kind))
        for kind in kinds
    }
    spent: dict[str, list[float]] = {kind.__name__.lower(): [] for kind in kinds}
    spent |= {"can_frame": [], "tracker_traffic": [], "step": []}
    with tempfile.TemporaryDirectory() as folder:
        clock = MonotonicClock()
        await recorder.start(Path(folder), HEADER, clock.now_ns(), clock.wall_time_ns())
        for _ in range(steps):
            began_ns = time.perf_counter_ns()
            for kind, message in samples.items():
                spent[kind.__name__.lower()].append(_timed(recorder.message, message))
            t_ns = clock.now_ns()
            frames = _timed(_frames, recorder, t_ns)
            spent["can_frame"].append(frames / FRAMES_PER_STEP)
            told = _timed(recorder.tracker_traffic, "from_device", bytes(60), t_ns)
            spent["tracker_traffic"].append(told)
            spent["step"].append((time.perf_counter_ns() - began_ns) * _NS_TO_US)
            await asyncio.sleep(STEP_S)
        await recorder.stop()
        size = (Path(folder) / "run.mcap").stat().st_size
    figures: Figures = {f"{name}_us": percentiles(values) for name, values in spent.items()}
    figures["dropped"] = recorder.status.dropped
    figures["bytes_per_step"] = round(size / steps)
    return figures


async def _flood(duration_s: float) -> Figures:
    """As fast as the pipe takes it: messages per second that end in the file."""
    clock, recorder = MonotonicClock(), FlightRecorder()
    tip = next(message for message in messages(1, 2.0) if isinstance(message, Tip))
    with tempfile.TemporaryDirectory() as folder:
        await recorder.start(Path(folder), HEADER, clock.now_ns(), clock.wall_time_ns())
        began_ns, sent = clock.now_ns(), 0
        while clock.now_ns() - began_ns < duration_s * 1e9:
            for _ in range(100):
                recorder.message(tip)
            sent += 100
            await asyncio.sleep(0)
        await recorder.stop()
        took_s = (clock.now_ns() - began_ns) * 1e-9
        kept = sum(1 for _ in RunReader(Path(folder) / "run.mcap").messages(["/tip"]))
    return {"sent": sent, "kept": kept, "kept_per_s": round(kept / took_s)}


def _frames(recorder: Recorder, t_ns: int) -> None:
    """Half of them come one by one, the others are sent together."""
    tap, data = recorder.can_tap("can0"), bytes(8)
    for node in range(FRAMES_PER_STEP // 2):
        tap.received(0x180 + node, data, t_ns)
    tap.sent([(0x200 + node, data) for node in range(FRAMES_PER_STEP // 2)], t_ns)


def _timed(call: Callable[..., Any], *arguments: Any) -> float:
    """Microseconds."""
    before_ns = time.perf_counter_ns()
    call(*arguments)
    return (time.perf_counter_ns() - before_ns) * _NS_TO_US
