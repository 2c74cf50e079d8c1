"""`tentacled service`: files that systemd and udev understand."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from daemon.commands.host.service import service_files
from daemon.commands.terminal.command_line import main
from tests import SOFT_ARM


def test_the_unit_is_clean_in_systemds_own_eyes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    assert main(["service", "--write", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {
        "tentacled@.service",
        "90-tentacled.rules",
        "80-tentacled-can0.link",
        "80-tentacled-can0.network",
    }
    told = capsys.readouterr().out
    assert f"sudo install -m 644 {tmp_path}/tentacled@.service /etc/systemd/system/" in told
    assert len([line for line in told.splitlines() if line.startswith("sudo ")]) == 5
    unit = str(tmp_path / "tentacled@.service")
    done = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


def test_the_robots_own_interfaces_are_set_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = SOFT_ARM.read_text().replace("interface: tentacled ", "interface: socketcan ")
    text = text.replace("lab:can0.sock", "can3     ").replace("1_000_000", "500_000")
    rig = tmp_path / "rig.yaml"
    rig.write_text(text)
    assert main(["service", "--print", "--robot", str(rig)]) == 0
    told = capsys.readouterr().out
    assert "# 80-tentacled-can3.network\n[Match]\nName=can3\n\n[CAN]\nBitRate=500000\n" in told
    assert "can0" not in told
    assert "tentacled@soft_arm" in told


def test_a_program_is_named_with_its_whole_path() -> None:
    unit = service_files(["/opt/tentacled/bin/tentacled"])["tentacled@.service"]
    assert "\nExecStart=/opt/tentacled/bin/tentacled run /etc/tentacled/%i.yaml " in unit
    assert "\nRestartPreventExitStatus=64 65 78\n" in unit


def test_a_program_and_files_lie_where_paths_have_spaces(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / "our lab, 100% ours"
    program = place / "bin" / "tentacled"
    program.parent.mkdir(parents=True)
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program.with_name("python")))
    files = place / "files to install"
    assert main(["service", "--write", str(files)]) == 0
    told = capsys.readouterr().out
    named = [shlex.split(line)[4:-1] for line in told.splitlines() if "sudo install" in line]
    assert {Path(one) for line in named for one in line} == set(files.iterdir())
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd-analyze is not installed")
    unit = str(files / "tentacled@.service")
    done = subprocess.run(
        ["systemd-analyze", "verify", unit], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout + done.stderr) == (0, "")


@pytest.mark.parametrize(
    ("python", "hidden"),
    [("/home/alice/lab/.venv/bin/python", True), ("/opt/tentacled/bin/python", False)],
)
def test_a_program_that_the_service_could_not_see_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], python: str, hidden: bool
) -> None:
    monkeypatch.setattr(sys, "executable", python)
    assert main(["service", "--print"]) == 0
    told = capsys.readouterr().out
    assert "\nProtectHome=yes\n" in told
    assert (f"# {python} lies in a home folder" in told) == hidden


def test_a_wrong_robot_file_is_not_started_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("robot: wrong\n")
    assert main(["run", str(wrong)]) == 78
    assert main(["service", "--print", "--robot", str(wrong)]) == 78
    assert "required" in capsys.readouterr().err
