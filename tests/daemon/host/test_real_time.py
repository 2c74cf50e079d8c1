"""What is asked of the operating system while drives are energised, and given back."""

import gc
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from daemon.host.real_time import RealTime


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
