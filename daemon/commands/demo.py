"""`tentacled demo`: the emulated lab and the real drivers, live, with nothing plugged in."""

import argparse
import subprocess
import sys
import tempfile
from importlib.resources import files
from pathlib import Path
from typing import Final

from daemon.cli import EXIT_FAILED, main
from daemon.runtime_directory import LAB_FILE

_LAB_ENDS_WITHIN_S: Final = 5.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--duration", type=float, default=20.0, metavar="S")


def run(arguments: argparse.Namespace) -> int:
    robot = str(files("config") / "robots" / "soft_arm.yaml")
    with tempfile.TemporaryDirectory(prefix="tentacled-") as directory:
        where = ["--runtime-dir", directory]
        command = [sys.executable, "-m", "daemon.cli", "emulate", robot, *where, "--play", "sway"]
        lab = subprocess.Popen(command, stdout=subprocess.PIPE)
        try:
            assert lab.stdout is not None
            lab.stdout.readline()  # it speaks when its ports are there
            if not (Path(directory) / LAB_FILE).exists():
                print("the emulated lab did not start", file=sys.stderr)
                return EXIT_FAILED
            return main(["probe", robot, *where, "--duration", str(arguments.duration)])
        finally:
            _end(lab)


def _end(lab: "subprocess.Popen[bytes]") -> None:
    lab.terminate()
    try:
        lab.wait(_LAB_ENDS_WITHIN_S)
    except subprocess.TimeoutExpired:
        lab.kill()
        lab.wait()
