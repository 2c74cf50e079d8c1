"""`--log`: what a robot's events become, and that a daemon of its own process tells them."""

import io
import json
import re
import signal
import subprocess
from pathlib import Path

import pytest

from daemon.commands.terminal.command_line import parsed
from daemon.commands.terminal.event_log import event_line, warning_line
from daemon.host.logs import logging_to_stderr
from daemon.messages import Event
from tests.hil.processes import command

WITHIN_S = 60.0


def event(severity: str, *, present: bool = True, detail: str = "") -> Event:
    return Event(
        sequence=7,
        t_ns=5,
        kind="cause",
        name="tip_missing",
        subject="tracker",
        present=present,
        text="no tip",
        severity=severity,
        detail=detail,
    )


@pytest.mark.parametrize(
    ("severity", "priority"),
    [
        ("", 6),
        ("warning", 4),
        ("not_ready", 6),
        ("hold", 4),
        ("fault", 3),
        ("estop", 3),
        ("new", 4),
    ],
)
def test_what_stops_the_robot_is_an_error_and_what_holds_it_a_warning(
    severity: str, priority: int
) -> None:
    out = io.StringIO()
    with logging_to_stderr("daemon", out, "journal") as log:
        event_line(log)(event(severity, detail="port 1"))
        event_line(log)(event(severity, present=False))
    came, went = out.getvalue().splitlines()
    assert came == f"<{priority}>cause: tracker tip_missing: no tip: port 1"
    assert went == "<6>cause: tracker tip_missing is over: no tip"


def test_programs_get_the_whole_event_and_whose_it_is() -> None:
    out = io.StringIO()
    with logging_to_stderr("dashboard", out, "json") as log:
        event_line(log, "soft_arm")(event("hold"))
    line = json.loads(out.getvalue())
    assert (line["robot"], line["name"], line["subject"]) == ("soft_arm", "tip_missing", "tracker")
    assert (line["present"], line["severity"], line["sequence"], line["t_ns"]) == (
        True,
        "hold",
        7,
        5,
    )


@pytest.mark.parametrize(
    "words",
    ["run arm.yaml", "dashboard", "reproduce ho2018 --out x", "compare --out x"],
)
def test_commands_that_go_on_for_long_take_it(words: str) -> None:
    assert parsed([*words.split(), "--log", "journal"]).log == "journal"
    assert parsed(words.split()).log is None


def test_what_is_no_event_is_a_line_of_the_log_too_where_one_is_wanted(
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = io.StringIO()
    with logging_to_stderr("daemon", out, "json") as log:
        warning_line(log, parsed(["run", "arm.yaml", "--log", "json"]))("mind the noise")
        warning_line(log, parsed(["run", "arm.yaml"]))("as it is")
    line = json.loads(out.getvalue())
    assert (line["level"], line["source"], line["text"]) == ("warning", "warning", "mind the noise")
    assert capsys.readouterr().err == "as it is\n"


@pytest.mark.long
@pytest.mark.hil
@pytest.mark.parametrize("style", ["json", "journal", "text"])
def test_a_daemon_without_its_devices_says_so_line_by_line(style: str, tmp_path: Path) -> None:
    where = ["--runtime-dir", str(tmp_path / "r"), "--runs", str(tmp_path / "runs")]
    words = command("run", "builtin:soft_arm", *where, "--no-real-time", "--log", style)
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        lines = []
        for line in process.stderr:
            lines.append(line)
            if "tracker" in line and "cause" in line:
                break
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=WITHIN_S)
    assert process.returncode == 0
    if style == "json":
        *_, told = [json.loads(line) for line in lines]
        assert (told["schema"], told["source"]) == ("tentacled.log/1", "cause")
    else:
        begin = r"<\d>cause: " if style == "journal" else r"\d{4}-.* daemon [A-Z]+ cause: "
        assert re.match(begin, lines[-1])
