"""What the emulated lab costs, and how soon its sudden death is noticed."""

import asyncio
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from tests.benchmarks.timing import Figures, percentiles, pieces
from tests.drivers.cia402.rig import Rig, axes, on_a_rig
from tests.hil.processes import Lab, Probe, lab, probe, well

VIRTUAL_S = 10.0
KILLS = 3


def measure(tiny: bool = False) -> Figures:
    """All figures of the emulation."""
    return pieces(
        {
            "virtual_time_6_drives_100_hz": partial(virtual_bus, 0.5 if tiny else VIRTUAL_S),
            "lab_process": partial(lab_cpu, 0.5 if tiny else 5.0),
            "lab_killed_to_reported_ms": partial(killed_to_reported, 1 if tiny else KILLS),
        }
    )


def virtual_bus(duration_s: float) -> Figures:
    """Master, bus and six drives in virtual time: wall time per frame, and how fast time flies."""
    figures: Figures = {}

    async def test(rig: Rig) -> None:
        await rig.enabled()
        frames, start = rig.bus.statistics().frames, time.perf_counter()
        await asyncio.sleep(duration_s)
        wall_s = time.perf_counter() - start
        count = rig.bus.statistics().frames - frames
        figures["us_per_frame"] = round(wall_s / count * 1e6, 2)
        figures["times_real_time"] = round(duration_s / wall_s, 1)

    on_a_rig(test, robot_axes=axes(6))
    return figures


def lab_cpu(measured_s: float) -> Figures:
    """CPU of the lab's process while a probe watches it sway."""
    with _watched_lab("--play", "sway") as (running, _):
        before, start = _cpu_s(running.process.pid), time.monotonic()
        time.sleep(measured_s)
        spent = _cpu_s(running.process.pid) - before
        return {"cpu_percent": round(100 * spent / (time.monotonic() - start), 1)}


def killed_to_reported(kills: int) -> Figures:
    """From kill -9 of the lab until the probe has printed that tracker and bus are gone."""
    tracker_ms, bus_ms = [], []
    for _ in range(kills):
        with _watched_lab() as (running, watching):
            killed_s = time.monotonic()
            running.kill()
            came = watching.wait_for_events("link_lost", "bus_gone")
            tracker_ms.append((came["link_lost"] - killed_s) * 1e3)
            bus_ms.append((came["bus_gone"] - killed_s) * 1e3)
    return {"tracker": percentiles(tracker_ms), "bus": percentiles(bus_ms)}


@contextmanager
def _watched_lab(*options: str) -> Iterator[tuple[Lab, Probe]]:
    """A lab, and a probe that finds all of it well."""
    with (
        tempfile.TemporaryDirectory() as folder,
        lab(Path(folder), *options) as running,
        probe(Path(folder)) as watching,
    ):
        watching.wait_for(well)
        yield running, watching


def _cpu_s(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
