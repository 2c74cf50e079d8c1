"""The daemon as a process that is killed, frozen, flooded and ended: the drives stop every time."""

import json
import os
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median

import msgspec
import pytest

from daemon.commands.outcome.exit_codes import EXIT_REFUSED, EXIT_UNAVAILABLE, EXIT_USAGE
from daemon.messages import LoopStatus, Status
from daemon.recording.format.channels import RAW_CAN, read_can_payload
from daemon.recording.result import Result
from daemon.recording.run_folder import (
    PROVENANCE_FILE,
    RESULT_FILE,
    ROBOT_FILE,
    RUN_FILE,
    unfinished,
)
from daemon.recording.run_reader import RunReader
from drivers.canopen.codec import cob_ids
from drivers.cia402.power_state import Control, PowerState
from safety.states import OperatingState
from tests.hil.bus_watch import BusWatch, bus_watch
from tests.hil.daemon_rig import (
    AS_ON_A_RIG,
    BEFORE_THE_DRIVES,
    CIRCLE,
    MODEL,
    NODES,
    PATIENT,
    Rig,
    farthest,
    rig,
    short_folder,
)
from tests.hil.processes import PATIENCE_S, Process, run

pytestmark = [pytest.mark.long, pytest.mark.hil, pytest.mark.xdist_group("daemon_life")]

S = OperatingState

LOOP_TIMES = {"loop_hold_after_s": 0.4, "loop_fault_after_s": 1.5}
"""A loop that gets no turn for a moment is no news either."""

STOPPED_WITHIN_S = 0.3
STOPPED_AT_THE_LATEST_S = 1.5
"""On a machine that gives the emulated drives no time for a while."""
LOST_AT_MOST_S = 0.3
SYNC_LOST, HEARTBEAT_LOST = 0x8700, 0x8130
"""Error codes: which comes first depends on where in its period the master stopped."""
OF_OUR_OWN = ("loop_late", "loop_stalled", "internal_error", "lease_lost", "setpoint_late")
"""Causes that say that the daemon itself was disturbed."""
ATTEMPTS = 5
STOPS = 12
QUICK_STOP = Control.QUICK_STOP

WEDGED = """
import ctypes, signal, sys, threading
from daemon.commands.terminal.command_line import main

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

DATES_JUMP = """
import signal, sys, time
from daemon.commands.terminal.command_line import main

# As when somebody sets the clock, or a time server does: an hour on, then two hours back.
HOUR_NS = 3600 * 10**9
jumps, ahead_ns, date_ns = [HOUR_NS, -2 * HOUR_NS], [0], time.time_ns
time.time_ns = lambda: date_ns() + ahead_ns[0]
time.time = lambda: time.time_ns() * 1e-9
signal.signal(signal.SIGUSR1, lambda number, frame: ahead_ns.append(ahead_ns.pop() + jumps.pop(0)))
sys.exit(main(sys.argv[1:]))
"""

CLIENT = """
import asyncio, sys
from pathlib import Path
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient

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
    from daemon.messages import Arm, Setpoint
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
    with rig(PATIENT, LOOP_TIMES) as one:
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
    assert {code for _, code in told.values()} <= {SYNC_LOST, HEARTBEAT_LOST}
    noticed_s = max(at_s for at_s, _ in told.values()) - since_s
    return max(moved_s, noticed_s)


def assert_nothing_has_torque(states: dict[int, PowerState]) -> None:
    assert not [node for node, state in states.items() if state.energised], states


