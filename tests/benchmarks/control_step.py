"""What a whole step of the control loop costs, over the size of the mesh and the parts of the body.

The tendon arm goes round a circle that a ball reaches into: its tip is compared, its steps are
turned aside, and the gate asks for the risk. The daemon runs in virtual time, and what a step takes
is measured by the real clock: from the frame until its targets are with the drives' master, and
until all of it is told. What is done in spare time, between two steps, is told beside it. After
each step a fixed piece of work is measured, which the stated machine does in 1 ms: other programs
and other machines take as long from it as from the step, at the 99th percentile as in the median.

As in the daemon all code has run before, no garbage is collected in a step, and what is recorded is
only encoded in it: another process writes it.
"""

import asyncio
import gc
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any, Final
from unittest.mock import patch

import numpy as np
import yaml

from config.loader import load_robot
from daemon.controllers.make_controller import warm_up
from daemon.loop.control_step import ControlLoop
from daemon.loop.step_messages import SLIDING
from daemon.messages import Load, Message, Risk, Start
from daemon.recording.direct_recorder import DirectRecorder
from daemon.recording.format.channels import (
    RAW_TRACKER,
    TOPICS,
    message_time_ns,
    telemetry_payload,
    tracker_payload,
)
from daemon.recording.format.record_stream import RecordWriter
from daemon.risk.body_risk_source import make_risk_source
from daemon.risk.mesh_file import write_mesh
from daemon.workbench.body_model.evaluation.shapes import ball
from safety.states import OperatingState
from tests.benchmarks.timing import (
    REFERENCE_TURNS_IN_1_MS,
    Figures,
    percentiles,
    pieces,
    reference_ms,
)
from tests.daemon.service.grazing import TENDONS, StoppedClock
from tests.daemon.service.rig import Rig, on_a_rig

TRIANGLES: Final = (1_000, 10_000, 50_000, 200_000)
PARTS_OF_THE_BODY: Final = tuple(range(1, 9))
_USUAL_TRIANGLES, _USUAL_PARTS = 50_000, 6
_ANGLE_RAD: Final = 0.7
_DEEPER_MM: Final = 5.0
"""The ball is farther in the way than where bodies graze it: none gets by without going aside."""
_WATCHED_S: Final = 200.0
"""More than it takes to learn how the tip answers, and to go once round."""
_COLLECTED_EVERY_S: Final = 1.0
"""As the daemon does while its drives are energised, between two steps."""
_SENT_BYTES: Final = 1 << 16


def measure(tiny: bool = False) -> Figures:
    """Milliseconds of a step and of the spare time after it. Code is warm."""
    warm_up()
    triangles, parts = ((500,), (1,)) if tiny else (TRIANGLES, PARTS_OF_THE_BODY)
    watched_s = 0.5 if tiny else _WATCHED_S
    named: dict[str, Callable[[], Figures]] = {}
    for count in triangles:
        named[f"{count}_triangles"] = partial(_once_round, count, _USUAL_PARTS, watched_s)
    for count in parts:
        usual = triangles[0] if tiny else _USUAL_TRIANGLES
        named[f"{count}_parts"] = partial(_once_round, usual, count, watched_s)
    return pieces(named)


