"""An emulated Aurora on a pty in a process of its own: `python -m tests.witnesses.aurora_process`.

Takes the emulation's settings as JSON on the command line and prints the pty's path. After that,
each line on standard input is a fault to inject (`missing=forever`), and is answered when that is
done. Ends with its input.
"""

import asyncio
import json
import sys
from collections.abc import Mapping

import numpy as np

from config.emulation.lab import EmulatedTracker
from daemon.host.clock import MonotonicClock, run_in_real_time
from drivers.pose import Pose
from sim_backends.devices.aurora.device import EmulatedAurora
from sim_backends.devices.aurora.wires import PtyAurora
from sim_backends.faults import understand


def body_poses(t_ns: int) -> Mapping[str, Pose]:
    """A tip that stands still, tilted, above its base."""
    tilted = np.array([0.8, 0.6, 0.0, 0.0])
    upright = np.array([1.0, 0.0, 0.0, 0.0])
    return {
        "tip": Pose(np.array([10.0, -20.0, 150.0]), tilted),
        "base": Pose(np.zeros(3), upright),
    }


async def main(settings: str) -> None:
    clock = MonotonicClock()
    config = EmulatedTracker.model_validate(json.loads(settings))
    device = EmulatedAurora(config, body_poses, powered_up_ns=clock.now_ns())
    shell = PtyAurora(device, clock)
    print(shell.path, flush=True)
    loop = asyncio.get_running_loop()
    ended = loop.create_future()

    def read() -> None:
        line = sys.stdin.readline()
        if line:
            understand({"tracker": device}, f"tracker.{line.strip()}").carry_out(clock.now_ns())
            print("done", flush=True)
        elif not ended.done():
            ended.set_result(None)

    loop.add_reader(sys.stdin.fileno(), read)
    await ended
    shell.close()


if __name__ == "__main__":
    run_in_real_time(main(sys.argv[1]))
