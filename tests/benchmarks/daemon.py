"""The daemon as a process beside its lab: the loop's time keeping, STOP, and rude clients."""

import asyncio
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from config.loader import load_robot
from config.tasks.experiment import Pretraining
from daemon.messages import LoopStatus
from daemon.recording.format.channels import read_can_payload
from daemon.recording.run_reader import RunReader
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.remote.client.client_errors import ClientError
from daemon.workbench.pretraining.model_cache import pretrained
from drivers.canopen.codec import cob_ids
from drivers.cia402.power_state import Control
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.hil.processes import command

_MEASURED_S = 20.0
_STOPS = 100
STARTS_WITHIN_S = 300.0
"""Seconds on an idle machine; this is for one that hardly runs at all."""
_CLEARED_EVERY_S = 1.0
_CIRCLE = {
    "kind": "circle",
    "center_mm": [0.0, 0.0, 190.0],
    "radius_mm": 20.0,
    "cycle_s": 30.0,
    "cycles": 100,
}
_CHEST = {
    "model": "builtin:soft_arm.npz",
    "surface": {
        "mesh": "builtin:chest.stl",
        "free": "inside",
        "port": {"centre_mm": [0, 0, 0], "inwards": [0, 0, 1], "radius_mm": 10, "depth_mm": 30},
        "grid_mm": 2.0,
    },
    "threshold": 0.05,
}
"""The soft arm where the tendon arm's file has its own: the gate asks for the risk of each step."""
Options = dict[str, Any]
_LED: Options = {"lead": True, "gain_per_s": 6.0}
PLAIN: Options = {"kind": "constant_curvature"}


def measure(tiny: bool = False) -> Figures:
    """All figures of the daemon."""
    if tiny:
        return pieces(
            {
                "floor": partial(spinning_in_a_hurry, 0.1),
                "loop_200_hz_plain": partial(loop_figures, False, measured_s=0.5),
                "stop": partial(stop_figures, 1),
            }
        )
    return pieces(
        {
            "floor": spinning_in_a_hurry,
            "loop_200_hz_plain": partial(loop_figures, False),
            "loop_200_hz_real_time": partial(loop_figures, True),
            "loop_200_hz_plain_beside_a_burner": partial(loop_figures, False, burner=True),
            "loop_200_hz_real_time_beside_a_burner": partial(loop_figures, True, burner=True),
            "learning_100_hz": partial(loop_figures, True, learning=True, period_s=0.01),
            "learning_200_hz": partial(loop_figures, True, learning=True),
            "led_200_hz": partial(loop_figures, True, learning=True, more=_LED),
            "led_in_a_chest_100_hz": partial(
                loop_figures, True, learning=True, more=_LED, risk=_CHEST, period_s=0.01
            ),
            "flooded": partial(loop_figures, True, rude=_flood),
            "frozen_subscriber": partial(loop_figures, True, rude=_frozen),
            "stop": stop_figures,
        }
    )


