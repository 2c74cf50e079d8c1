"""From the recording of a run to the frames that can be learnt from."""

from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from daemon.learning.samples.dataset import DatasetError, Frames
from daemon.messages import Axes, Status, Tip
from daemon.recording.format.channels import TOPICS
from daemon.recording.run_parts import RunParts
from daemon.recording.run_reader import UnreadableRunError
from safety.states import OperatingState

_RUNNING = OperatingState.RUNNING.value
_STRETCH_NS = 5_000_000_000
"""Where nobody says which line it is, so much motion counts as one: about as long as a line of an
exploration, and a hundred times a body's lag."""


class _Seen(NamedTuple):
    t_ns: int
    tip_mm: list[float]
    u: list[float]
    line: int


def frames_of_run(path: Path) -> Frames:
    """Every believed frame of a run (its folder, or one recording) during which it was running.

    The tip is the loop's, and not that of `recorded_path`: its place is not late, only its velocity
    is, which nothing is learnt from. On the emulated soft arm both give the same lag, within 1 ms
    of that of the true tip, and models that predict true motions equally well (rms of four
    explorations 0.271 mm filtered, 0.278 smoothed, 0.273 true).

    A line is a part of an exploration; in another run, five seconds. Raises DatasetError for a
    recording that holds none, OSError.
    """
    try:
        seen = _seen(path)
    except UnreadableRunError as error:
        raise DatasetError(str(error)) from None
    except msgspec.MsgspecError as error:
        raise DatasetError(f"{path}: {error}") from None
    if not seen:
        raise DatasetError(f"{path}: the robot did not move in it")
    return Frames(
        np.array([frame.t_ns for frame in seen], dtype=np.int64),
        np.array([frame.tip_mm for frame in seen]),
        np.array([frame.u for frame in seen]),
        np.array([frame.line for frame in seen], dtype=np.int64),
    )


def _seen(run: Path) -> list[_Seen]:
    tip_of, axes_of = msgspec.json.Decoder(Tip), msgspec.json.Decoder(Axes)
    status_of = msgspec.json.Decoder(Status)
    lines, seen, tip = _Lines(), list[_Seen](), None
    for message in RunParts(run).messages([TOPICS[kind] for kind in (Tip, Axes, Status)]):
        if message.topic == TOPICS[Status]:
            lines.hear(status_of.decode(message.data))
        elif message.topic == TOPICS[Tip]:
            tip = tip_of.decode(message.data)
        elif tip is not None and tip.tip_mm is not None:
            axes = axes_of.decode(message.data)
            sound = tip.believed and tip.state == _RUNNING and tip.sequence == axes.sequence
            if sound and (not seen or axes.t_ns > seen[-1].t_ns):
                seen.append(_Seen(axes.t_ns, tip.tip_mm, axes.actual, lines.at(axes.t_ns)))
    return seen


class _Lines:
    """Numbers lines, by the parts of what the controller does."""

    def __init__(self) -> None:
        self._part: int | None = None
        self._line = 0
        self._began_ns: int | None = None

    def hear(self, status: Status) -> None:
        part = None if status.reference is None else status.reference.part
        if part != self._part:
            self._part = part
            self._line += 1
            self._began_ns = None

    def at(self, t_ns: int) -> int:
        if self._began_ns is None:
            self._began_ns = t_ns
        if self._part is None and t_ns - self._began_ns > _STRETCH_NS:
            self._line += 1
            self._began_ns = t_ns
        return self._line