@pytest.mark.parametrize("recorder_too", [False, True], ids=["alone", "with its recorder"])
def test_killed_while_running_the_drives_stop_and_the_recording_is_there(
    recorder_too: bool,
) -> None:
    """Best of a few attempts: what is asked is what the machinery can do, not the machine."""
    stopped_s, lost_s = list[float](), list[float]()
    with rig(AS_ON_A_RIG, BEFORE_THE_DRIVES) as one:
        for _ in range(ATTEMPTS):
            with bus_watch(one.folder) as bus:
                one.running()
                time.sleep(0.3)
                recording, recorder = Path(one.status().recording or ""), one.daemon.recorder_pid()
                assert recorder is not None
                killed_s, killed_ns = time.monotonic(), time.time_ns()
                if recorder_too:  # first, or it finishes the file in no time
                    os.kill(recorder, signal.SIGKILL)
                one.daemon.kill()
                stopped_s.append(drives_stop_by_themselves(one, bus, killed_s))
                assert_nothing_has_torque(bus.power_states())
            lost_s.append(recording_lost_s(recording, recorder_too, killed_ns))
            with bus_watch(one.folder) as bus:
                one.start_daemon_again()
                assert one.state in (S.STANDBY, S.READY)
                one.ready()
                words = {word for _, _, word in bus.controlwords(killed_s)}
                assert words <= {Control.DISABLE_VOLTAGE, Control.FAULT_RESET}
            if min(stopped_s) <= STOPPED_WITHIN_S and min(lost_s) <= LOST_AT_MOST_S:
                break
    print("stopped after", stopped_s, "s, recording lost", lost_s, "s")
    assert max(stopped_s) <= STOPPED_AT_THE_LATEST_S
    assert min(stopped_s) <= STOPPED_WITHIN_S
    assert min(lost_s) <= LOST_AT_MOST_S


def recording_lost_s(recording: Path, recorder_too: bool, killed_ns: int) -> float:
    """What is missing at the end of the recording, once `recover` has been at it."""
    if not recorder_too:  # it finishes the file by itself
        wait_for(recording / RUN_FILE)
    told = run("recover", str(recording.parent))
    assert told.returncode == 0, told.stderr
    assert ("messages saved" in told.stdout) is recorder_too, told.stdout
    reader = RunReader(recording / RUN_FILE)
    newest_ns = max(message.wall_ns for message in reader.messages())
    assert reader.whole
    return (killed_ns - newest_ns) * 1e-9


def wait_for(path: Path) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not path.exists():
        assert time.monotonic() < deadline_s, f"there is no {path}"
        time.sleep(0.02)


def test_frozen_while_running_the_drives_stop_and_it_comes_back_in_fault() -> None:
    with rig(AS_ON_A_RIG, BEFORE_THE_DRIVES) as one, bus_watch(one.folder) as bus:
        one.running()
        frozen_s = time.monotonic()
        os.kill(one.daemon.pid, signal.SIGSTOP)
        try:
            took_s = drives_stop_by_themselves(one, bus, frozen_s)
            time.sleep(max(0.0, frozen_s + 2.0 - time.monotonic()))
            assert_nothing_has_torque(bus.power_states())
        finally:
            os.kill(one.daemon.pid, signal.SIGCONT)
        print("stopped after", took_s, "s")
        assert took_s <= STOPPED_AT_THE_LATEST_S
        comes_back_in_fault_and_can_be_cleared(one)


def comes_back_in_fault_and_can_be_cleared(one: Rig) -> None:
    one.until(lambda: "loop_stalled" in one.causes())  # its events may have had no way to us
    assert one.state is S.FAULT
    assert one.user.refused(one.client.arm()).name in ("not_ready", "no_lease", "wrong_state")
    one.until_without_torque()
    one.armed()
    assert one.energised


def test_wedged_by_one_of_its_own_threads_the_drives_stop_all_the_same() -> None:
    program = [sys.executable, "-c", WEDGED]
    with rig(AS_ON_A_RIG, BEFORE_THE_DRIVES, program=program) as one, bus_watch(one.folder) as bus:
        one.running()
        wedged_s = time.monotonic()
        os.kill(one.daemon.pid, signal.SIGUSR1)
        took_s = drives_stop_by_themselves(one, bus, wedged_s)
        print("stopped after", took_s, "s")
        assert took_s <= STOPPED_AT_THE_LATEST_S
        assert_nothing_has_torque(bus.power_states())
        comes_back_in_fault_and_can_be_cleared(one)


