"""A bus has one master: whoever comes second sends nothing, and is told who was first."""

import json
import os
import select
import signal
import socket
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest

from daemon.commands.outcome.exit_codes import EXIT_INTERRUPTED, EXIT_UNAVAILABLE
from daemon.recording.result import read_result
from daemon.recording.run_folder import RESULT_FILE, RUN_FILE, unfinished
from daemon.recording.run_reader import RunReader
from drivers.canopen.codec import cob_ids
from tests import SOFT_ARM
from tests.hil.bus_watch import bus_watch
from tests.hil.daemon_rig import PATIENT, Rig, S, rig, short_folder
from tests.hil.processes import PATIENCE_S, command, lab, run

pytestmark = [pytest.mark.hil, pytest.mark.long, pytest.mark.xdist_group("hil")]

LOOP_TIMES = {"loop_hold_after_s": 0.5, "loop_fault_after_s": 1.5}
"""A busy machine is not what is asked about here."""


ENDLESS = """
experiment: endless
robot: builtin:soft_arm
trajectory: {kind: circle, center_mm: [0, 0, 185], radius_mm: 8, cycle_s: 4, cycles: 5000}
controller: {kind: constant_curvature}
"""
ENOUGH_BYTES = 500_000
"""Of a recording: some seconds of motion."""


@pytest.fixture(scope="module")
def robot() -> Iterator[Rig]:
    with rig(PATIENT, LOOP_TIMES) as one:
        yield one


def frames_of_a_master(robot: Rig, arguments: list[str]) -> tuple[list[int], str, int]:
    """What went over the bus that only a set-up sends, what was said, and the exit code."""
    set_ups = {cob_ids.NMT, *(cob_ids.sdo_request(node) for node in range(1, 128))}
    with bus_watch(robot.folder) as bus:
        done = run(*arguments)
        frames = [can_id for _, can_id, _ in bus.frames if can_id in set_ups]
    return frames, done.stdout + done.stderr, done.returncode


def test_probe_beside_a_moving_robot_shows_what_the_daemon_says(robot: Rig) -> None:
    robot.running()
    where = ["--runtime-dir", str(robot.folder), "--duration", "3"]
    probe = ["probe", str(robot.robot), *where, "--json", "--every", "0.2"]
    frames, said, _ = frames_of_a_master(robot, probe)
    assert frames == []
    assert f"process {robot.daemon.pid} (tentacled run " in said
    lines = [json.loads(line)["result"] for line in said.splitlines() if line.startswith("{")]
    assert {line["kind"] for line in lines} == {"status"}
    assert len(lines) > 3
    assert len(lines[-1]["axes"]) == 6
    assert "is the master of this bus" in said
    frames, said, _ = frames_of_a_master(robot, ["probe", str(robot.robot), *where])
    assert frames == []
    assert "RUNNING    soft_arm  SIMULATED" in said
    assert robot.state is S.RUNNING
    assert not robot.events("state", S.FAULT.value)


def test_probe_of_frames_beside_a_daemon_says_who_has_the_bus(robot: Rig, tmp_path: Path) -> None:
    robot.running()
    wants_frames = ["--runtime-dir", str(robot.folder), "--capture", str(tmp_path / "bus.pcap")]
    frames, said, code = frames_of_a_master(robot, ["probe", str(robot.robot), *wants_frames])
    assert (frames, code) == ([], EXIT_UNAVAILABLE)
    assert f"process {robot.daemon.pid} (tentacled run " in said
    assert "Traceback" not in said
    assert robot.state is S.RUNNING


