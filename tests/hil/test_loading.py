"""What is loaded comes from files of one folder, and the loop itself opens none."""

import os
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from daemon.recording.run_folder import RESULT_FILE
from daemon.remote.client.client_errors import RefusedError
from safety.states import OperatingState as S
from tests.hil.daemon_rig import MODEL, PATIENT, Rig, rig


def opened(path: Path, from_ns: int) -> list[str]:
    """The files that the loop's thread has opened since."""
    lines = [line.split(" ", 1) for line in path.read_text().splitlines()]
    return [name for at_ns, name in lines if int(at_ns) >= from_ns]


def test_from_arming_to_the_result_of_a_run_and_to_the_next_the_loop_opens_no_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    files = tmp_path / "tentacled" / "models"
    files.mkdir(parents=True)
    rows = [f"{k * 0.1:.1f}, {20.0 * (k % 2)}, 0, 190" for k in range(0, 4000, 20)]
    (files / "way.csv").write_text("\n".join(["t, x, y, z", *rows]))
    out = tmp_path / "opened"
    program = [sys.executable, "-m", "tests.hil.watched_files", str(out)]
    with rig(PATIENT, program=program) as one:
        assert opened(out, 0), "the watch itself works"
        from_ns = time.monotonic_ns()
        one.armed()
        way = {"kind": "waypoints", "file": "way.csv"}
        one.user.do(one.client.load(way, MODEL))
        one.user.do(one.client.start())
        one.until_state(S.RUNNING)
        time.sleep(2.0)
        one.status()
        with suppress(RefusedError):  # a stall of this machine has held it already
            one.user.do(one.client.hold())
        one.until_state(S.HOLD, S.ARMED)
        recording = one.status().recording
        assert recording is not None
        one.user.do(one.client.stop())
        one.until((Path(recording) / RESULT_FILE).exists)
        one.armed()
        one.user.do(one.client.stop())
        assert opened(out, from_ns) == []
        a_pipe_or_a_file_of_the_system_is_refused_and_the_loop_goes_on(one, files)


def a_pipe_or_a_file_of_the_system_is_refused_and_the_loop_goes_on(one: Rig, files: Path) -> None:
    one.armed()
    pipe = one.folder / "pipe"
    os.mkfifo(pipe)
    for name in (str(pipe), "/etc/passwd", "/dev/zero", "/proc/self/mem"):
        refusal = one.user.refused(one.client.load({"kind": "waypoints", "file": name}, MODEL))
        assert refusal.name == "bad_trajectory"
        assert "root" not in refusal.text.replace(str(files), "")
    assert one.state is S.ARMED
    assert one.user.do(one.client.stop()).confirmed
