"""What an operator orders: what is sent, what is refused, and the exit codes."""

import asyncio
import json
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from config.loader import RobotFile
from config.tasks.experiment import Pretraining
from daemon.commands.outcome.exit_codes import EXIT_CONFIGURATION as CONFIGURATION
from daemon.commands.outcome.exit_codes import EXIT_DATA as DATA
from daemon.commands.outcome.exit_codes import EXIT_FAILED as FAILED
from daemon.commands.outcome.exit_codes import EXIT_NO_ANSWER as TIMED_OUT
from daemon.commands.outcome.exit_codes import EXIT_OK as OK
from daemon.commands.outcome.exit_codes import EXIT_REFUSED as REFUSED
from daemon.commands.outcome.exit_codes import EXIT_UNAVAILABLE as NO_DAEMON
from daemon.commands.outcome.exit_codes import EXIT_USAGE as USAGE
from daemon.commands.terminal.command_line import main
from daemon.messages import (
    Answer,
    Command,
    Plan,
    Refusal,
    Stop,
)
from tests.daemon.remote.commands.typed import Daemon, hold_lease, tentacled
from tests.daemon.remote.rig import ROBOT, FakeRobot


def test_commands_find_the_one_daemon_that_runs_and_use_the_lease_that_is_held(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trajectory = tmp_path / "circle.yaml"
    trajectory.write_text("trajectory: {kind: circle, radius_mm: 3.0}\ncontroller: {kind: x}\n")
    with Daemon(root / ROBOT) as robot:
        hold_lease(root / ROBOT, robot)
        assert tentacled("arm") == OK
        assert capsys.readouterr().out == "ARMED\n"
        assert tentacled("load", trajectory, "--cycles", "2") == OK
        for name in ("start", "hold", "resume", "disarm", "clear"):
            assert tentacled(name, ROBOT) == OK
        assert robot.verbs() == ["arm", "load", "start", "hold", "resume", "disarm", "clear"]
        load: Any = robot.carried_out[1][1]
        assert load.trajectory == {"kind": "circle", "radius_mm": 3.0}
        assert (load.controller, load.cycles) == ({"kind": "x"}, 2)


def test_an_experiment_s_controller_is_loaded_with_its_model(
    root: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def made(
        file: RobotFile, how: Pretraining, seed: int, tell: Callable[[str], None], **more: object
    ) -> Path:
        asked.append((file.robot.robot, how.waypoints, seed))
        return tmp_path / "model.npz"

    monkeypatch.setattr("daemon.workbench.pretraining.model_cache.pretrained", made)
    shipped = Path(str(files("config") / "experiments" / "ho2018_table1_online.yaml"))
    with Daemon(root / ROBOT) as robot:
        hold_lease(root / ROBOT, robot)
        assert tentacled("load", shipped) == OK
    load: Any = robot.carried_out[0][1]
    assert load.controller["kind"] == "reward_weighted"
    assert load.controller["model"] == str(tmp_path / "model.npz")
    assert asked == [("soft_arm", 80, 1)]
    assert load.robot == "soft_arm"


def test_waypoints_are_read_here_and_sent_as_data(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    way = tmp_path / "way.csv"
    way.write_text("t, x, y, z\n1, 0, 0, 185\n3, 4, 0, 185\n")
    file = tmp_path / "load.yaml"
    file.write_text("trajectory:\n  kind: waypoints\n  file: way.csv\n  cycles: 1\n")
    with Daemon(root / ROBOT) as robot:
        hold_lease(root / ROBOT, robot)
        assert tentacled("load", file) == OK
        load: Any = robot.carried_out[0][1]
        assert load.trajectory == {
            "kind": "waypoints",
            "cycles": 1,
            "points": [[0.0, 0.0, 0.0, 185.0], [2.0, 4.0, 0.0, 185.0]],
        }
        assert load.robot == ""
        rows = [f"{number}, {number / 7}, 0, 185" for number in range(5000)]
        way.write_text("\n".join(["t, x, y, z", *rows]))
        assert tentacled("load", file) == DATA
        assert "more than a message holds" in capsys.readouterr().err
        way.write_text("nonsense")
        assert tentacled("load", file) == DATA
        assert f"{way}:1: the header must be" in capsys.readouterr().err
        file.write_text("robot: nowhere.yaml\ntrajectory:\n  kind: hold\n")
        assert tentacled("load", file) == CONFIGURATION
        assert "is no robot file" in capsys.readouterr().err
        assert len(robot.carried_out) == 1


def test_a_number_that_cannot_be_sent_is_the_file_s_fault(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "load.yaml"
    file.write_text(f"trajectory: {{kind: circle, radius_mm: 1{30 * '0'}}}\n")
    with Daemon(root / ROBOT) as robot:
        hold_lease(root / ROBOT, robot)
        assert tentacled("load", file) == CONFIGURATION
        assert f"{file}: a number" in capsys.readouterr().err
        assert robot.carried_out == []


class PlanningRobot(FakeRobot):
    """Has planned a path, which may be too long for an answer."""

    path: dict[str, Any] | None = None

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        told = await super().handle(user, command)
        if isinstance(command, Plan) and isinstance(told, Answer):
            return replace(told, file="plan-1.json", path=self.path)
        return told


def test_a_planned_path_is_kept_where_it_is_wanted_or_that_it_is_not_is_told(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "path.json"
    with Daemon(root / ROBOT, PlanningRobot()) as robot:
        assert isinstance(robot, PlanningRobot)
        hold_lease(root / ROBOT, robot)
        assert tentacled("replan", "--to", "1,2,3", "--out", out) == FAILED
        assert "plan-1.json" in capsys.readouterr().err and not out.exists()
        assert tentacled("replan", "--to", "1,2,3") == OK
        robot.path = {"t_s": [0.0, 1.0]}
        assert tentacled("replan", "--to", "1,2,3", "--out", out) == OK
        assert json.loads(out.read_text()) == robot.path


@pytest.mark.parametrize("wrong", ["bodies:", "bodies: {mesh: wall.stl}", "regions:", "regions: 3"])
def test_surroundings_of_a_file_are_sent_whole_or_not_at_all(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], wrong: str
) -> None:
    file = tmp_path / "around.yaml"
    with Daemon(root / ROBOT) as robot:
        hold_lease(root / ROBOT, robot)
        file.write_text(f"mesh: builtin:box\n{wrong}\n")
        assert tentacled("surroundings", "--file", file, "--ball", "1,2,3,4") == CONFIGURATION
        key = wrong.partition(":")[0]
        assert f"{file}:2:" in (said := capsys.readouterr().err) and key in said
        assert robot.carried_out == []
        file.write_text("mesh: builtin:box\nbodies: [3]\n")
        assert tentacled("surroundings", "--file", file) == OK
        sent: Any = robot.carried_out[0][1]
        assert sent.surface["bodies"] == [3], "for the daemon to refuse"


@pytest.mark.parametrize("name", ["arm", "disarm", "start", "hold", "resume", "clear"])
def test_without_the_lease_commands_are_refused_and_say_how_to_get_it(
    root: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    with Daemon(root / ROBOT) as robot:
        assert tentacled(name) == REFUSED
        assert "tentacled lease" in capsys.readouterr().err
        assert tentacled(name, "--json") == REFUSED
        assert json.loads(capsys.readouterr().out)["error"]["refusal"]["name"] == "no_lease"
        assert robot.carried_out == []


def test_stop_needs_no_lease_and_stops_all_robots_if_none_is_named(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Daemon(root / ROBOT) as one, Daemon(root / "second") as other:
        assert tentacled("stop") == OK
        assert capsys.readouterr().out == "STANDBY\nSTANDBY\n"
        assert (one.verbs(), other.verbs()) == (["stop"], ["stop"])
        assert tentacled("arm") == USAGE
        assert "several daemons are running" in capsys.readouterr().err


class Unsure(FakeRobot):
    """Cannot tell whether the drives have stopped."""

    async def handle(self, user: str, command: Command) -> Answer | Refusal:
        if isinstance(command, Stop):
            return self.answer(command, confirmed=False)
        return await super().handle(user, command)


def test_a_stop_that_the_drives_have_not_confirmed_is_a_failure_and_says_so(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Daemon(root / ROBOT, Unsure()):
        assert tentacled("stop", "--json") == FAILED
        assert json.loads(capsys.readouterr().out)["result"]["confirmed"] is False
        assert tentacled("stop") == FAILED
        assert "NOT CONFIRMED" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [
        "arm --timeout",
        "stop --timeout",
        "home --timeout",
        "status --watch --every",
        "replan --to 1,2,3 --timeout",
        "surroundings --reset --timeout",
        "load builtin:rectangle --cycles",
    ],
)
@pytest.mark.parametrize("number", ["nan", "inf", "-1", "1e300", "1" + 30 * "0", "x"])
def test_a_number_that_nobody_can_mean_is_wrong_usage(
    root: Path, capsys: pytest.CaptureFixture[str], words: str, number: str
) -> None:
    del root
    with pytest.raises(SystemExit) as ended:
        main([*words.split(), number])
    assert ended.value.code == USAGE
    assert words.split()[-1] in capsys.readouterr().err


@pytest.mark.parametrize("name", ["arm", "stop", "status", "lease"])
def test_without_a_daemon_there_is_an_exit_code_for_that(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    for words in ([], [ROBOT], ["--runtime-dir", str(tmp_path)]):
        assert tentacled(name, *words) == NO_DAEMON
        assert "no daemon is running" in capsys.readouterr().err


def test_the_name_of_a_robot_that_runs_is_suggested_for_one_that_does_not(
    root: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Daemon(root / ROBOT):
        for name in (f"{ROBOT}s", f"config/robots/{ROBOT}.yaml"):
            assert tentacled("status", name) == NO_DAEMON
            assert f"(did you mean '{ROBOT}'?)" in capsys.readouterr().err


def test_an_answer_that_does_not_come_has_its_own_exit_code(root: Path, tmp_path: Path) -> None:
    robot = FakeRobot()
    robot.slow_until = asyncio.Event()
    trajectory = tmp_path / "circle.yaml"
    trajectory.write_text("trajectory: {kind: circle}\n")
    with Daemon(root / ROBOT, robot):
        hold_lease(root / ROBOT, robot)
        assert tentacled("load", trajectory, "--timeout", "0.3") == TIMED_OUT


@pytest.mark.parametrize(
    "words",
    [
        ["--connect", "127.0.0.1:1"],
        ["robot", "--user", "alice"],
        ["robot", "--certificates", "."],
        ["robot", "--connect", "h:1", "--user", "a", "--certificates", ".", "--runtime-dir", "."],
    ],
)
def test_half_an_address_is_a_mistake(words: list[str]) -> None:
    assert tentacled("status", *words) == USAGE


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [", "not YAML"),
        ("controller: {kind: x}", "there is no trajectory"),
        ("[]", "there is no trajectory"),
        ("trajectory: {kind: circle}\ncontroller: 3", "a controller is written"),
        ("trajectory: {}\ncontroller: {}\npretraining: {}", "experiment: this key is required"),
    ],
)
def test_a_file_that_cannot_be_loaded_is_told_before_anything_is_sent(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    file = tmp_path / "file.yaml"
    file.write_text(text)
    assert tentacled("load", file) == CONFIGURATION
    assert message in capsys.readouterr().err
