"""Lab and probe as separate processes, over real ptys and sockets, in real time."""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from config.loader import load_robot
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION, EXIT_UNAVAILABLE, EXIT_USAGE
from daemon.commands.terminal.command_line import main
from daemon.robot.lab_connections import ask
from daemon.workbench.pretraining.model_cache import pretrained
from tests import SOFT_ARM
from tests.hil.daemon_rig import PATIENT, rig
from tests.hil.processes import (
    PATIENCE_S,
    Process,
    command,
    event,
    lab,
    probe,
    run,
    soft_arm_over_slcan,
    well,
    without,
)

pytestmark = [pytest.mark.hil, pytest.mark.xdist_group("hil")]

SCENARIOS = Path(__file__).parents[2] / "config" / "scenarios"


def test_a_lab_leaves_its_ports_and_takes_them_away_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """And no other lab takes them meanwhile."""
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
        assert main(["emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path)]) == EXIT_UNAVAILABLE
        assert "another lab is running in" in capsys.readouterr().err
        assert one.end() == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_lab_ends_by_itself_and_another_may_follow_or_stand_beside(tmp_path: Path) -> None:
    with lab(tmp_path / "a", "--duration", "2") as one, lab(tmp_path / "b") as other:
        refused = run("emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path / "b"))
        assert refused.returncode == EXIT_UNAVAILABLE
        assert "another lab is running in" in refused.stderr
        assert one.process.wait(PATIENCE_S) == 0
        assert other.process.poll() is None
        with lab(tmp_path / "a") as again:
            assert again.first_line


def test_probe_shows_live_poses_six_drives_and_what_a_scenario_does(tmp_path: Path) -> None:
    scenario, directory = tmp_path / "scenario.yaml", tmp_path / "lab"
    resets = (3.5, 10, 20, 40, 60)  # the first that comes when the probe knows the drive is told
    scenario.write_text(
        "scenario: short\nevents:\n  - {at_s: 2.5, tip_load_g: 14.2}\n"
        + "".join(f"  - {{at_s: {t}, inject: drive.can0/2.reset}}\n" for t in resets)
    )
    words = ("--play", "sway", "--scenario", str(scenario))
    with lab(directory, *words) as playing, probe(directory) as one:
        _, first = one.wait_for(well)
        assert [axis["node"] for axis in first["axes"]] == [f"can0/{n}" for n in range(1, 7)]
        assert {axis["drive_state"] for axis in first["axes"]} == {"switch on disabled"}
        one.wait_for(lambda line: tip_has_moved(first, line) > 2.0)
        # A machine that stands still misses frames; in some two seconds it does not.
        one.wait_for(
            lambda line: (
                line["kind"] == "snapshot"
                and line["tracker"]["rate_hz"] == pytest.approx(40.0, abs=1.0)
            )
        )
        playing.says("2.5 s: 14.2 g at the tip", "3.5 s: drive.can0/2.reset")
        one.wait_for(event("node_reset", "can0/2"))
        one.wait_for(well)
        assert one.end() in (0, 1)


def tip_has_moved(before: dict[str, Any], line: dict[str, Any]) -> float:
    """The largest of the three ways, in mm; none where the tip is not seen."""
    if line["kind"] != "snapshot" or line["tracker"]["tip_mm"] is None:
        return 0.0
    tips = zip(before["tracker"]["tip_mm"], line["tracker"]["tip_mm"], strict=True)
    return float(max(abs(a - b) for a, b in tips))


def test_probe_ends_by_itself_and_its_exit_code_says_that_not_all_was_well(tmp_path: Path) -> None:
    assert exit_code_of_a_short_probe(tmp_path / "nothing", 1.0) == 1


@pytest.mark.long
def test_where_all_was_well_its_exit_code_says_so(tmp_path: Path) -> None:
    with lab(tmp_path / "lab"):
        assert any_of_three(lambda: exit_code_of_a_short_probe(tmp_path / "lab", 3.0) == 0)


def exit_code_of_a_short_probe(directory: Path, for_s: float) -> int:
    with probe(directory, "--duration", str(for_s)) as one:
        one.wait_for(lambda line: line["kind"] == "end")
        return one.process.wait(PATIENCE_S)


def any_of_three(succeeds: Callable[[], bool]) -> bool:
    """For what only a busy machine prevents now and then."""
    return any(succeeds() for _ in range(3))


@pytest.mark.long
def test_probe_works_over_the_serial_adapter_too(tmp_path: Path) -> None:
    robot = soft_arm_over_slcan(tmp_path)
    with lab(tmp_path / "lab", robot=robot), probe(tmp_path / "lab", robot=robot) as one:
        _, line = one.wait_for(well)
        assert line["buses"]["can0"]["interface"] == "slcan"
        assert one.end() in (0, 1)


@pytest.mark.parametrize("over", ["socket", pytest.param("slcan", marks=pytest.mark.long)])
def test_a_killed_lab_is_reported_and_probe_recovers_when_it_is_back(
    tmp_path: Path, over: str
) -> None:
    directory = tmp_path / "lab"
    robot = soft_arm_over_slcan(tmp_path) if over == "slcan" else SOFT_ARM

    def told_within_a_second() -> bool:
        with lab(directory, robot=robot) as one:
            watching.wait_for(well)
            killed_s = time.monotonic()
            one.kill()
            told_s = watching.wait_for_events("link_lost", "bus_gone")
        return max(told_s.values()) - killed_s < 1.0

    with probe(directory, robot=robot) as watching:
        assert any_of_three(told_within_a_second)
        with lab(directory, robot=robot):
            watching.wait_for(well)
            assert watching.end() in (0, 1)


@pytest.mark.long
def test_faults_are_injected_from_the_command_line(tmp_path: Path) -> None:
    with lab(tmp_path) as one, probe(tmp_path) as watching:
        watching.wait_for(well)
        # Long enough to be seen by a machine that stands still meanwhile.
        injected = one.inject("tracker.missing=4s", "drive.can0/3.heartbeat_stop=4s")
        assert injected.returncode == 0, injected.stderr
        watching.wait_for_each(event("tool_missing", "tracker/tip"), event("node_lost", "can0/3"))
        watching.wait_for(without("tool_missing", "node_lost"))
        wrong = one.inject("tracker.mising=0.5s")
        assert wrong.returncode == EXIT_USAGE
        assert "did you mean 'missing'?" in wrong.stderr
        listed = run("inject", "--list", "--runtime-dir", str(tmp_path)).stdout
        assert "drive.can0/1" in listed
        assert ".power_cycle" in listed


@pytest.mark.long
@pytest.mark.parametrize("scenario", sorted(SCENARIOS.glob("*.yaml")), ids=lambda path: path.stem)
def test_a_shipped_scenario_is_understood(tmp_path: Path, scenario: Path) -> None:
    with lab(tmp_path, "--scenario", str(scenario)) as one:
        assert one.first_line.startswith("soft_arm, emulated")


def test_a_wrong_scenario_is_explained_and_nothing_starts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["emulate", str(SOFT_ARM), "--runtime-dir", str(tmp_path / "l")]
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "scenario: wrong\nevents:\n  - {at_s: 1.0, inject: tracker.mising}\n  - {at: 3}\n"
    )
    assert main([*words, "--scenario", str(scenario)]) == EXIT_CONFIGURATION
    assert "events[1].at: unknown key" in capsys.readouterr().err
    scenario.write_text("scenario: wrong\nevents:\n  - {at_s: 1.0, inject: tracker.mising}\n")
    assert main([*words, "--scenario", str(scenario)]) == EXIT_CONFIGURATION
    told = capsys.readouterr().err
    assert f"{scenario}:3:25: events[0].inject: 'tracker.mising'" in told
    assert not (tmp_path / "l").exists()


@pytest.fixture(scope="module")
def explored() -> Path:
    """The model that the demonstration begins with, which takes a minute the first time."""
    return pretrained(load_robot(SOFT_ARM))


@pytest.mark.long
@pytest.mark.parametrize("after_s", [0.0, 4.0, 20.0])
@pytest.mark.usefixtures("explored")
def test_ctrl_c_ends_the_demonstration_with_nothing_left(tmp_path: Path, after_s: float) -> None:
    # Not in tmp_path: the name of a unix socket has room for about a hundred characters.
    with TemporaryDirectory(prefix="t-") as temporary:
        environment = os.environ | {"TMPDIR": temporary}
        one = Process(command("demo"), start_new_session=True, env=environment, cwd=tmp_path)
        try:
            wait_until(lambda: list(Path(temporary).glob("tentacled-*/lab.json")))
            time.sleep(after_s)  # it has got so far by now, or not: that must not matter
            one.end()
            wait_until(lambda: processes_that_name(temporary) == [])
            assert list(Path(temporary).iterdir()) == []
        finally:
            one.leave()


def wait_until(is_true: Callable[[], object]) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not is_true():
        assert time.monotonic() < deadline_s
        time.sleep(0.05)


def processes_that_name(directory: str) -> list[int]:
    """Living processes with `directory` in their arguments."""
    found = []
    for arguments in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            if directory.encode() in arguments.read_bytes():
                found.append(int(arguments.parent.name))
        except OSError:
            continue
    return found


def test_what_is_done_to_the_lab_stands_among_the_daemon_s_events() -> None:
    with rig(PATIENT) as robot:
        robot.from_now_on()
        ask(robot.folder, {"do": "load", "tip_load_g": 14.2})
        robot.lab.inject("tracker.missing=0.1s")
        robot.until(lambda: len(robot.events("note", "happening")) >= 2)
        told = [(event.text, event.subject) for event in robot.events("note", "happening")]
        assert told == [("14.2 g at the tip", "lab"), ("tracker.missing=0.1s", "lab")]
