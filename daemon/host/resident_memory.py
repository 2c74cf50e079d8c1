"""What of this process stays in RAM: what it has touched, and not what only the compiler needed.

A control step must not wait for the disk, so that memory is locked. What was mapped and never
touched need not be there: most of it is a compiler that has done its work, and its libraries.
"""

import ctypes
import errno
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_MCL_ONFAULT: Final = 4
"""Pages are locked as they come, and not fetched for it (Linux 4.4)."""
_MADV_DONTNEED: Final = 4
_COMPILER: Final = re.compile(r"/llvmlite/|/libLLVM")
_MAPPING: Final = re.compile(r"^([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ \d+ *(.*)$")
_SMAPS: Final = Path("/proc/self/smaps")


class Mapping(NamedTuple):
    """A range of addresses with one name, as the kernel tells of it."""

    begin: int
    end: int
    permissions: str
    name: str
    resident_kb: int
    changed_kb: int
    """Of these, pages that differ from the file."""


def lock_memory() -> str:
    """Keep in RAM what is there and what will come. Returns why not; empty if it is done."""
    libc = ctypes.CDLL(None, use_errno=True)
    flags = _MCL_CURRENT | _MCL_FUTURE
    if libc.mlockall(flags | _MCL_ONFAULT) == 0:
        return ""
    if ctypes.get_errno() == errno.EINVAL and libc.mlockall(flags) == 0:
        return ""  # a kernel that can only fetch everything
    return os.strerror(ctypes.get_errno())


def give_back_compiler() -> int:
    """Let go of the pages of the compiler's code, once everything is compiled. Returns their kB.

    They are as the file has them, and are fetched again where something is compiled after all.
    Does nothing where memory is locked.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    given_kb = 0
    for mapping in mappings(_SMAPS.read_text() if _SMAPS.exists() else ""):
        # Never what was written to: it would be lost, and the file's own bytes be there again.
        written = mapping.changed_kb > 0 or "w" in mapping.permissions
        if written or not mapping.resident_kb or not _COMPILER.search(mapping.name):
            continue
        begin, length = mapping.begin, mapping.end - mapping.begin
        done = libc.madvise(ctypes.c_void_p(begin), ctypes.c_size_t(length), _MADV_DONTNEED)
        given_kb += mapping.resident_kb if done == 0 else 0
    return given_kb


def mappings(smaps: str) -> Iterator[Mapping]:
    """What `/proc/PID/smaps` says."""
    head: re.Match[str] | None = None
    sizes: dict[str, int] = {}
    for line in (*smaps.splitlines(), ""):
        found = _MAPPING.match(line)
        if found is None and line:
            name, _, value = line.partition(":")
            if value.endswith(" kB"):
                sizes[name] = int(value.removesuffix(" kB"))
            continue
        if head is not None:
            begin, end, permissions, name = head.groups()
            resident, changed = sizes.get("Rss", 0), sizes.get("Anonymous", 0)
            yield Mapping(int(begin, 16), int(end, 16), permissions, name, resident, changed)
        head, sizes = found, {}
