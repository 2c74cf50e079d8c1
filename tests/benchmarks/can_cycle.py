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
from typing import Any, NamedTuple

from config.axis import Axis
from config.bus import Bus
from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.host.periodic_timer import Tick, TimerFd, timerfd
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
from tests.benchmarks.timing import Figures, end_process, pieces
from tests.drivers.cia402.rig import axes

EDS = Path(__file__).parents[2] / "config" / "eds" / "stepper.eds"
AXES = (6, 8, 12)
RATES_HZ = (100, 200, 500)
SLICES = 4
SLICE_S = 0.75
SETTLED_S = 0.5
HEARTBEAT_S = 0.05
_COMES_WITHIN_S = 300.0
"""All drives, following. Seconds on an idle machine; this is for one that hardly runs at all."""
_ASKED_AGAIN_S = 3.0
_RESET_S = 0.3
_LOOSE = CountLimits(-(10**9), 10**9, 10**9, 10**12, 10**9)


def measure(tiny: bool = False) -> Figures:
    """One piece for each front end, number of axes and rate."""
    most = 1 if tiny else len(AXES)
    counts, rates = AXES[:most], RATES_HZ[:most]
    return pieces(
        {
            f"{front}_{count}_axes_{rate_hz}_hz": partial(
                _row, front, count, rate_hz, 0.1 if tiny else SLICE_S
            )
            for front in ("socket", "slcan")
            for count in counts
            for rate_hz in rates
        }
    )


def _row(front: str, count: int, rate_hz: int, slice_s: float) -> Figures:
    robot = axes(count)
    bus = Bus(interface="tentacled", channel="", cycle_period_s=1 / rate_hz)
    budget = bus_budget(bus_traffic("can0", bus, robot))
    row: Figures = {"front": front, "axes": count, "rate_hz": rate_hz, "bus_load": budget.load}
    if budget.refused:
        return {**row, "refused": "over the bus budget"}
    with _drives(count) as reached_at:
        interface = "tentacled" if front == "socket" else "slcan"
        update = {"interface": interface, "channel": reached_at[front]}
        there = bus.model_copy(update=update)
        return {**row, **run_in_real_time(_all(there, robot, slice_s))}


async def _all(bus: Bus, robot: list[Axis], slice_s: float) -> Figures:
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
    try:
        await _enabled(master)
        master.write(_long_step(clock.now_ns(), len(robot)))
        await asyncio.sleep(SETTLED_S)
        ours_s: list[float] = []
        while len(ours_s) < SLICES:
            before, first = time.process_time(), cycles
            await asyncio.sleep(slice_s)
            if cycles > first:  # none: the machine stood still
                ours_s.append((time.process_time() - before) / (cycles - first))
        timer.stop()
        bare, once = (
            _bare(links[0], len(robot), bus.cycle_period_s, slice_s, in_cycle)
            for in_cycle in (False, True)
        )
    finally:
        timer.stop()
        life.cancel()
        await asyncio.gather(life, return_exceptions=True)
        for link in links:
            link.close()
    return {
        "ours_us": round(median(ours_s) * 1e6, 1),
        "bare_us": round(bare.cycle_s * 1e6, 1),
        "bare_once_a_cycle_us": round(once.cycle_s * 1e6, 1),
        "ratio": round(median(ours_s) / bare.cycle_s, 2),
        "ratio_once_a_cycle": round(median(ours_s) / once.cycle_s, 2),
        "refused_frames": master.traffic.refused,
        "refused_frames_bare": bare.refused + once.refused,
    }


async def _enabled(master: DriveBus) -> None:
    """All drives follow. One that has lost SYNC while the machine stood still is reset."""
    async with asyncio.timeout(_COMES_WITHIN_S):
        while not master.operational:
            await asyncio.sleep(0.02)
        master.set_goal(PowerGoal.ENABLED)
        asked_s = time.monotonic()
        while not master.following:
            await asyncio.sleep(0.02)
            if time.monotonic() - asked_s > _ASKED_AGAIN_S:
                master.set_goal(PowerGoal.OFF)
                master.reset_faults()
                await asyncio.sleep(_RESET_S)
                master.set_goal(PowerGoal.ENABLED)
                asked_s = time.monotonic()


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


class Bare(NamedTuple):
    """What a bare loop took."""

    cycle_s: float
    """CPU time of a cycle."""
    refused: int
    """Frames that the line did not take, because whoever reads it was late."""


def _bare(link: Any, count: int, period_s: float, slice_s: float, once_a_cycle: bool) -> Bare:
    """A loop of system calls on the link's own descriptor."""
    target = RPDO_LAYOUT.pack(0x0F, 2000)
    frames = [(0x80, b""), *((0x200 + node, target) for node in range(1, count + 1))]
    rate = period_s, slice_s, once_a_cycle
    if isinstance(link, FdLink):
        line = link._socket
        beat = CAN_FRAME.pack(0x77F, 1, b"\x05")
        ready = [CAN_FRAME.pack(can_id, len(data), data) for can_id, data in frames]
        return _loop(line.fileno(), line.send, ready, beat, line.recv, *rate)
    fd = link._fd
    lines = [b"".join(encode_frame(CanFrame(*frame)) for frame in frames)]
    beat = encode_frame(CanFrame(0x77F, b"\x05"))
    write, read = partial(os.write, fd), partial(os.read, fd)
    return _loop(fd, write, lines, beat, read, *rate)


def _loop(
    fd: int,
    send: Callable[[bytes], int],
    ready: list[bytes],
    beat: bytes,
    receive: Callable[[int], bytes],
    period_s: float,
    slice_s: float,
    once_a_cycle: bool,
) -> Bare:
    """A timerfd, a poll, and two functions."""
    timer = timerfd(MonotonicClock().now_ns(), round(period_s * 1e9))
    poll = select.poll()
    poll.register(timer, select.POLLIN)
    if not once_a_cycle:
        poll.register(fd, select.POLLIN)
    beats_every, per_slice = max(1, round(HEARTBEAT_S / period_s)), round(slice_s / period_s)
    cycles, refused, before = 0, 0, time.process_time()
    spent: list[float] = []
    while len(spent) <= SLICES:
        for polled, _ in poll.poll():
            if polled != timer or once_a_cycle:
                with contextlib.suppress(BlockingIOError):
                    while receive(4096):
                        pass
            if polled == timer:
                os.read(timer, 8)
                cycles += 1
                due = [*ready, beat] if cycles % beats_every == 0 else ready
                for data in due:
                    try:
                        send(data)
                    except BlockingIOError:
                        refused += 1
                if cycles % per_slice == 0:
                    now = time.process_time()
                    spent.append((now - before) / per_slice)
                    before = now
    os.close(timer)
    return Bare(median(spent[1:]), refused)


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
            end_process(process)
