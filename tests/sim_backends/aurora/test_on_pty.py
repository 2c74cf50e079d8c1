"""The emulated tracker on a pseudo-terminal, with the real driver on the real serial port."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from config.emulation.lab import EmulatedTracker
from config.tracker import ToolSelector, Tracker
from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.aurora.codec.commands import encode_command
from drivers.aurora.frame import TrackerFrame
from drivers.aurora.tracker import AuroraTracker
from drivers.byte_stream import ByteStream
from drivers.serial_port import serial_port_opener
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.aurora.wires import PtyAurora
from sim_backends.faults import understand
from tests.sim_backends.aurora.bench import BASE, EXACT, TIP, still

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("aurora_pty")]

CLOCK = MonotonicClock()


class Site:
    """A device on a pty, and a link to it."""

    def __init__(self, folder: Path, **settings: Any) -> None:
        config = EmulatedTracker(tools=[TIP, BASE], **{**EXACT, "reset_time_s": 0.2, **settings})
        self.device = EmulatedAurora(config, still, powered_up_ns=CLOCK.now_ns())
        self.link = folder / "lab" / "aurora"
        self.shell = PtyAurora(self.device, CLOCK, self.link)

    def inject(self, order: str) -> None:
        understand({"tracker": self.device}, f"tracker.{order}").carry_out(CLOCK.now_ns())


def run(main: Coroutine[Any, Any, None]) -> None:
    async def limited() -> None:
        async with asyncio.timeout(20.0):
            await main

    run_in_real_time(limited())


async def until(is_true: Callable[[], object]) -> None:
    while not is_true():
        await asyncio.sleep(0.005)


class Ears:
    def __init__(self) -> None:
        self.heard = bytearray()
        self.losses = 0

    def bytes_received(self, data: bytes, t_ns: int) -> None:
        self.heard += data

    def stream_lost(self, error: OSError) -> None:
        self.losses += 1


async def connect(site: Site) -> tuple[ByteStream, Ears]:
    ears = Ears()
    return await serial_port_opener(str(site.link), CLOCK)(ears), ears


def test_commands_are_answered_in_wire_time(tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        stream, ears = await connect(site)
        start_ns = CLOCK.now_ns()
        stream.write(encode_command("INIT"))
        await until(lambda: ears.heard == b"OKAYA896\r")
        assert CLOCK.now_ns() - start_ns > 20_000_000
        stream.close()
        site.shell.close()

    run(main())


def test_a_wrong_rate_is_noise_in_both_directions(tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        stream, ears = await connect(site)
        stream.set_baud_rate(115200)
        stream.write(encode_command("INIT"))
        await asyncio.sleep(0.1)
        assert ears.heard == b""
        stream.set_baud_rate(9600)
        stream.write(b"\r")
        await until(lambda: ears.heard.endswith(b"\r"))
        stream.write(encode_command("COMM", "50000"))
        await asyncio.sleep(0.2)
        ears.heard.clear()
        site.inject("break")
        stream.set_baud_rate(115200)
        await until(lambda: ears.heard)
        await asyncio.sleep(0.1)
        assert b"RESET" not in ears.heard
        stream.close()
        site.shell.close()

    run(main())


def test_a_flush_at_9600_after_an_unanswered_command_is_a_break(tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        stream, ears = await connect(site)
        stream.write(encode_command("COMM", "50000"))
        await asyncio.sleep(0.2)
        stream.discard_input()
        await asyncio.sleep(0.4)
        assert ears.heard == b"OKAYA896\r"  # every client flushes now and then
        stream.write(encode_command("INIT"))
        await asyncio.sleep(0.1)
        stream.discard_input()
        await until(lambda: ears.heard.endswith(b"RESETBE6F\r"))
        stream.close()
        site.shell.close()

    run(main())


def test_the_link_leads_to_the_pty_and_goes_with_it(tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        first = site.link.readlink()
        assert first == site.shell.path
        stream, ears = await connect(site)
        site.inject("hang_up=0.2s")
        assert not site.link.is_symlink()
        await until(lambda: ears.losses == 1)
        await until(site.link.exists)
        stream, ears = await connect(site)
        stream.write(encode_command("APIREV"))
        await until(lambda: b"D.002.005" in ears.heard)
        stream.close()
        site.shell.close()
        assert not site.link.is_symlink()

    run(main())


def test_closing_leaves_another_one_s_link_alone(tmp_path: Path) -> None:
    async def main() -> None:
        first, second = Site(tmp_path), Site(tmp_path)
        first.shell.close()
        assert second.link.readlink() == second.shell.path
        second.shell.close()

    run(main())


@asynccontextmanager
async def tracking(
    site: Site, **settings: Any
) -> AsyncIterator[tuple[AuroraTracker, list[TrackerFrame]]]:
    tools = {"tip": ToolSelector(port=1), "base": ToolSelector(port=2)}
    config = Tracker(port=str(site.link), tools=tools, **settings)
    frames: list[TrackerFrame] = []
    opener = serial_port_opener(config.port, CLOCK, config.hardware_handshake)
    tracker = AuroraTracker(config, opener, CLOCK, frames.append)
    task = asyncio.create_task(tracker.run())
    try:
        await until(lambda: len(frames) > 5)
        yield tracker, frames
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        site.shell.close()


def test_the_driver_tracks_over_a_real_serial_port(tmp_path: Path) -> None:
    """Counts, not delays: the machine that runs this may be busy."""

    async def main() -> None:
        async with tracking(Site(tmp_path)) as (tracker, frames):
            before = len(frames)
            start_ns = CLOCK.now_ns()
            await asyncio.sleep(2.0)
            seconds = (CLOCK.now_ns() - start_ns) * 1e-9
            missed = tracker.status.counters.missed
            assert len(frames) - before + missed == pytest.approx(40.0 * seconds, abs=4)
            assert tracker.status.counters.crc_errors == 0
            tip = frames[-1].tip
            assert tip is not None
            assert tip.position_mm == pytest.approx(np.array([0.0, 0.0, 150.0]), abs=1e-3)

    run(main())


@pytest.mark.parametrize("order", ["hang_up=0.3s", "reset", "hang", "baud_loss"])
def test_the_driver_comes_back_over_a_real_serial_port(order: str, tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        async with tracking(site) as (tracker, frames):
            site.inject(order)
            await asyncio.sleep(0.3)
            assert tracker.status.conditions
            frames.clear()
            await until(lambda: len(frames) > 10)
            assert tracker.status.conditions == ()

    run(main())


def test_the_driver_finds_a_device_that_an_earlier_client_left_tracking(tmp_path: Path) -> None:
    async def main() -> None:
        site = Site(tmp_path)
        async with tracking(site):
            pass
        site = Site(tmp_path)
        stream, _ = await connect(site)
        stream.write(encode_command("COMM", "A0000"))
        await asyncio.sleep(0.2)
        stream.close()
        async with tracking(site, baud_rate=115200) as (tracker, _):
            assert tracker.status.counters.resets == 0

    run(main())
