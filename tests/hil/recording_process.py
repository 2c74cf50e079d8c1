"""A process that records as the daemon does, until it is killed: `... FOLDER`.

Its first line is the recorder process' ID; then it writes the number of each message that it has
handed to the recorder.
"""

import asyncio
import sys
from pathlib import Path

from daemon.host.clock import MonotonicClock, run_in_real_time
from daemon.messages import Event
from daemon.recording.flight_recorder import FlightRecorder

EVERY_S = 0.005


async def main(folder: Path) -> None:
    clock, recorder = MonotonicClock(), FlightRecorder()
    await recorder.start(folder, {"robot": "none"}, clock.now_ns(), clock.wall_time_ns())
    print(recorder.pid, flush=True)
    number = 0
    while True:
        number += 1
        t_ns = clock.now_ns()
        recorder.message(
            Event(
                sequence=number,
                t_ns=t_ns,
                kind="note",
                name="beat",
                subject="test",
                present=True,
                text="",
            )
        )
        recorder.can_tap("can0").received(0x181, bytes(8), t_ns)
        print(number, flush=True)
        await asyncio.sleep(EVERY_S)


if __name__ == "__main__":
    run_in_real_time(main(Path(sys.argv[1])))