def test_a_second_daemon_in_another_folder_is_refused_the_bus(robot: Rig) -> None:
    robot.running()
    text = robot.robot.read_text()
    with short_folder() as elsewhere:
        for name in ("aurora", "can0.sock"):  # the same devices by other names
            (elsewhere / name).symlink_to(robot.folder / name)
        other = elsewhere / "robot.yaml"
        other.write_text(text)
        arguments = ["run", str(other), "--runtime-dir", str(elsewhere), "--no-real-time"]
        frames, said, code = frames_of_a_master(
            robot, [*arguments, "--runs", str(elsewhere / "runs")]
        )
        assert (frames, code) == ([], EXIT_UNAVAILABLE)
        assert f"process {robot.daemon.pid} (tentacled run " in said
        assert "Traceback" not in said
        assert not (elsewhere / "daemon.json").exists()
    assert robot.state is S.RUNNING
    assert not robot.events("state", S.FAULT.value)


def by_another_door(robot: Rig, interface: str, channel: Path) -> str:
    """The same robot, with a bus that is opened elsewhere: its file."""
    text = robot.robot.read_text().replace("lab:can0.sock", str(channel))
    assert "interface: tentacled" in text
    other = robot.folder / "other.yaml"
    other.write_text(text.replace("interface: tentacled", f"interface: {interface}"))
    return str(other)


def test_a_second_master_by_the_other_door_of_an_emulated_bus_is_refused_it(robot: Rig) -> None:
    robot.running()
    for door in (robot.folder / "can0", (robot.folder / "can0").resolve()):
        other = by_another_door(robot, "slcan", door)
        with short_folder() as elsewhere:
            (elsewhere / "aurora").symlink_to(robot.folder / "aurora")
            where = ["--runtime-dir", str(elsewhere)]
            daemon = ["run", other, *where, "--no-real-time", "--runs", str(elsewhere / "runs")]
            wants_frames = ["probe", other, *where, "--capture", str(elsewhere / "bus.pcap")]
            for words in (daemon, wants_frames):
                frames, said, code = frames_of_a_master(robot, words)
                assert (frames, code) == ([], EXIT_UNAVAILABLE)
                assert f"{door} is taken: process {robot.daemon.pid} (tentacled run " in said
                assert "Traceback" not in said
    assert robot.state is S.RUNNING
    assert not robot.events("state", S.FAULT.value)


@contextmanager
def another_adapter(bus: Path) -> Iterator[Path]:
    """Plugged into an emulated bus: a socket that hands everything on, one client at a time."""
    path = bus.with_name("other.sock")
    ended = threading.Event()

    def relay() -> None:
        while not ended.is_set():
            with suppress(OSError), listening.accept()[0] as client, _connected(bus) as there:
                _hand_on(client, there)

    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as listening:
        listening.bind(str(path))
        listening.listen()
        listening.settimeout(0.1)
        thread = threading.Thread(target=relay)
        thread.start()
        try:
            yield path
        finally:
            ended.set()
            thread.join()


def _connected(bus: Path) -> socket.socket:
    there = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    there.connect(str(bus))
    return there


def _hand_on(one: socket.socket, other: socket.socket) -> None:
    """Until either hangs up."""
    ends = {one: other, other: one}
    while True:
        for end in select.select(list(ends), [], [])[0]:
            packet = end.recv(64)
            if not packet:
                return
            ends[end].send(packet)


def test_a_master_that_comes_by_another_adapter_hears_us_and_keeps_silent(robot: Rig) -> None:
    """No lock can know that both adapters are plugged into one bus."""
    robot.running()
    with another_adapter(robot.folder / "can0.sock") as door:
        other = by_another_door(robot, "tentacled", door)
        probe = ["probe", other, "--runtime-dir", str(robot.folder), "--json", "--duration", "4"]
        frames, said, code = frames_of_a_master(robot, probe)
    assert (frames, code) == ([], 1)
    lines = [json.loads(line)["result"] for line in said.splitlines() if line.startswith("{")]
    told = [line for line in lines if line.get("name") == "bus_foreign_master"]
    assert told, said
    assert told[0]["detail"] == "SYNC" or "set-point" in told[0]["detail"]
    assert robot.state is S.RUNNING
    assert not robot.events("state", S.FAULT.value)


