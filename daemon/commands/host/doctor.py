"""`tentacled doctor`: what on this machine would stop tentacled from working, or hold it back."""

import argparse
import grp
import importlib
import os
import sys
from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Final, NamedTuple

from daemon.commands.outcome.exit_codes import EXIT_FAILED, EXIT_OK
from daemon.commands.outcome.result import Result
from daemon.host.real_time import CPU_LATENCY, why_no_priority
from daemon.host.writable_places import kernels_are_kept
from drivers.can.preflight import can_interfaces

_OURS: Final = ("config", "daemon", "drivers", "safety", "sim_backends")
_ROOT: Final = Path(__file__).parents[3]
_SERIAL_PORTS: Final = Path("/dev/serial/by-id")
_SERIAL_GROUP: Final = "dialout"


class Finding(NamedTuple):
    """One thing that was looked at."""

    good: bool
    serious: bool
    """Whether nothing works without it."""
    text: str


def add_arguments(parser: argparse.ArgumentParser) -> None:
    del parser


def run(arguments: argparse.Namespace) -> Result:
    del arguments
    findings = list(examine())
    bad = any(finding.serious and not finding.good for finding in findings)
    return Result(
        {"findings": [finding._asdict() for finding in findings]},
        "\n".join(map(_line, findings)),
        EXIT_FAILED if bad else EXIT_OK,
    )


def _line(finding: Finding) -> str:
    mark = "ok  " if finding.good else "FAIL" if finding.serious else "note"
    return f"{mark}  {finding.text}"


def examine() -> Iterator[Finding]:
    """Everything, the most serious first."""
    yield _python()
    yield from (_not_shadowed(name) for name in _OURS)
    yield _plugin()
    yield _compiled_code()
    yield _serial_ports()
    yield _interfaces()
    yield _real_time()
    yield _awake()


def _python() -> Finding:
    version = sys.version.split()[0]
    good = sys.version_info >= (3, 11)
    return Finding(good, True, f"Python {version}" + ("" if good else ": 3.11 or newer is needed"))


def _not_shadowed(name: str) -> Finding:
    """Our packages have plain names; another package of the same name may come first."""
    file = Path(importlib.import_module(name).__file__ or "")
    if file.parent.parent == _ROOT:
        return Finding(True, True, f"package {name} is ours")
    return Finding(
        False,
        True,
        f"package {name} comes from {file.parent}: install tentacled in a virtual environment of "
        "its own (make install), and start it from there",
    )


def _plugin() -> Finding:
    there = "tentacled" in {entry.name for entry in entry_points(group="can.interface")}
    text = "python-can knows the emulated bus"
    return Finding(there, True, text if there else f"not so: {text}: make install")


def _compiled_code() -> Finding:
    if kernels_are_kept():
        return Finding(True, False, "compiled physics is kept between starts")
    return Finding(
        False,
        False,
        "compiled physics cannot be written anywhere: every start compiles for a minute; set "
        "NUMBA_CACHE_DIR",
    )


def _serial_ports() -> Finding:
    ports = sorted(path.name for path in _SERIAL_PORTS.glob("*"))
    allowed = os.getuid() == 0 or _SERIAL_GROUP in _groups()
    if not allowed:
        return Finding(
            False,
            False,
            f"you are not in the group {_SERIAL_GROUP}: sudo usermod -aG {_SERIAL_GROUP} $USER, "
            "then log out and in",
        )
    return Finding(True, False, f"serial ports: {', '.join(ports) or 'none plugged in'}")


def _groups() -> set[str]:
    names = set()
    for number in os.getgroups():
        try:
            names.add(grp.getgrgid(number).gr_name)
        except KeyError:
            continue
    return names


def _interfaces() -> Finding:
    return Finding(True, False, f"CAN interfaces: {', '.join(can_interfaces()) or 'none'}")


def _real_time() -> Finding:
    why_not = why_no_priority()
    if not why_not:
        return Finding(True, False, "real-time scheduling is allowed")
    return Finding(
        False,
        False,
        f"real-time scheduling is not allowed ({why_not}): LimitRTPRIO=80 in a service, or rtprio "
        "in limits.conf",
    )


def _awake() -> Finding:
    if os.access(CPU_LATENCY, os.W_OK):
        return Finding(True, False, "processors can be kept awake while drives are energised")
    return Finding(
        False,
        False,
        f"{CPU_LATENCY} cannot be written: processors may sleep deeply between frames, and some "
        "steps take longer; a rule of `tentacled service` for udev permits it",
    )
