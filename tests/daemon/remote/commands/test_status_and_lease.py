"""What an operator is shown, and what goes on until it is ended: status, lease, set-points."""

import json
import signal
import threading
from pathlib import Path

import pytest
from msgspec.structs import replace

from daemon.commands.outcome.exit_codes import EXIT_CANNOT_CREATE as CANNOT_CREATE
from daemon.commands.outcome.exit_codes import EXIT_FAILED as FAILED
from daemon.commands.outcome.exit_codes import EXIT_OK as OK
from daemon.commands.outcome.exit_codes import EXIT_REFUSED as REFUSED
from daemon.commands.outcome.exit_codes import EXIT_USAGE as USAGE
from daemon.messages import (
    AxisStatus,
    Reason,
    ReferenceStatus,
    Status,
)
from daemon.remote.client.token_file import token_file
from daemon.service.lease import Lease
from tests.daemon.remote.commands.typed import Daemon, hold_lease, started, tentacled
from tests.daemon.remote.rig import ROBOT, WITHIN_S, FakeRobot


class Busy(FakeRobot):
    """In the middle of everything."""

    def status(self) -> Status:
        reason = Reason(
            name="tracker_lost",
            severity="hold",
            subject="tracker",
            text="the tip has not been seen",
            remedy="look at the cable",
            detail="0.3 s",
            since_s=0.3,
        )
        axis = AxisStatus(
            name="proximal_1",
            unit="mm",
            actual=12.3456,
            target=12.4,
            drive_state="operation enabled",
            node_state="operational",
            force=1.5,
            force_unit="N",
            volume_ml=6.05,
        )
        following = ReferenceStatus(
            trajectory="circle",
            controller="broyden",
            elapsed_s=3.0,
            duration_s=60.0,
            cycle=1,
            cycles=3,
        )
        return replace(
            super().status(),
            state="hold",
            reasons=[reason, replace(reason, subject="can0/3", latched=True)],
            axes=[axis, replace(axis, name="distal_1", actual=None, volume_ml=None)],
            reference=following,
            reference_mm=[1.0, 2.0, 103.0],
            error_mm=0.5,
            recording="/runs/7",
        )


