"""`tentacled doctor` says of this machine what is so."""

import os
from pathlib import Path

import pytest

from daemon.commands.host.doctor import Finding, examine


def finding(about: str) -> Finding:
    (found,) = [one for one in examine() if about in one.text]
    return found


@pytest.mark.parametrize("most", [0, 20, 49, 50, 99])
def test_real_time_is_allowed_where_the_loop_gets_its_priority(
    monkeypatch: pytest.MonkeyPatch, most: int
) -> None:
    """Whoever asks, root in a container too; some priority is not enough."""

    def up_to(_process: int, _policy: int, asked: os.sched_param) -> None:
        if asked.sched_priority > most:
            raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", up_to)
    found = finding("real-time scheduling")
    assert found.good == (most >= 50)
    assert ("LimitRTPRIO" in found.text) == (not found.good)


def test_only_a_thread_that_ends_is_in_a_hurry() -> None:
    finding("real-time scheduling")
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


@pytest.mark.parametrize("home", [True, False])
def test_a_read_only_installation_keeps_kernels_where_numba_does(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, home: bool
) -> None:
    def writable(path: Path, _mode: int) -> bool:
        return home and Path(path).is_relative_to(tmp_path)

    monkeypatch.setattr(os, "access", writable)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    assert finding("compiled physics").good == home