def test_a_clock_that_is_set_changes_nothing_and_dates_nothing_wrongly() -> None:
    with rig(PATIENT, LOOP_TIMES, script(DATES_JUMP)) as one:
        one.running()
        recording, held = Path(one.status().recording or ""), len(one.events("state", S.HOLD.value))
        for _ in range(2):
            os.kill(one.daemon.pid, signal.SIGUSR1)
            before = one.actuators()
            time.sleep(1.5)
            assert one.state is S.RUNNING
            assert farthest(before, one.actuators()) > 0.05
        assert len(one.events("state", S.HOLD.value)) == held
        one.user.do(one.client.stop())
        wait_for(recording / RESULT_FILE)
        dates = [message.wall_ns for message in RunReader(recording / RUN_FILE).messages()]
        assert max(dates) - min(dates) < 600 * 10**9


# What its clients do to it.


def test_a_client_that_is_killed_leaves_the_robot_held_and_then_switched_off() -> None:
    times = LOOP_TIMES | {"lease_s": 1.0, "lease_disarm_after_s": 2.0}
    with rig(PATIENT, times) as one:
        one.until_state(S.READY)
        with client_process(DRIVES_THE_ROBOT, one.folder, "running") as client:
            one.until_state(S.RUNNING)
            one.from_now_on()
            client.kill()
            one.until_told("lease_lost")
            one.until_it_was(S.HOLD)
            assert one.until_told("lease_abandoned").severity == "disarm"
            one.until_it_was(S.STANDBY)
            one.until_without_torque()
        one.running()  # somebody else takes over


def test_a_client_that_floods_disturbs_nobody(robot: Rig) -> None:
    robot.running()
    time.sleep(2.0)
    quiet = robot.status().loop
    with client_process(FLOODS, robot.folder, "flooding"):
        time.sleep(3.0)
        flooded = robot.status()
        print("lateness p50, p99, max:", *(_lateness(loop) for loop in (quiet, flooded.loop)))
        assert not [name for name in OF_OUR_OWN if robot.events("cause", name)]
        assert flooded.loop.cycle_rate_hz > 25.0
        goes = robot.state is S.RUNNING  # or the emulated drives got no time beside the flood
        asked_s = time.monotonic()
        answer = robot.user.do(robot.client.stop())
        print("stop answered after", time.monotonic() - asked_s, "s")
        assert answer.confirmed or not goes
    robot.until_without_torque()


def _lateness(loop: LoopStatus) -> tuple[float, float, float]:
    return loop.lateness_p50_s, loop.lateness_p99_s, loop.lateness_max_s


def test_a_stop_is_on_the_bus_at_once(robot: Rig) -> None:
    took_s = list[float]()
    for _ in range(STOPS):
        robot.armed()
        recording = Path(robot.status().recording or "")
        with bus_watch(robot.folder) as bus:
            asked_s = time.monotonic()
            answer = robot.user.do(robot.client.stop())
            if not answer.confirmed:  # an emulated drive got no turn, and has not said so
                continue
            first_s = min(t for t, _, word in bus.controlwords(asked_s) if word == QUICK_STOP)
        wait_for(recording / RESULT_FILE)
        in_recording_s = quick_stop_in(recording / RUN_FILE, asked_s)
        assert abs(in_recording_s - first_s) < 1.0
        took_s.append(in_recording_s - asked_s)
    assert len(took_s) > STOPS // 2
    ordered = sorted(took_s)
    print(f"stop to quick stop: median {median(took_s)}, worst {ordered[-1]}")
    assert median(took_s) < 0.1


def quick_stop_in(path: Path, since_s: float) -> float:
    """When the first controlword for a quick stop went out, as it is recorded."""
    for message in RunReader(path).messages([RAW_CAN + "can0"]):
        for t_ns, frame in read_can_payload(message.data):
            word = int.from_bytes(frame.data[:2], "little")
            ours = frame.can_id in [cob_ids.rpdo(node, 1) for node in NODES]
            if ours and t_ns * 1e-9 >= since_s and word == QUICK_STOP:
                return t_ns * 1e-9
    raise AssertionError("there is no quick stop in the recording")


