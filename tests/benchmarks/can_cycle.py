"""CPU time of one bus cycle in the master's process, beside a bare loop on the same bus.

Drives run in a process of their own, enabled and moving. The bare loop sends ready-made bytes and
drops what it reads, with nothing but system calls in between, on the same descriptor: what is left
is the price of decoding, states, interpolation and asyncio. A second bare loop does what our
master does too: it lets frames wait for the cycle instead of waking for each.
"""

import asyncio
import contextlib
import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from config.axis import Axis
from config.bus import Bus
from daemon.clock import MonotonicClock, run_in_real_time
from daemon.periodic_timer import Tick, TimerFd, timerfd
from drivers.can.budget import bus_budget
from drivers.can.fd_link import FdLink
from drivers.can.frame import CAN_FRAME, CanFrame
from drivers.can.link import CanLink, FrameReceiver
from drivers.can.open_link import open_link
from drivers.can.slcan import encode_frame
from drivers.canopen.object_dictionary import ObjectDictionary
from drivers.cia402.drive_bus import DriveBus
from drivers.cia402.pdo_plan import RPDO_LAYOUT, bus_traffic
from drivers.cia402.power_state import PowerGoal
from safety.limits import CountLimits
from safety.permit import PermittedStep, permit
from tests.benchmarks.timing import Figures
from tests.drivers.cia402.rig import axes

EDS = Path(__file__).parents[2] / "config" / "eds" / "stepper.eds"
AXES = (6, 8, 12)
RATES_HZ = (100, 200, 500)
SLICES = 4
SLICE_S = 0.75
SETTLED_S = 0.5
HEARTBEAT_S = 0.05
_LOOSE = CountLimits(-(10**9), 10**9, 10**9, 10**12, 10**9)


def measure() -> list[Figures]:
    """One row for each number of axes, rate and front end."""
    rows = []
    for front in ("socket", "slcan"):
        for count in AXES:
            for rate_hz in RATES_HZ:
                rows.append(_row(front, count, rate_hz))
                print(json.dumps(rows[-1]), file=sys.stderr, flush=True)
    return rows


def _row(front: str, count: int, rate_hz: int) -> Figures:
    robot = axes(count)
    bus = Bus(interface="tentacled", channel="", cycle_period_s=1 / rate_hz)
    budget = bus_budget(bus_traffic("can0", bus, robot))
    row: Figures = {"front": front, "axes": count, "rate_hz": rate_hz, "bus_load": budget.load}
    if budget.refused:
        return {**row, "refused": "over the bus budget"}
    with _drives(count) as reached_at:
        interface = "tentacled" if front == "socket" else "slcan"
        update = {"interface": interface, "channel": reached_at[front]}
        return {**row, **run_in_real_time(_all(bus.model_copy(update=update), robot))}


async def _all(bus: Bus, robot: list[Axis]) -> Figures:
    """Our master, then the bare loops that take over its line while the drives are enabled."""
    clock = MonotonicClock()
    links: list[CanLink] = []

    async def opener(receiver: FrameReceiver) -> CanLink:
        links.append(await open_link(bus, receiver, clock))
        return links[0]

    dictionaries = {a.drive.node: ObjectDictionary(EDS) for a in robot}
    master = DriveBus("can0", bus, list(enumerate(robot)), dictionaries, opener, clock)
    cycles = 0

    def on_tick(_tick: Tick) -> None:
        nonlocal cycles
        cycles += 1
        master.tick(clock.now_ns())

    timer = TimerFd(clock.now_ns(), round(bus.cycle_period_s * 1e9), on_tick)
    life = asyncio.create_task(master.run())
    await _until(lambda: master.operational)
    master.set_goal(PowerGoal.ENABLED)
    await _until(lambda: all(channel.following for channel in master.channels))
    master.write(_long_step(clock.now_ns(), len(robot)))
    await asyncio.sleep(SETTLED_S)
    ours_s = []
    for _ in range(SLICES):
        before, first = time.process_time(), cycles
        await asyncio.sleep(SLICE_S)
        ours_s.append((time.process_time() - before) / (cycles - first))
    timer.stop()
    bare_s, once_s = (_bare(links[0], len(robot), bus.cycle_period_s, once) for once in (0, 1))
    life.cancel()
    await asyncio.gather(life, return_exceptions=True)
    links[0].close()
    return {
        "ours_us": round(median(ours_s) * 1e6, 1),
        "bare_us": round(bare_s * 1e6, 1),
        "bare_once_a_cycle_us": round(once_s * 1e6, 1),
        "ratio": round(median(ours_s) / bare_s, 2),
        "ratio_once_a_cycle": round(median(ours_s) / once_s, 2),
        "refused_frames": master.traffic.refused,
    }


