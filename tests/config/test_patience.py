"""Who waits how long for whom: on a rig as the file says, in emulation with patience."""

from pathlib import Path

import pytest

from config.documents.problems import ConfigError
from config.loader import load_robot
from config.patience import patient
from config.robot import Robot
from tests import SHIPPED_ROBOTS, SOFT_ARM

STALL_S = 0.3
"""What a laptop or a shared virtual machine takes away at a time."""


def changed(tmp_path: Path, *swaps: tuple[str, str]) -> Robot:
    """The shipped soft arm with other lines. Raises ConfigError."""
    text = SOFT_ARM.read_text()
    for old, new in swaps:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "robot.yaml"
    path.write_text(text)
    return load_robot(path).robot


def sync_lost_after_s(robot: Robot) -> float:
    assert robot.emulation is not None
    periods = robot.emulation.drives.sync_lost_after_periods
    return min(periods * bus.cycle_period_s for bus in robot.buses.values())


@pytest.mark.parametrize("path", sorted(SHIPPED_ROBOTS.glob("*.yaml")), ids=lambda p: str(p.stem))
def test_in_emulation_nobody_loses_patience_while_a_computer_is_busy(path: Path) -> None:
    robot = patient(load_robot(path).robot)
    fault_s = robot.supervision.loop_fault_after_s
    for bus in robot.buses.values():
        assert STALL_S < fault_s < bus.master_heartbeat_timeout_s
    assert fault_s < sync_lost_after_s(robot)
    for axis in robot.axes:
        assert axis.drive.heartbeat_timeout_s > STALL_S
        assert axis.drive.state_timeout_s > STALL_S
        assert axis.drive.setpoint_timeout_s > fault_s
    assert patient(robot) == robot


def test_it_holds_as_soon_as_on_a_rig() -> None:
    """What is only late is held and resumed; nothing of that becomes slower."""
    before = load_robot(SOFT_ARM).robot.supervision
    after = patient(load_robot(SOFT_ARM).robot).supervision
    assert after == before.model_copy(update={"loop_fault_after_s": after.loop_fault_after_s})


def test_a_file_that_is_more_patient_still_stays_so(tmp_path: Path) -> None:
    robot = patient(
        changed(
            tmp_path,
            ("master_heartbeat_timeout_s: 0.2", "master_heartbeat_timeout_s: 3.0"),
            ("supervision:", "supervision:\n  loop_fault_after_s: 2.0"),
        )
    )
    assert robot.supervision.loop_fault_after_s == 2.0
    assert robot.buses["can0"].master_heartbeat_timeout_s == 3.0
    assert sync_lost_after_s(robot) == pytest.approx(2.5)


def test_on_a_rig_the_times_of_the_file_hold(tmp_path: Path) -> None:
    robot = changed(tmp_path, ("channel: lab:can0.sock", "channel: can0"))
    assert patient(robot) == robot


def test_nobody_is_so_patient_that_drives_cannot_be_told(tmp_path: Path) -> None:
    """They are told milliseconds in 16 bits: more would have them watch another node, or none."""
    robot = patient(
        changed(
            tmp_path,
            ("emulation:", "emulation:\n  patience_s: 60.0"),
            ("node: 6}", "node: 6, mode: pv, setpoint_timeout_s: 0.2}"),
        )
    )
    assert robot.buses["can0"].master_heartbeat_timeout_s == 65.0
    assert robot.axes[5].drive.setpoint_timeout_s == 65.0


def test_beside_a_real_bus_the_emulated_one_alone_is_patient(tmp_path: Path) -> None:
    real = "  can1: {interface: socketcan, channel: can1, cycle_period_s: 0.01}\n\naxes:"
    robot = changed(
        tmp_path,
        ("\naxes:", real),
        ("drive: {<<: *drive, node: 6}", "drive: {<<: *drive, bus: can1, node: 6}"),
    )
    after = patient(robot)
    assert after.supervision == robot.supervision
    assert after.buses["can1"] == robot.buses["can1"]
    assert after.axes[5] == robot.axes[5]
    assert after.buses["can0"].master_heartbeat_timeout_s > STALL_S
    assert after.axes[0].drive.state_timeout_s > STALL_S


def test_without_patience_the_times_of_the_file_hold_in_emulation_too(tmp_path: Path) -> None:
    robot = changed(
        tmp_path,
        ("emulation:", "emulation:\n  patience_s: 0.0"),
        ("supervision:", "supervision:\n  loop_fault_after_s: 0.09"),
    )
    assert patient(robot) == robot
    assert sync_lost_after_s(robot) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("swaps", "expected"),
    [
        (
            (("supervision:", "supervision:\n  loop_fault_after_s: 0.2"),),
            "drives must wait longer for the master than supervision.loop_fault_after_s (0.2 s)",
        ),
        (
            (("emulation:", "emulation:\n  patience_s: 0.0"),),
            "the emulated drives stop 0.1 s after the last SYNC",
        ),
    ],
    ids=["heartbeat", "sync"],
)
def test_drives_that_would_stop_before_the_daemon_says_why_are_refused(
    tmp_path: Path, swaps: tuple[tuple[str, str], ...], expected: str
) -> None:
    with pytest.raises(ConfigError) as raised:
        changed(tmp_path, *swaps)
    (problem,) = raised.value.problems
    assert problem.key_path == "buses.can0.master_heartbeat_timeout_s"
    assert expected in problem.message


def test_a_drive_that_is_told_velocities_waits_longer_than_the_daemon_needs_to_say_why(
    tmp_path: Path,
) -> None:
    told_velocities = ("node: 6}", "node: 6, mode: pv, setpoint_timeout_s: 0.1}")
    with pytest.raises(ConfigError, match=r"longer than supervision.loop_fault_after_s \(0.15 s\)"):
        changed(tmp_path, told_velocities, ("channel: lab:can0.sock", "channel: can0"))
    robot = changed(tmp_path, told_velocities)
    assert patient(robot).axes[5].drive.setpoint_timeout_s > 0.4


def test_on_a_rig_nothing_is_said_of_emulated_drives(tmp_path: Path) -> None:
    changed(
        tmp_path,
        ("emulation:", "emulation:\n  patience_s: 0.0"),
        ("channel: lab:can0.sock", "channel: can0"),
    )