# Its own life.


def test_only_one_daemon_runs_in_a_folder(robot: Rig) -> None:
    robot.running()
    where = ["--runtime-dir", str(robot.folder), "--runs", str(robot.folder / "other")]
    second = run("run", str(robot.robot), *where, "--no-real-time")
    assert second.returncode == EXIT_UNAVAILABLE
    assert f"a daemon is running in {robot.folder} (process {robot.daemon.pid})" in second.stderr
    assert "Traceback" not in second.stderr
    assert robot.state is S.RUNNING


def test_its_devices_die_and_new_ones_work_without_a_restart(robot: Rig) -> None:
    robot.running()
    robot.lab.kill()
    robot.until_it_was(S.FAULT)
    assert {"bus_gone"} <= robot.causes()
    time.sleep(0.5)
    assert robot.state is S.FAULT
    robot.start_lab_again()
    robot.running()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["Ctrl-C", "SIGTERM"])
def test_ended_while_running_the_drives_are_off_before_it_goes(
    robot: Rig, number: signal.Signals
) -> None:
    robot.running()
    recording = Path(robot.status().recording or "")
    with bus_watch(robot.folder) as bus:
        told_s = time.monotonic()
        robot.daemon.process.send_signal(number)
        assert robot.daemon.process.wait(PATIENCE_S) == 0
        print("ended after", time.monotonic() - told_s, "s")
        assert_nothing_has_torque(bus.power_states())
        words = [word for _, _, word in bus.controlwords(told_s)]
        assert words.index(QUICK_STOP) < words.index(Control.DISABLE_VOLTAGE)
        assert not bus.emergencies(told_s)  # they were told, and had not to find out
    assert not unfinished(recording / RUN_FILE).exists()
    assert {ROBOT_FILE, PROVENANCE_FILE, RESULT_FILE} <= {f.name for f in recording.iterdir()}
    reader = RunReader(recording / RUN_FILE)
    topics = {message.topic for message in reader.messages()}
    assert reader.whole
    assert {"/tip", "/axes", "/event", "/state", "/raw/tracker", "/raw/can/can0"} <= topics
    result = msgspec.json.decode((recording / RESULT_FILE).read_bytes(), type=Result)
    assert result.trajectory == "circle"
    assert result.steps > 0


def test_status_tells_programs_everything(robot: Rig) -> None:
    robot.running()
    told = run("status", "--runtime-dir", str(robot.folder), "--json")
    assert told.returncode == 0
    wanted = {field.encode_name for field in msgspec.structs.fields(Status)}
    result = json.loads(told.stdout)["result"]
    assert set(result) == wanted | {"type"}
    status = msgspec.convert(result, Status)
    assert status.state == S.RUNNING.value
    assert status.tip_mm is not None
    assert status.error_mm is not None
    assert status.reference is not None
    assert status.reference.trajectory == "circle"
    assert [axis.drive_state for axis in status.axes] == ["operation enabled"] * len(NODES)
    assert status.lease.holder == "local"
    assert status.recording is not None


def test_commands_end_with_codes_that_scripts_can_tell_apart(robot: Rig) -> None:
    where = ["--runtime-dir", str(robot.folder)]
    robot.ready()
    with short_folder() as empty:
        nobody = run("status", "--runtime-dir", str(empty))
    assert nobody.returncode == EXIT_UNAVAILABLE
    assert "no daemon is running" in nobody.stderr
    refused = run("arm", *where)
    assert refused.returncode == EXIT_REFUSED
    assert "lease" in refused.stderr
    assert run("status", *where).returncode == 0
    assert run("stop", *where).returncode == 0
    assert run("stop", "--no-such-option").returncode == EXIT_USAGE
    robot.daemon.kill()
    assert run("stop", *where).returncode == EXIT_UNAVAILABLE