async def _until(true: Any) -> None:
    async with asyncio.timeout(20.0):
        while not true():
            await asyncio.sleep(0.02)


def _long_step(now_ns: int, count: int) -> PermittedStep:
    step = permit(
        from_counts=[0] * count,
        to_counts=[80_000] * count,
        measured_counts=[0] * count,
        velocities_before=[0.0] * count,
        begins_ns=now_ns,
        duration_ns=60_000_000_000,
        limits=[_LOOSE] * count,
    )
    assert isinstance(step, PermittedStep)
    return step


def _bare(link: Any, count: int, period_s: float, once_a_cycle: int) -> float:
    """CPU seconds per cycle of a loop of system calls on the link's own descriptor."""
    target = RPDO_LAYOUT.pack(0x0F, 2000)
    frames = [(0x80, b""), *((0x200 + node, target) for node in range(1, count + 1))]
    if isinstance(link, FdLink):
        line = link._socket
        beat = CAN_FRAME.pack(0x77F, 1, b"\x05")
        ready = [CAN_FRAME.pack(can_id, len(data), data) for can_id, data in frames]
        return _loop(line.fileno(), line.send, ready, beat, line.recv, period_s, once_a_cycle)
    fd = link._fd
    lines = [b"".join(encode_frame(CanFrame(*frame)) for frame in frames)]
    beat = encode_frame(CanFrame(0x77F, b"\x05"))
    write, read = partial(os.write, fd), partial(os.read, fd)
    return _loop(fd, write, lines, beat, read, period_s, once_a_cycle)


def _loop(
    fd: int,
    send: Callable[[bytes], int],
    ready: list[bytes],
    beat: bytes,
    receive: Callable[[int], bytes],
    period_s: float,
    once_a_cycle: int,
) -> float:
    """A timerfd, a poll, and two functions."""
    timer = timerfd(MonotonicClock().now_ns(), round(period_s * 1e9))
    poll = select.poll()
    poll.register(timer, select.POLLIN)
    if not once_a_cycle:
        poll.register(fd, select.POLLIN)
    beats_every, per_slice = max(1, round(HEARTBEAT_S / period_s)), round(SLICE_S / period_s)
    cycles, before = 0, time.process_time()
    spent: list[float] = []
    while len(spent) <= SLICES:
        for polled, _ in poll.poll():
            if polled != timer or once_a_cycle:
                with contextlib.suppress(BlockingIOError):
                    while receive(4096):
                        pass
            if polled == timer:
                os.read(timer, 8)
                for data in ready:
                    send(data)
                cycles += 1
                if cycles % beats_every == 0:
                    send(beat)
                if cycles % per_slice == 0:
                    now = time.process_time()
                    spent.append((now - before) / per_slice)
                    before = now
    os.close(timer)
    return median(spent[1:])


@contextlib.contextmanager
def _drives(count: int) -> Iterator[dict[str, str]]:
    with tempfile.TemporaryDirectory() as folder:
        nodes = [str(node) for node in range(1, count + 1)]
        arguments = [str(Path(folder) / "can0.sock"), str(EDS), *nodes]
        process = subprocess.Popen(
            [sys.executable, "-m", "tests.witnesses.drives_process", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())
        finally:
            process.communicate(timeout=5)


if __name__ == "__main__":
    print(json.dumps(measure(), indent=1))
