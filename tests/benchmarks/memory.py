"""Resident memory of the daemon, of its recorder and of a lab, by what it belongs to.

As the kernel counts it in `/proc/PID/smaps`: resident, of which some is shared with other
processes; and what is locked, which can never be given back. Anonymous memory is what a process
has computed and allocated; files are libraries and what is mapped from disk.
"""

import asyncio
import json
import re
import time
from collections import defaultdict
from functools import partial
from pathlib import Path
from typing import Final

from daemon.host.resident_memory import mappings
from daemon.remote.client.address import LocalAddress
from daemon.remote.client.client import RobotClient
from daemon.robot.runtime_directory import LAB_FILE
from tests import SHIPPED_ROBOTS
from tests.benchmarks.daemon import (
    PLAIN,
    STARTS_WITHIN_S,
    Options,
    emulated_robot,
    learner,
    until_running,
)
from tests.benchmarks.timing import Figures, pieces

MEASURED_S: Final = 10.0
TENDON_ARM: Final = SHIPPED_ROBOTS / "tendon_arm.yaml"
_PARTS: Final = (
    ("numba", r"numba|llvmlite"),
    ("numpy", r"numpy"),
    ("scipy", r"scipy"),
    ("zenoh", r"zenoh"),
    ("pydantic", r"pydantic"),
    ("cryptography", r"cryptography"),
    ("matplotlib", r"matplotlib|kiwisolver|contourpy|PIL|fontTools"),
    ("torch", r"torch"),
    ("other_packages", r"site-packages"),
    ("python", r"libpython|/bin/python|lib-dynload"),
    ("heap", r"^\[heap\]"),
    ("stacks", r"^\[stack"),
    ("system_libraries", r"\.so"),
    ("other_files", r"."),
)
_SETTLED_S: Final = 3.0


def measure(tiny: bool = False) -> Figures:
    """Of the soft arm, without learning and with it; and of an arm with a model of its body."""
    if tiny:
        return pieces({"soft_arm": partial(moving, 0.5, learning=False)})
    return pieces(
        {
            "soft_arm": partial(moving, MEASURED_S, learning=False),
            "soft_arm_learning": partial(moving, MEASURED_S, learning=True),
            "tendon_arm_with_risk": waiting,
        }
    )


def moving(measured_s: float, *, learning: bool) -> Figures:
    """Of each process, while the robot waits and after it has moved for a while."""
    controller = learner() if learning else PLAIN
    with emulated_robot(0.01, real_time=True) as (directory, daemon):
        figures = asyncio.run(_moving(directory, daemon.pid, measured_s, controller))
        return figures | {"lab": resident(_lab(directory))}


def waiting() -> Figures:
    """Of each process, once the daemon answers."""
    with emulated_robot(0.01, real_time=True, file=TENDON_ARM) as (directory, daemon):
        asyncio.run(_answers(directory))
        return {"daemon_waiting": resident(daemon.pid), "lab": resident(_lab(directory))}


async def _answers(directory: Path) -> None:
    address = LocalAddress.in_folder(directory)
    async with await RobotClient.connect(address, wait_s=STARTS_WITHIN_S) as robot:
        await robot.status()
        await asyncio.sleep(_SETTLED_S)


async def _moving(directory: Path, daemon: int, measured_s: float, controller: Options) -> Figures:
    address = LocalAddress.in_folder(directory)
    async with await RobotClient.connect(address, wait_s=STARTS_WITHIN_S) as robot:
        figures: Figures = {"daemon_waiting": resident(daemon)}
        began_s = time.perf_counter()
        await until_running(robot, controller)
        figures["until_it_moves_s"] = round(time.perf_counter() - began_s, 2)
        await asyncio.sleep(_SETTLED_S)
        before = _page_faults(daemon)
        await asyncio.sleep(measured_s)
        faults = [after - b for after, b in zip(_page_faults(daemon), before, strict=True)]
        figures["page_faults_per_s"] = {
            kind: round(count / measured_s, 1)
            for kind, count in zip(("minor", "from_disk"), faults, strict=True)
        }
        figures["daemon_moving"] = resident(daemon)
        for place, child in enumerate(_children(daemon)):
            figures[f"recorder_{place}" if place else "recorder"] = resident(child)
        await robot.stop()
    return figures


def _lab(directory: Path) -> int:
    """Its process."""
    return int(json.loads((directory / LAB_FILE).read_text())["pid"])


def _page_faults(pid: int) -> tuple[int, int]:
    """That it had so far: pages that were in RAM, and pages for which it waited for the disk."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[7]), int(fields[9])


def resident(pid: int) -> Figures:
    """MB, and by part; each mapping belongs to the first that its name fits."""
    total: defaultdict[str, int] = defaultdict(int)
    by_part: defaultdict[str, int] = defaultdict(int)
    for mapping in mappings(Path(f"/proc/{pid}/smaps").read_text()):
        part = "anonymous" if not mapping.name else _part(mapping.name)
        total["resident"] += mapping.resident_kb
        total["anonymous"] += mapping.changed_kb
        by_part["anonymous" if part == "heap" else part] += mapping.resident_kb
        if mapping.name and part != "heap":
            by_part["of_these_written_to"] += mapping.changed_kb
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]:
        kind, value, *_ = line.split()
        total[kind] = int(value)
    return {
        "resident_mb": _mb(total["resident"]),
        "its_share_mb": _mb(total["Pss:"]),
        "anonymous_mb": _mb(total["anonymous"]),
        "locked_mb": _mb(total["Locked:"]),
        "by_part_mb": {part: _mb(size) for part, size in sorted(by_part.items())},
    }


def _part(name: str) -> str:
    return next(part for part, pattern in _PARTS if re.search(pattern, name))


def _children(pid: int) -> list[int]:
    """Of all its threads, without those that have ended."""
    found = [
        int(child)
        for children in Path(f"/proc/{pid}/task").glob("*/children")
        for child in children.read_text().split()
    ]
    return [child for child in found if Path(f"/proc/{child}/smaps").read_text()]


def _mb(kilobytes: int) -> float:
    return round(kilobytes / 1024, 1)
