"""`python -m tests.daemon.remote.serve FOLDER ENDING`: a daemon in a process of its own.

It says `ready`, publishes tips, and ends as ENDING says once its standard input is closed.
"""

import asyncio
import sys
from pathlib import Path

from config.remote import Remote
from daemon.host.clock import run_in_real_time
from daemon.remote.server.server import RemoteServer
from tests.daemon.remote.rig import ROBOT, FakeRobot, tip

_TIPS_EVERY_S = 0.025


async def serve(folder: Path, ending: str) -> None:
    server = RemoteServer(
        ROBOT, Remote(), folder, FakeRobot(lease_s=2.0), simulated=True, version="1.2.3"
    )
    await server.open()
    print("ready", flush=True)
    ended = asyncio.create_task(asyncio.to_thread(sys.stdin.read))
    number = 0
    while not ended.done():
        server.publish(tip(number))
        number += 1
        await asyncio.sleep(_TIPS_EVERY_S)
    if ending == "raise":
        raise RuntimeError("ending without closing")
    if ending == "exit":
        sys.exit(3)
    if ending == "close":
        await server.close()


if __name__ == "__main__":
    run_in_real_time(serve(Path(sys.argv[1]), sys.argv[2]))