def spinning_in_a_hurry(duration_s: float = 5.0) -> Figures:
    """The machine's own floor: gaps in a loop that does nothing else, under SCHED_FIFO."""
    code = (
        "import os, time, json\n"
        "try: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(90))\n"
        "except OSError: pass\n"
        f"end = time.perf_counter() + {duration_s}\n"
        "gaps, before = [], time.perf_counter()\n"
        "while before < end:\n"
        "    burst = before + 0.2\n"
        "    while before < burst:\n"
        "        now = time.perf_counter()\n"
        "        if now - before > 1e-4: gaps.append(now - before)\n"
        "        before = now\n"
        "    time.sleep(0.02)\n"
        "    before = time.perf_counter()\n"
        "print(json.dumps(gaps))\n"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    gaps: list[float] = yaml.safe_load(out.stdout)
    return percentiles(gaps, 1e3) if gaps else {"count": 0}


def loop_figures(
    real_time: bool,
    *,
    burner: bool = False,
    rude: Callable[[Path], AbstractContextManager[None]] | None = None,
    learning: bool = False,
    more: Options | None = None,
    risk: Options | None = None,
    period_s: float = 0.005,
    measured_s: float = _MEASURED_S,
) -> Figures:
    """Lateness of the bus cycle and length of the control step, while a circle is followed.

    more: of the controller's options. risk: of the robot file.
    """
    controller = (learner() if learning else PLAIN) | (more or {})
    with emulated_robot(period_s, real_time, risk=risk) as (directory, daemon):
        core = max(os.sched_getaffinity(0))
        if burner:
            os.sched_setaffinity(daemon.pid, {core})
        with _burner(core) if burner else nullcontext():
            around = nullcontext() if rude is None else rude(directory)
            return asyncio.run(_followed(directory, around, controller, period_s, measured_s))


async def _followed(
    directory: Path,
    around: AbstractContextManager[None],
    controller: Options,
    period_s: float,
    measured_s: float,
) -> Figures:
    async with await RobotClient.connect(
        LocalAddress.in_folder(directory), wait_s=STARTS_WITHIN_S
    ) as robot:
        await until_running(robot, controller)
        before = (await robot.status()).loop.missed
        with around:
            trips: list[float] = []
            end = time.monotonic() + measured_s
            while time.monotonic() < end or not trips:
                asked = time.perf_counter()
                status = await robot.status()
                trips.append(time.perf_counter() - asked)
                await asyncio.sleep(0.1)
        stopped_in = time.perf_counter()
        await robot.stop()
        stopped_in = time.perf_counter() - stopped_in
    return {
        **loop_times(status.loop),
        "missed_percent": round(100 * (status.loop.missed - before) * period_s / measured_s, 3),
        "status_round_trip_ms": percentiles(trips, 1e3),
        "state": status.state,
        "reasons": [reason.name for reason in status.reasons],
        "stop_confirmed_ms": round(stopped_in * 1e3, 1),
    }


def learner() -> Options:
    """What `make run` follows with, learning all the time."""
    return {
        "kind": "reward_weighted",
        "model": str(pretrained(load_robot(SOFT_ARM), Pretraining(waypoints=80))),
    }


def stop_figures(stops: int = _STOPS) -> Figures:
    """From `stop()` in the client to the quick stop on the bus, as the recording dates it."""
    with emulated_robot(0.01, True) as (directory, _):
        return asyncio.run(_stopped_again_and_again(directory, stops))


async def _stopped_again_and_again(directory: Path, stops: int) -> Figures:
    to_bus: list[float] = []
    confirmed: list[float] = []
    not_confirmed = at_rest_before = 0
    async with await RobotClient.connect(
        LocalAddress.in_folder(directory), wait_s=STARTS_WITHIN_S
    ) as robot:
        while len(to_bus) < stops and at_rest_before < 10 * stops:
            recording = await until_running(robot)
            await asyncio.sleep(0.5)
            asked_ns = time.monotonic_ns()
            answer = await robot.stop()
            took_ms = (time.monotonic_ns() - asked_ns) * 1e-6
            await asyncio.sleep(0.5)
            told_ns = first_quick_stop_ns(Path(recording), asked_ns)
            if told_ns is None:  # a stall had switched the drives off before anybody asked
                at_rest_before += 1
                continue
            to_bus.append((told_ns - asked_ns) * 1e-6)
            if answer.confirmed:
                confirmed.append(took_ms)
            else:
                not_confirmed += 1
    return {
        "to_bus_ms": percentiles(to_bus),
        "confirmed_off_ms": percentiles(confirmed) if confirmed else {"count": 0},
        "not_confirmed": not_confirmed,
        "at_rest_before_it_was_asked": at_rest_before,
    }


def first_quick_stop_ns(run: Path, after_ns: int) -> int | None:
    """When the first quick stop went out to drive 1 (monotonic); None if there was none."""
    return next((t_ns for t_ns in quick_stops_ns(run) if t_ns >= after_ns), None)


def quick_stops_ns(run: Path) -> Iterator[int]:
    """When each quick stop went out to drive 1 (monotonic), in their order."""
    for message in RunReader(run / "run.mcap").messages():
        if message.topic.startswith("/raw/can/"):
            for t_ns, frame in read_can_payload(message.data):
                if frame.can_id == cob_ids.rpdo(1, 1) and frame.data[0] == Control.QUICK_STOP:
                    yield t_ns


def loop_times(loop: LoopStatus) -> Figures:
    return {
        "cycle_lateness_ms": {
            "median": round(loop.lateness_p50_s * 1e3, 3),
            "p99": round(loop.lateness_p99_s * 1e3, 3),
            "max": round(loop.lateness_max_s * 1e3, 3),
        },
        "frame_to_bus_ms": {
            "median": round(loop.step_p50_s * 1e3, 3),
            "p99": round(loop.step_p99_s * 1e3, 3),
        },
        "cycle_rate_hz": loop.cycle_rate_hz,
        "real_time": loop.real_time,
    }


async def until_running(robot: RobotClient, controller: Options = PLAIN) -> str:
    """The robot follows its circle. Returns the folder of the recording.

    On a machine this busy something may stand in the way for a while: then once more.
    """
    end = time.monotonic() + STARTS_WITHIN_S
    while True:
        try:
            await robot.acquire()
            return await _started(robot, controller, end)
        except ClientError as error:
            print(f"  once more: {error}", file=sys.stderr)
            if time.monotonic() > end:
                raise
            with suppress(ClientError):
                await robot.stop()
            await asyncio.sleep(0.5)


async def _started(robot: RobotClient, controller: Options, end: float) -> str:
    cleared = time.monotonic()
    while (status := await robot.status()).state != OperatingState.READY.value:
        assert time.monotonic() < end, f"never READY: {status.state}, {status.reasons}"
        if time.monotonic() - cleared > _CLEARED_EVERY_S:
            # In a fault, and in whatever else a stall of this machine has left behind.
            cleared = time.monotonic()
            with suppress(ClientError):
                await robot.clear()
        await asyncio.sleep(0.1)
    await robot.arm()
    recording = (await robot.status()).recording
    assert recording is not None
    await robot.load(_CIRCLE, controller)
    await robot.start()
    return recording


@contextmanager
def emulated_robot(
    cycle_period_s: float, real_time: bool, file: Path = SOFT_ARM, risk: Options | None = None
) -> Iterator[tuple[Path, subprocess.Popen[str]]]:
    """Lab and daemon of a shipped arm, with another bus cycle, and this risk if it is given."""
    with tempfile.TemporaryDirectory(prefix="t-") as name:
        directory = Path(name)
        robot = yaml.safe_load(file.read_text())
        robot["buses"]["can0"]["cycle_period_s"] = cycle_period_s
        if risk is not None:
            robot["risk"] = risk
        path = directory / "robot.yaml"
        path.write_text(yaml.safe_dump(robot))
        where = [str(path), "--runtime-dir", name]
        with _process(command("emulate", *where)):
            more = [] if real_time else ["--no-real-time"]
            with _process(command("run", *where, "--runs", f"{name}/runs", *more)) as daemon:
                yield directory, daemon


@contextmanager
def _process(arguments: list[str]) -> Iterator[subprocess.Popen[str]]:
    one = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        assert one.stdout is not None
        assert one.stdout.readline(), f"ended at once: {arguments}"
        yield one
    finally:
        one.send_signal(signal.SIGCONT)
        one.terminate()
        with suppress(subprocess.TimeoutExpired):
            one.wait(15.0)
        one.kill()
        one.wait()
        assert one.stdout is not None
        one.stdout.close()


@contextmanager
def _burner(core: int) -> Iterator[None]:
    burning = subprocess.Popen([sys.executable, "-c", "while True: pass"])
    os.sched_setaffinity(burning.pid, {core})
    try:
        yield
    finally:
        burning.kill()
        burning.wait()


_FLOODER = """
import asyncio, sys
from pathlib import Path
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
async def main():
    async with await RobotClient.connect(LocalAddress.in_folder(Path(sys.argv[1]))) as robot:
        print("here", flush=True)
        while True:
            for _ in range(30):
                robot.send_setpoint([0.0, 0.0, 190.0])
            await asyncio.sleep(0.01)
asyncio.run(main())
"""

_SUBSCRIBER = """
import asyncio, sys
from pathlib import Path
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
async def main():
    async with await RobotClient.connect(LocalAddress.in_folder(Path(sys.argv[1]))) as robot:
        print("here", flush=True)
        async for _ in robot.subscribe(["state", "tip", "axes", "risk"]):
            pass
asyncio.run(main())
"""


@contextmanager
def _flood(directory: Path) -> Iterator[None]:
    """A client that streams three thousand set-points a second."""
    with _process([sys.executable, "-c", _FLOODER, str(directory)]):
        yield


@contextmanager
def _frozen(directory: Path) -> Iterator[None]:
    """A subscriber that has stopped reading."""
    with _process([sys.executable, "-c", _SUBSCRIBER, str(directory)]) as one:
        time.sleep(1.0)
        one.send_signal(signal.SIGSTOP)
        yield
