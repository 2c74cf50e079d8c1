"""`python -m tests.benchmarks [--plots DIR] [NAME …]`: one JSON of all measurements, or of some.

Each part runs in a process of its own, one after the other. One that fails, or dies, is reported
as failed, and the others go on; the exit code is 1 then. Ctrl-C ends it with what there is so far.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any, Final

from tests.benchmarks.timing import Figures, failure, machine

PARTS: Final = (
    "aurora",
    "can_cycle",
    "concentric_tubes",
    "control_step",
    "daemon",
    "emulation",
    "experiment",
    "local_controllers",
    "lwpr",
    "memory",
    "page",
    "plant",
    "recording",
    "remote",
    "risk",
    "start_up",
    "tendon_arm",
)
PLOTTED: Final = ("control_step", "local_controllers", "risk")
"""Their modules have `plot(figures, path)`: what is better seen than read."""
LONGEST_S: Final = 7200.0
"""For one part. The longest takes some ten minutes on two idle cores; more than this hangs."""


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[[], *PARTS], metavar="NAME", help="a part")
    parser.add_argument("--plots", type=Path, metavar="DIR", help="where pictures go")
    parser.add_argument("--tiny", action="store_true", help="as short as it runs at all: a trial")
    parser.add_argument("--here", action="store_true", help="in this process, for a debugger")
    arguments = parser.parse_args()
    if arguments.here:
        parts = {name: _measured(name, tiny=arguments.tiny) for name in arguments.names}
        print(json.dumps(parts, indent=2))
        return 0
    figures: Figures = {"machine": machine()}
    interrupted = False
    for name in arguments.names or PARTS:
        print(f"measuring {name}", file=sys.stderr, flush=True)
        try:
            figures[name] = apart(name, tiny=arguments.tiny)
        except KeyboardInterrupt:
            interrupted = True
            break
        if arguments.plots is not None and name in PLOTTED:
            _plot(name, figures[name], arguments.plots)
    figures["failed"] = list(failed(figures))
    print(json.dumps(figures, indent=2))
    for place in figures["failed"]:
        print(f"failed: {place}", file=sys.stderr)
    return 130 if interrupted else int(bool(figures["failed"]))


def apart(name: str, *, tiny: bool = False) -> Figures:
    """The figures of a part, measured in a process of its own."""
    command = [sys.executable, "-m", "tests.benchmarks", "--here", name, *(["--tiny"] * tiny)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        try:
            printed, _ = process.communicate(timeout=LONGEST_S)
        except subprocess.TimeoutExpired:
            return {"failed": f"it was not done in {LONGEST_S:g} s"}
        finally:
            # Its laboratories and daemons go with it, however it ended.
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    if process.returncode:
        return {"failed": f"its process ended with {process.returncode}"}
    try:
        figures: Figures = json.loads(printed)[name]
    except (ValueError, KeyError):
        return {"failed": f"it printed no figures: {printed[:80]!r}"}
    return figures


def _measured(name: str, *, tiny: bool) -> Figures:
    try:
        figures: Figures = import_module(f"tests.benchmarks.{name}").measure(tiny)
    except Exception as error:
        return failure(error)
    return figures


def failed(figures: Any, place: str = "") -> Iterator[str]:
    """Where something failed, and how."""
    if isinstance(figures, dict):
        if "failed" in figures and place:
            yield f"{place}: {figures['failed']}"
        for name, value in figures.items():
            yield from failed(value, f"{place}.{name}" if place else name)


def _plot(name: str, figures: Figures, folder: Path) -> None:
    if list(failed(figures, name)):
        print(f"{name} is not drawn: not all of it was measured", file=sys.stderr)
        return
    folder.mkdir(parents=True, exist_ok=True)
    try:
        import_module(f"tests.benchmarks.{name}").plot(figures, folder / f"{name}.png")
    except Exception as error:  # a picture less is no reason to lose the figures
        figures["plot"] = failure(error)


if __name__ == "__main__":
    sys.exit(main())
