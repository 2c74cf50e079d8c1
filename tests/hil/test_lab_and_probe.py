"""Lab and probe as separate processes, over real ptys and sockets, in real time."""

import json
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests import SOFT_ARM
from tests.hil.processes import (
    command,
    event,
    lab,
    probe,
    run,
    soft_arm_over_slcan,
    well,
)

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("hil")]


def test_a_lab_leaves_its_ports_and_takes_them_away_again(tmp_path: Path) -> None:
    with lab(tmp_path) as one:
        assert one.first_line.startswith("soft_arm, emulated, in ")
        assert (tmp_path / "aurora").is_char_device()
        assert (tmp_path / "can0").is_char_device()
        assert (tmp_path / "can0.sock").is_socket()
        assert (tmp_path / "control.sock").is_socket()
        description = json.loads((tmp_path / "lab.json").read_text())
        assert description["robot"] == "soft_arm"
        assert description["pid"] == one.process.pid
        assert description["buses"]["can0"]["nodes"] == [1, 2, 3, 4, 5, 6]
        assert one.end() == 0
    assert list(tmp_path.iterdir()) == []


def test_a_lab_ends_by_itself_and_another_may_follow_or_stand_beside(tmp_path: Path) -> None:
    with lab(tmp_path / "a", "--duration", "2") as one, lab(tmp_path / "b") as other:
        refused = run("emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path / "b"))
        assert refused.returncode == 1
        assert "another lab is running in" in refused.stderr
        assert one.process.wait(timeout=20) == 0
        assert other.process.poll() is None
        with lab(tmp_path / "a") as again:
            assert again.first_line


def test_probe_shows_live_poses_and_six_drives(tmp_path: Path) -> None:
    with lab(tmp_path, "--play", "sway"), probe(tmp_path, "--duration", "6") as one:
        _, first = one.wait_for(well)
        tip = first["tracker"]["tip_mm"]
        _, later = one.wait_for(lambda line: well(line) and line["t_s"] > first["t_s"] + 1.5)
        assert max(abs(a - b) for a, b in zip(tip, later["tracker"]["tip_mm"], strict=True)) > 2.0
        assert later["tracker"]["rate_hz"] == pytest.approx(40.0, abs=1.0)
        assert [axis["node"] for axis in later["axes"]] == [f"can0/{n}" for n in range(1, 7)]
        assert {axis["drive_state"] for axis in later["axes"]} == {"switch on disabled"}
        _, last = one.wait_for(lambda line: line["kind"] == "end")
        assert one.process.wait(timeout=10) == 0
        assert last["conditions"] == []


def test_probe_works_over_the_serial_adapter_too(tmp_path: Path) -> None:
    robot = soft_arm_over_slcan(tmp_path)
    with lab(tmp_path / "lab", robot=robot), probe(tmp_path / "lab", robot=robot) as one:
        _, line = one.wait_for(well)
        assert line["buses"]["can0"]["interface"] == "slcan"
        assert one.end() == 0


@pytest.mark.parametrize("over", ["socket", "slcan"])
def test_a_killed_lab_is_reported_and_probe_recovers_when_it_is_back(
    tmp_path: Path, over: str
) -> None:
    directory = tmp_path / "lab"
    robot = soft_arm_over_slcan(tmp_path) if over == "slcan" else SOFT_ARM
    with lab(directory, robot=robot) as one, probe(directory, robot=robot) as watching:
        watching.wait_for(well)
        killed_s = time.monotonic()
        one.kill()
        told_s = watching.wait_for_events("link_lost", "bus_gone", within_s=5.0)
        assert all(at_s - killed_s < 1.0 for at_s in told_s.values())
        with lab(directory, robot=robot):
            watching.wait_for(well, within_s=30.0)
            assert watching.end() == 0


def test_faults_are_injected_from_the_command_line(tmp_path: Path) -> None:
    with lab(tmp_path) as one, probe(tmp_path) as watching:
        watching.wait_for(well)
        assert (
            one.inject("tracker.missing=0.5s", "drive.can0/3.heartbeat_stop=0.6s").returncode == 0
        )
        watching.wait_for(event("tool_missing"))
        _, lost = watching.wait_for(event("node_lost"))
        assert lost["subject"] == "can0/3"
        watching.wait_for(well)
        wrong = one.inject("tracker.mising=0.5s")
        assert wrong.returncode == 1
        assert "did you mean 'missing'?" in wrong.stderr
        listed = run("inject", "--list", "--runtime-dir", str(tmp_path)).stdout
        assert "drive.can0/1" in listed
        assert ".power_cycle" in listed


def test_a_scenario_happens_by_itself(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "scenario: short\nevents:\n"
        "  - {at_s: 2.5, inject: drive.can0/2.reset}\n"
        "  - {at_s: 3.0, tip_load_g: 14.2}\n"
    )
    directory = tmp_path / "lab"
    with lab(directory, "--scenario", str(scenario)) as one, probe(directory) as watching:
        watching.wait_for(event("node_reset"))
        watching.wait_for(well)
        assert one.process.stdout is not None
        lines = [one.process.stdout.readline() for _ in range(5)]
        assert "2.5 s: drive.can0/2.reset\n" in lines
        assert "3 s: 14.2 g at the tip\n" in lines


def test_a_wrong_scenario_is_explained_and_nothing_starts(tmp_path: Path) -> None:
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "scenario: wrong\nevents:\n  - {at_s: 1.0, inject: tracker.mising}\n  - {at: 3}\n"
    )
    said = run(
        "emulate",
        str(SOFT_ARM),
        "--runtime-dir",
        str(tmp_path / "l"),
        "--scenario",
        str(scenario),
    )
    assert said.returncode == 1
    assert "events[1].at: unknown key" in said.stderr
    scenario.write_text("scenario: wrong\nevents:\n  - {at_s: 1.0, inject: tracker.mising}\n")
    said = run(
        "emulate",
        str(SOFT_ARM),
        "--runtime-dir",
        str(tmp_path / "l"),
        "--scenario",
        str(scenario),
    )
    assert f"{scenario}:3:25: events[0].inject: 'tracker.mising'" in said.stderr


def test_ctrl_c_ends_the_demonstration_with_no_process_left() -> None:
    one = subprocess.Popen(
        command("demo"), stdout=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        time.sleep(6.0)
        children = processes_in_session(one.pid)
        assert len(children) >= 2
        one.send_signal(signal.SIGINT)
        one.wait(timeout=15)
        assert processes_in_session(one.pid) == []
    finally:
        one.kill()
        one.communicate()


def processes_in_session(session: int) -> list[int]:
    """Living processes whose session it is."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[3]) == session and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found