def test_another_master_is_named_and_clearing_works_when_it_has_gone(robot: Rig) -> None:
    robot.running()
    robot.inject("bus.can0.foreign_master=3s,sdo")
    told = robot.until_told("foreign_master")
    assert "SDO read of node 1" in told.detail
    robot.until_it_was(S.FAULT)
    robot.until(lambda: "foreign_master" in robot.causes())
    time.sleep(5.0)
    robot.running()


def test_a_killed_daemon_has_the_bus_no_more() -> None:
    with rig(PATIENT, LOOP_TIMES) as one:
        one.ready()
        one.daemon.kill()
        one.start_daemon_again()
        one.ready()


@pytest.mark.long
def test_a_terminal_that_closes_stops_the_drives_and_keeps_the_recording() -> None:
    with rig(PATIENT, LOOP_TIMES) as one:
        one.running()
        recording = Path(one.status().recording or "")
        one.daemon.process.send_signal(signal.SIGHUP)
        assert one.daemon.process.wait(PATIENCE_S) == 0
        assert (recording / RUN_FILE).exists()
        assert (recording / RESULT_FILE).exists()
        assert not unfinished(recording / RUN_FILE).exists()


def test_a_second_lab_in_a_folder_leaves_the_first_one_as_it_is(tmp_path: Path) -> None:
    with lab(tmp_path) as one:
        there = {path.name: path.lstat().st_ino for path in tmp_path.iterdir()}
        for _ in range(2):
            refused = run("emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path))
            assert refused.returncode == EXIT_UNAVAILABLE
            assert f"another lab is running in {tmp_path} (process {one.process.pid}" in (
                refused.stderr
            )
        assert {path.name: path.lstat().st_ino for path in tmp_path.iterdir()} == there
        assert one.inject("tracker.missing=0.1s").returncode == 0
        assert one.end() == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_probe_without_its_serial_port_ends_when_it_is_told(
    tmp_path: Path, number: signal.Signals
) -> None:
    with short_folder() as nothing:
        probe = command("probe", str(SOFT_ARM), "--runtime-dir", str(nothing), "--json")
        for _ in range(3):
            with subprocess.Popen(probe, stdout=subprocess.PIPE, text=True) as process:
                assert process.stdout is not None
                assert process.stdout.readline()
                process.send_signal(number)
                process.communicate(timeout=PATIENCE_S)
                assert process.returncode == 1


@pytest.mark.long
@pytest.mark.parametrize(
    ("real_time", "number"),
    [(False, signal.SIGTERM), (False, signal.SIGHUP), (True, signal.SIGTERM)],
    ids=["virtual time, SIGTERM", "virtual time, SIGHUP", "real time, SIGTERM"],
)
def test_an_experiment_that_is_told_to_end_keeps_what_it_has(
    tmp_path: Path, number: signal.Signals, real_time: bool
) -> None:
    file, run_folder = tmp_path / "experiment.yaml", tmp_path / "run"
    file.write_text(ENDLESS)
    words = ["experiment", str(file), "--out", str(run_folder), "--no-report"]
    part = unfinished(run_folder / RUN_FILE)
    with subprocess.Popen(
        command(*words, *(["--real-time"] if real_time else [])),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": "/tmp"},  # the name of a unix socket must be short
    ) as process:
        deadline_s = time.monotonic() + PATIENCE_S
        while not (part.exists() and part.stat().st_size > ENOUGH_BYTES):
            assert time.monotonic() < deadline_s
            assert process.poll() is None, process.communicate()
            time.sleep(0.05)
        process.send_signal(number)
        _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == EXIT_INTERRUPTED, said
    assert f"what was recorded is in {run_folder}" in said
    assert not part.exists()
    reader = RunReader(run_folder / RUN_FILE)
    assert sum(1 for _ in reader.messages()) > 0
    assert reader.whole
    result = read_result(run_folder)
    assert result is not None
    assert result.steps > 0
    assert result.final_state in (S.STANDBY.value, S.READY.value)
