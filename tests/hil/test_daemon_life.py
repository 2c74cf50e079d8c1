"""The daemon as a process that is killed, frozen, flooded and ended: the drives stop every time."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median

import msgspec
import pytest

from daemon.lab_client import ask
from daemon.recording.run_files import PROVENANCE_FILE, RESULT_FILE, ROBOT_FILE, RUN_FILE, unfinished
from daemon.recording.run_reader import RunReader
from daemon.remote.messages import Status
from drivers.cia402.power_state import Control, PowerState
from safety.states import OperatingState
from tests import SOFT_ARM
from tests.hil.daemon_rig import (
    CIRCLE,
    MODEL,
    NODES,
    BusWatch,
    Rig,
    bus_watch,
    daemon,
    farthest,
    rig,
    short_folder,
    user,
)
from tests.hil.processes import PATIENCE_S, Process, command, lab, run

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("daemon_life")]

S = OperatingState

HEARTBEAT_TIMEOUT_S = 0.2
"""As shipped: drives that have not heard their master for this long stop."""
PATIENT = {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
"""Together with drives that wait for two seconds: a machine that stands still does not matter."""
PATIENT_HEARTBEAT_S = 2.0

STOPPED_WITHIN_S = 0.3
STOPPED_AT_THE_LATEST_S = 1.5
"""On a machine that gives the emulated drives no time for a while."""
LOST_AT_MOST_S = 0.3
ATTEMPTS = 5

WEDGED = """
import ctypes, signal, sys, threading
from daemon.cli import main

# A library function that does not let go of the interpreter, as a broken extension module might.
usleep = ctypes.PyDLL(None).usleep
told = threading.Event()

def wedge():
    told.wait()
    for _ in range(4):
        usleep(500_000)

threading.Thread(target=wedge, daemon=True).start()
signal.signal(signal.SIGUSR1, lambda number, frame: told.set())
sys.exit(main(sys.argv[1:]))
"""

CLIENT = """
import asyncio, sys
from pathlib import Path
from daemon.remote.address import LocalAddress
from daemon.remote.client import RobotClient

async def connected():
    return await RobotClient.connect(LocalAddress.in_folder(Path(sys.argv[1])))

"""
DRIVES_THE_ROBOT = (
    CLIENT
    + f"""
async def main():
    client = await connected()
    await client.acquire()
    await client.arm()
    await client.load({CIRCLE!r}, {MODEL!r})
    await client.start()
    print("running", flush=True)
    await asyncio.sleep(1000)

asyncio.run(main())
"""
)
FLOODS = (
    CLIENT
    + """
async def main():
    import zenoh
    from daemon.remote.messages import Arm, Setpoint
    from daemon.remote.wire import encode
    client = await connected()
    session, keys = client._connection.session, client._connection.keys
    arm = encode(Arm())
    setpoint = encode(Setpoint(token="no", sequence=1, position_mm=[0.0, 0.0, 190.0], valid_s=0.1))
    nothing = zenoh.handlers.Callback(lambda reply: None, indirect=False)
    sent, began_s = 0, asyncio.get_running_loop().time()
    print("flooding", flush=True)
    while True:
        for _ in range(14):
            session.put(keys.setpoint("local"), setpoint)
        session.get(keys.command("local", "arm"), nothing, payload=arm)
        sent += 15
        ahead_s = sent / 3000 - (asyncio.get_running_loop().time() - began_s)
        if ahead_s > 0:
            await asyncio.sleep(ahead_s)

asyncio.run(main())
"""
)


def script(text: str, *arguments: str) -> list[str]:
    return [sys.executable, "-c", text, *arguments]


@contextmanager
def client_process(text: str, folder: Path, first_line: str) -> Iterator[Process]:
    """A client that is a program of its own, ended however the test ends."""
    one = Process(script(text, str(folder)))
    try:
        assert one.next_line()[1].strip() == first_line
        yield one
    finally:
        one.leave()


@pytest.fixture
def robot() -> Iterator[Rig]:
    """Drives and daemon that wait patiently where times do not matter."""
    with rig(PATIENT_HEARTBEAT_S, supervision=PATIENT) as one:
        yield one


# What the drives do when nobody tells them anything.


def time_until_stopped(one: Rig, since_s: float) -> float:
    """Look at the shafts until they have not moved for half a second: how long they did."""
    before = one.actuators()
    moved_s = since_s
    while time.monotonic() - moved_s < 0.5:
        now = one.actuators()
        if farthest(before, now) > 0.002:
            before, moved_s = now, time.monotonic()
        time.sleep(0.005)
    return moved_s - since_s


def drives_stop_by_themselves(one: Rig, bus: BusWatch, since_s: float) -> float:
    """How long it took. Asserts that every drive says that it has lost its master, and is off."""
    moved_s = time_until_stopped(one, since_s)
    deadline_s = time.monotonic() + PATIENCE_S
    while len(told := bus.emergencies(since_s)) < len(NODES):
        assert time.monotonic() < deadline_s, f"only {sorted(told)} have noticed"
        time.sleep(0.01)
    assert {code for _, code in told.values()} == {0x8130}  # life guard or heartbeat error
    noticed_s = max(at_s for at_s, _ in told.values()) - since_s
    return max(moved_s, noticed_s)


def assert_nothing_has_torque(states: dict[int, PowerState]) -> None:
    assert not [node for node, state in states.items() if state.energised], states


@pytest.mark.parametrize("recorder_too", [False, True], ids=["alone", "with its recorder"])
def test_killed_while_running_the_drives_stop_and_the_recording_is_there(
    recorder_too: bool, record_property: Callable[[str, object], None]
) -> None:
    """Best of a few attempts: what is asked is what the machinery can do, not the machine."""
    stopped_s, lost_s = [], []
    with rig(HEARTBEAT_TIMEOUT_S) as one:
        robot_path = one.folder / "robot.yaml"
        for attempt in range(ATTEMPTS):
            with bus_watch(one.folder) as bus:
                one.running()
                time.sleep(0.3)
                recording = Path(one.status().recording or "")
                recorder = one.daemon.recorder_pid()
                assert recorder is not None
                wall_ns, at_s = time.time_ns(), time.monotonic()
                one.daemon.kill()
                if recorder_too:
                    os.kill(recorder, signal.SIGKILL)
                stopped_s.append(drives_stop_by_themselves(one, bus, at_s))
                assert_nothing_has_torque(bus.power_states())
            lost_s.append(recovered(one.folder / "runs", recording, recorder_too, wall_ns))
            one.user.close()
            enough = min(stopped_s) <= STOPPED_WITHIN_S and min(lost_s) <= LOST_AT_MOST_S
            if enough and attempt:
                break
            one.daemon.leave()
            one.daemon = daemon_again(one, robot_path)
            one.user = type(one.user)(one.folder)
    record_property("stopped_s", stopped_s)
    record_property("lost_s", lost_s)
    print("stopped after", stopped_s, "lost", lost_s)
    assert max(stopped_s) <= STOPPED_AT_THE_LATEST_S
    assert min(stopped_s) <= STOPPED_WITHIN_S
    assert min(lost_s) <= LOST_AT_MOST_S