def test_the_status_for_people_shows_state_reasons_and_remedies(
    root: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    with Daemon(root / ROBOT, Busy()):
        assert tentacled("status") == OK
    shown = capsys.readouterr().out
    for text in (
        "HOLD",
        ROBOT,
        "SIMULATED",
        "tracker: the tip has not been seen (0.3 s)",
        "look at the cable",
        "waits for `tentacled clear`",
        "103.50",
        "0.50 mm",
        "cycle 2 of 3",
        "tracking, 40.0 frames/s",
        "12.346  12.400  mm",
        "6.050 mL",
        "/runs/7",
        "free",
    ):
        assert text in shown, text


def test_the_status_for_programs_is_the_message_as_it_is(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Daemon(root / ROBOT) as robot:
        assert tentacled("status", "--json") == OK
        status = json.loads(capsys.readouterr().out)["result"]
        assert (status["type"], status["robot"], status["simulated"]) == ("status/1", ROBOT, True)
        assert set(status) == {"type", *robot.status().__struct_fields__}


def test_status_can_be_watched_by_a_program_until_it_is_told_to_end(root: Path) -> None:
    with Daemon(root / ROBOT), started("status", "--watch", "--json", "--every", "0.05") as watch:
        assert watch.stdout is not None
        lines = [json.loads(watch.stdout.readline())["result"] for _ in range(3)]
        assert {line["type"] for line in lines} == {"status/1"}
        watch.send_signal(signal.SIGINT)
        assert watch.wait(WITHIN_S) == OK


def test_a_watched_status_is_there_at_once_where_no_terminal_shows_it(root: Path) -> None:
    with Daemon(root / ROBOT), started("status", "--watch", "--every", "0.05") as watch:
        assert watch.stdout is not None
        pages = 0
        while pages < 2:
            pages += ROBOT in watch.stdout.readline()
        watch.stdout.close()
        assert watch.wait(WITHIN_S) == OK, "who read it has left"


def test_the_lease_is_held_in_one_terminal_and_used_in_others_and_then_given_back(
    root: Path, tmp_path: Path
) -> None:
    with Daemon(root / ROBOT, FakeRobot(lease_s=8.0)) as robot:
        with started("lease") as lease:
            assert lease.stdout is not None
            assert "the lease is yours" in lease.stdout.readline()
            kept = token_file(root / ROBOT, "local")
            assert kept.stat().st_mode & 0o777 == 0o600
            assert tentacled("arm") == OK
            assert tentacled("lease") == REFUSED
            lease.send_signal(signal.SIGINT)
            assert lease.wait(WITHIN_S) == OK
        assert not kept.exists()
        assert robot.verbs() == ["arm", "release"]
        assert tentacled("arm") == REFUSED


def test_a_lease_that_was_lost_is_taken_again_and_said_to_be(root: Path) -> None:
    with (
        Daemon(root / ROBOT, FakeRobot(lease_s=1.0)) as robot,
        started("lease") as lease,
    ):
        assert lease.stdout is not None and lease.stderr is not None
        assert "the lease is yours" in lease.stdout.readline()
        lease.send_signal(signal.SIGSTOP)
        ended = threading.Event()
        while robot.lease.holder(robot.clock.now_ns()) is not None:
            ended.wait(0.05)
        lease.send_signal(signal.SIGCONT)
        assert "the lease is lost" in lease.stderr.readline()
        assert "the lease is yours again" in lease.stdout.readline()


def test_who_has_lost_the_lease_leaves_the_token_of_who_has_it_now(root: Path) -> None:
    with (
        Daemon(root / ROBOT, FakeRobot(lease_s=1.0)) as robot,
        started("lease") as lease,
    ):
        assert lease.stdout is not None and lease.stderr is not None
        assert "the lease is yours" in lease.stdout.readline()
        lease.send_signal(signal.SIGSTOP)
        ended = threading.Event()
        while robot.lease.holder(robot.clock.now_ns()) is not None:
            ended.wait(0.05)
        robot.lease = Lease(60.0)
        hold_lease(root / ROBOT, robot)
        lease.send_signal(signal.SIGCONT)
        assert "the lease is lost" in lease.stderr.readline()
        lease.send_signal(signal.SIGINT)
        assert lease.wait(WITHIN_S) == FAILED
        assert tentacled("arm") == OK, "with the lease that somebody else has by now"


def test_positions_on_standard_input_become_set_points(root: Path) -> None:
    with Daemon(root / ROBOT) as robot, started("teleoperate") as writing:
        assert writing.stdin is not None
        waiting = threading.Event()
        for number in range(1000):
            writing.stdin.write(f"{number} 2 100\n" if number % 2 else f"{number} 2 100 0 0 1\n")
            writing.stdin.flush()
            waiting.wait(0.02)
            if len(robot.setpoints) >= 4:
                break
        writing.stdin.close()
        assert writing.wait(WITHIN_S) == OK
        assert robot.verbs()[0] == "teleoperate"
        assert robot.verbs()[-1] == "hold"
        positions = [setpoint.position_mm[0] for _, setpoint in robot.setpoints]
        assert len(positions) >= 4
        assert positions == sorted(positions)
        assert {setpoint.velocity_mm_s is None for _, setpoint in robot.setpoints} == {True, False}


@pytest.mark.parametrize("line", ["1 2", "1 2 x", "1 2 nan", "1 2 3 4"])
def test_a_line_that_is_no_position_ends_teleoperation_and_holds(root: Path, line: str) -> None:
    with Daemon(root / ROBOT) as robot, started("teleoperate") as writing:
        assert writing.stdin is not None
        writing.stdin.write(line + "\n")
        writing.stdin.flush()
        assert writing.wait(WITHIN_S) == FAILED
        assert writing.stderr is not None
        assert "`x y z` or `x y z vx vy vz` is wanted" in writing.stderr.read()
        assert robot.verbs() == ["teleoperate", "hold"]
        assert robot.setpoints == []


def test_certificates_are_made_and_what_goes_into_the_robot_file_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "certificates"
    words = ["--host", "10.0.0.1", "--operator", "alice", "--viewer", "bob"]
    assert tentacled("certificates", folder, *words) == OK
    shown = capsys.readouterr().out
    assert "endpoint: 10.0.0.1:7448" in shown
    assert "    alice: operator\n    bob: viewer\n" in shown
    assert (folder / "alice.key").exists()
    assert tentacled("certificates", folder, *words) == CANNOT_CREATE
    assert "would be overwritten" in capsys.readouterr().err
    assert tentacled("certificates", folder, "--operator", "Alice") == USAGE
    assert tentacled("certificates", folder) == USAGE
