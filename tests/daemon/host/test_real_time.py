"""What is asked of the operating system while drives are energised, and given back."""

import gc
import os
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from daemon.host import real_time
from daemon.host.real_time import RealTime
from tests.ordinary_user import NOBODY

_SET_SCHEDULER = os.sched_setscheduler
"""Of the system, whatever tests put in its place."""


@pytest.fixture(autouse=True)
def ordinary(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """No priority is asked for in earnest: this process has other tests to run."""

    def refused(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    yield
    gc.enable()
    gc.unfreeze()


def open_files(path: Path) -> int:
    links = Path("/proc/self/fd").iterdir()
    return sum(link.exists() and link.resolve() == path.resolve() for link in links)


def test_processors_are_kept_awake_while_drives_are_energised_and_no_longer(
    tmp_path: Path,
) -> None:
    awake = tmp_path / "cpu_dma_latency"
    awake.touch()
    real_time = RealTime(awake)
    for _ in range(2):
        real_time.enter()
        real_time.enter()
        assert awake.read_bytes()[:4] == struct.pack("=i", 0), "no time at all to wake up"
        assert open_files(awake) == 1 and "kept awake" in str(real_time)
        real_time.leave()
        assert open_files(awake) == 0 and "kept awake" not in str(real_time)


@pytest.mark.parametrize("there", [False, True])
def test_where_it_is_not_permitted_nobody_is_warned(tmp_path: Path, there: bool) -> None:
    awake = tmp_path / "cpu_dma_latency"
    if there:
        awake.mkdir()  # which nobody can write to, not even root
    real_time = RealTime(awake)
    real_time.enter()
    assert "kept awake" not in str(real_time)
    assert len(real_time.refused) == 1 and "priority" in real_time.refused[0]
    real_time.leave()


def test_the_collector_is_off_meanwhile(tmp_path: Path) -> None:
    real_time = RealTime(tmp_path / "none")
    real_time.enter()
    assert not gc.isenabled()
    real_time.leave()
    assert gc.isenabled()


def test_who_is_not_root_gives_the_priority_back(tmp_path: Path) -> None:
    """As the service's own user does. That user may not take back that new threads are ordinary."""
    awake = tmp_path / "cpu_dma_latency"
    awake.touch()
    awake.chmod(0o666)
    tmp_path.chmod(0o755)

    def hurry_twice() -> None:
        if os.getuid() == 0:
            os.setuid(NOBODY)
        os.sched_setscheduler = _SET_SCHEDULER
        # Another policy than the ordinary one that everybody may ask for.
        os.SCHED_FIFO, real_time._PRIORITY = os.SCHED_BATCH, 0  # type: ignore[misc]
        asked = RealTime(awake)
        for _ in range(2):
            asked.enter()
            assert not asked.refused and "SCHED_FIFO" in str(asked)
            asked.leave()
            assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
            assert gc.isenabled() and not str(asked)

    assert in_a_child(hurry_twice) == ""


def in_a_child(work: Callable[[], None]) -> str:
    """What went wrong in it: what it is like then, this process had better not be."""
    readable, writable = os.pipe()
    child = os.fork()
    if not child:
        try:
            work()
        except BaseException as error:
            os.write(writable, repr(error).encode())
        os._exit(0)
    os.close(writable)
    with os.fdopen(readable, "rb") as said:
        text = said.read().decode()
    os.waitpid(child, 0)
    return text
