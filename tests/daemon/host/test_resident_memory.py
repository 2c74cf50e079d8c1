"""What stays in RAM: everything touched, and of the compiler only what is the process' own."""

import subprocess
import sys
from pathlib import Path

import pytest

from daemon.host import resident_memory
from daemon.host.resident_memory import give_back_compiler, mappings

SMAPS = """\
7f0000000000-7f0000100000 r-xp 00001000 08:01 42                         /v/llvmlite/libllvmlite.so
Size:               1024 kB
Rss:                 512 kB
Anonymous:             0 kB
VmFlags: rd ex mr mw me
7f0000200000-7f0000201000 rw-p 00000000 00:00 0
Rss:                   4 kB
Anonymous:             4 kB
7f0000300000-7f0000301000 r--p 00000000 08:01 43                         /a b/libc.so (deleted)
Rss:                   0 kB
"""

COMPILES = """
import numpy as np
from numba import njit
from daemon.host.resident_memory import give_back_compiler, mappings
from pathlib import Path

def resident():
    smaps = mappings(Path("/proc/self/smaps").read_text())
    return sum(one.resident_kb for one in smaps if "llvmlite" in one.name)

@njit
def twice(x):
    return 2.0 * x

assert twice(1.5) == 3.0
before = resident()
given = give_back_compiler()
after = resident()
assert twice(2.5) == 5.0

@njit
def thrice(x):
    return 3.0 * x

assert thrice(1.5) == 4.5  # the compiler still works: its pages are fetched again
print(before, given, after)
"""

LOCKS = """
import mmap
from pathlib import Path
from daemon.host.resident_memory import lock_memory

def status(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name + ":"))

reason = lock_memory()
mapped = mmap.mmap(-1, 64 << 20)
untouched = status("VmLck"), status("VmRSS")
mapped[0 : 8 << 20] = bytes(8 << 20)
print(repr(reason), status("VmRSS") - untouched[1])
"""


def test_it_reads_what_the_kernel_tells() -> None:
    code, own, other = mappings(SMAPS)
    assert (code.begin, code.end) == (0x7F0000000000, 0x7F0000100000)
    assert (code.permissions, code.resident_kb, code.changed_kb) == ("r-xp", 512, 0)
    assert (own.name, own.changed_kb) == ("", 4)
    assert other.name == "/a b/libc.so (deleted)"
    assert other.resident_kb == 0
    assert list(mappings("")) == []


def test_the_compilers_pages_are_given_back_and_it_goes_on_working() -> None:
    done = subprocess.run(
        [sys.executable, "-c", COMPILES], capture_output=True, text=True, check=True
    )
    before, given, after = map(int, done.stdout.split())
    assert given > 20_000
    assert after < before - 20_000


@pytest.mark.parametrize(
    ("permissions", "anonymous"), [("rw-p", 0), ("r--p", 4)], ids=["writable", "written to"]
)
def test_what_was_written_to_is_never_given_back(
    permissions: str, anonymous: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    smaps = tmp_path / "smaps"
    smaps.write_text(
        f"7f0000000000-7f0000100000 {permissions} 00001000 08:01 42   /v/llvmlite/libllvmlite.so\n"
        f"Rss: 512 kB\nAnonymous: {anonymous} kB\n"
    )
    monkeypatch.setattr(resident_memory, "_SMAPS", smaps)
    assert give_back_compiler() == 0


def test_without_proc_nothing_is_given_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resident_memory, "_SMAPS", tmp_path / "none")
    assert give_back_compiler() == 0


def test_locked_memory_holds_what_is_touched_and_not_what_is_mapped() -> None:
    done = subprocess.run([sys.executable, "-c", LOCKS], capture_output=True, text=True, check=True)
    reason, grown_kb = done.stdout.rsplit(maxsplit=1)
    if reason != "''":
        pytest.skip(f"this machine does not permit it: {reason}")
    assert 8 << 10 <= int(grown_kb) < 32 << 10, "of 64 MB that were mapped, 8 were touched"
