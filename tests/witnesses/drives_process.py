"""Emulated drives in a process of their own, on a socket and behind an SLCAN adapter.

python -m tests.witnesses.drives_process SOCKET EDS NODE [NODE ...]

Says in one line of JSON where they can be reached, once they have booted. Each line on standard
input is a fault, in the grammar of sim_backends/faults.py; the end of standard input ends the
process.
"""

import asyncio
import json
import sys
from pathlib import Path

from config.emulation.lab import EmulatedDrives
from daemon.host.clock import MonotonicClock, run_in_real_time
from sim_backends.devices.can.bus import CanBus
from sim_backends.devices.can.faults import BusFaults
from sim_backends.devices.can.slcan_adapter import SlcanAdapter
from sim_backends.devices.can.socket_server import SocketServer
from sim_backends.devices.device import Pump
from sim_backends.devices.drive.drive import EmulatedDrive
from sim_backends.devices.drive.node.communication import INITIALISING
from sim_backends.faults import FaultyDevice, understand


async def run(path: Path, eds: Path, nodes: list[int]) -> None:
    clock = MonotonicClock()
    bus = CanBus(1_000_000)
    bus.advance(clock.now_ns())
    pump = Pump(bus, clock)
    options = EmulatedDrives(boot_time_s=0.1)
    drives = {f"drive.can0/{node}": EmulatedDrive(bus, node, eds, options) for node in nodes}
    devices: dict[str, FaultyDevice] = {"bus.can0": BusFaults(bus), **drives}
    for drive in drives.values():
        drive.power_on(bus.now_ns)
    server = SocketServer(bus, pump, clock, path)
    adapter = SlcanAdapter(bus, pump, clock)
    pump.touch()
    while any(drive.nmt.state is INITIALISING for drive in drives.values()):
        await asyncio.sleep(0.01)
    sys.stdout.write(json.dumps({"socket": str(path), "slcan": str(adapter.path)}) + "\n")
    sys.stdout.flush()
    try:
        await _obey_standard_input(devices, pump, clock)
    finally:
        server.close()
        adapter.close()
        pump.stop()


async def _obey_standard_input(
    devices: dict[str, FaultyDevice], pump: Pump, clock: MonotonicClock
) -> None:
    lines = asyncio.StreamReader()
    loop = asyncio.get_running_loop()
    await loop.connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    while line := await lines.readline():
        understand(devices, line.decode()).carry_out(clock.now_ns())
        pump.touch()


if __name__ == "__main__":
    run_in_real_time(run(Path(sys.argv[1]), Path(sys.argv[2]), [int(n) for n in sys.argv[3:]]))