def _once_round(triangles: int, parts: int, watched_s: float) -> Figures:
    with tempfile.TemporaryDirectory() as name, ExitStack() as patched:
        patched.enter_context(patch("safety.risk.body_risk._PARTS", parts))
        folder = Path(name)
        centre = TENDONS.ball_at(_ANGLE_RAD)
        centre[:2] *= 1.0 - _DEEPER_MM / np.linalg.norm(centre[:2])
        mesh = ball(TENDONS.ball_mm, centre.tolist(), triangles)
        write_mesh(folder / "ball.stl", mesh)
        robot: dict[str, Any] = yaml.safe_load(TENDONS.file.read_text())
        robot["risk"] = {
            **robot.get("risk", {}),
            "model": TENDONS.model,
            "surface": {"mesh": "ball.stl", "free": "outside"},
        }
        path = folder / "robot.yaml"
        path.write_text(yaml.safe_dump(robot))
        risk = make_risk_source(load_robot(path), StoppedClock())
        steps = _Stopwatch(ControlLoop.step, beside_fixed_work=True)
        spare = _Stopwatch(ControlLoop.use_spare_time)
        patched.enter_context(patch.object(ControlLoop, "step", steps.timed()))
        patched.enter_context(patch.object(ControlLoop, "_judge", steps.noted(_JUDGES)))
        patched.enter_context(patch.object(ControlLoop, "use_spare_time", spare.timed()))

        async def scene(rig: Rig) -> None:
            await rig.armed()
            await rig.do(Load, trajectory=TENDONS.circle, controller=TENDONS.controller)
            await rig.do(Start)
            await rig.until_state(OperatingState.RUNNING)
            clock = rig.service.clock
            ends_ns = clock.now_ns() + round(watched_s * 1e9)
            steps.begin()
            spare.begin()
            with _collector_off():
                while rig.state is OperatingState.RUNNING and clock.now_ns() < ends_ns:
                    await asyncio.sleep(_COLLECTED_EVERY_S)
                    gc.collect(0)

        rig = on_a_rig(scene, path=path, risk=risk, recorder=_Encoding())
        risks = [message for message in rig.told if isinstance(message, Risk)]
    longest = np.sort(spare.seconds)[-max(1, len(steps.seconds)) :]  # looking round, once a step
    step, fixed = percentiles(steps.seconds, 1e3), percentiles(steps.fixed_ms)
    return {
        "step": step,
        "fixed_work": fixed,
        "step_over_fixed_work": {
            share: round(step[share] / fixed[share], 3) for share in ("median", "p99")
        },
        "until_sent": percentiles(steps.noted_seconds, 1e3),
        "spare_time": percentiles(longest.tolist(), 1e3),
        "turned_aside": sum(SLIDING in one.reasons for one in risks),
    }


_JUDGES: Final = ControlLoop._judge
"""What a step goes on with, when its targets are sent."""


class _Stopwatch:
    """Of one method."""

    def __init__(self, method: Callable[..., None], beside_fixed_work: bool = False) -> None:
        self._method = method
        self._beside_fixed_work = beside_fixed_work
        self.seconds: list[float] = []
        self.noted_seconds: list[float] = []
        """From its beginning until it called another."""
        self.fixed_ms: list[float] = []
        """What the fixed work after it took."""
        self._started = 0.0

    def begin(self) -> None:
        """Forget what was measured."""
        self.seconds.clear()
        self.noted_seconds.clear()
        self.fixed_ms.clear()

    def timed(self) -> Callable[..., None]:
        """The method, measured."""

        def measured(*arguments: Any) -> None:
            self._started = time.perf_counter()
            self._method(*arguments)
            self.seconds.append(time.perf_counter() - self._started)
            if self._beside_fixed_work:
                self.fixed_ms.append(reference_ms(REFERENCE_TURNS_IN_1_MS)[0])

        return measured

    def noted(self, method: Callable[..., None]) -> Callable[..., None]:
        """Another one that it calls, so that its beginning is noted."""

        def noted(*arguments: Any) -> None:
            self.noted_seconds.append(time.perf_counter() - self._started)
            method(*arguments)

        return noted


class _Encoding(DirectRecorder):
    """Encodes as the daemon's recorder does, and has nothing to write."""

    def __init__(self) -> None:
        super().__init__()
        self._records = RecordWriter()

    def message(self, message: Message) -> None:
        topic = TOPICS.get(type(message))
        if topic is not None:
            self._write(topic, message_time_ns(message), telemetry_payload(message))

    def tracker_traffic(self, direction: str, data: bytes, t_ns: int) -> None:
        self._write(RAW_TRACKER, t_ns, tracker_payload(direction, data))

    def _write(self, topic: str, t_ns: int, payload: bytes) -> None:
        self._records.message(topic, t_ns, payload)
        if len(self._records.buffer) > _SENT_BYTES:
            self._records.buffer.clear()


@contextmanager
def _collector_off() -> Iterator[None]:
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()


def plot(figures: Figures, path: Path) -> None:
    """Median and 99th percentile of a step, over triangles and over parts."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(9, 4), sharey=True)
    for panel, over, counts in (
        (panels[0], "triangles", TRIANGLES),
        (panels[1], "parts", PARTS_OF_THE_BODY),
    ):
        told = [figures[f"{count}_{over}"] for count in counts]
        for what, mark in (("step", "o-"), ("until_sent", "^-"), ("spare_time", "s--")):
            for share in ("median", "p99"):
                label = f"{what.replace('_', ' ')}, {share}"
                panel.plot(counts, [one[what][share] for one in told], mark, label=label)
        panel.set_xlabel(over)
        panel.grid(visible=True, alpha=0.3)
    panels[0].set_xscale("log")
    panels[0].set_ylabel("ms")
    panels[1].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=130)
