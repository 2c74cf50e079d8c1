"""What numba has left on disk, and cannot be read, is compiled anew."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

POINTS = "from typing import NamedTuple\n\n\nclass {name}(NamedTuple):\n    x: float\n"
KERNEL = """from numba import njit

from points import {name}


@njit(cache=True)
def twice(point):
    return 2.0 * point.x
"""
ASK = """
import sys
sys.path.insert(0, sys.argv[1])
from daemon.host.compilation import forgive_caches
forgive_caches()
import kernels
print(kernels.twice(kernels.{name}(3.0)), sum(kernels.twice.stats.cache_misses.values()))
"""


def ask(folder: Path, name: str) -> tuple[float, int]:
    """What the kernel says, and how often it had to be compiled."""
    program = [sys.executable, "-B", "-c", ASK.format(name=name), str(folder)]
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache")}
    root = Path(__file__).parents[3]
    done = subprocess.run(program, capture_output=True, text=True, env=environment, cwd=root)
    assert done.returncode == 0, done.stderr
    value, compiled = done.stdout.split()
    return float(value), int(compiled)


def write(folder: Path, name: str) -> None:
    (folder / "points.py").write_text(POINTS.format(name=name))
    (folder / "kernels.py").write_text(KERNEL.format(name=name))


@pytest.mark.slow
def test_a_kernel_whose_argument_has_another_name_now_is_compiled_anew(tmp_path: Path) -> None:
    write(tmp_path, "Point")
    assert ask(tmp_path, "Point") == (6.0, 1)
    write(tmp_path, "Place")
    assert ask(tmp_path, "Place") == (6.0, 1)
    assert ask(tmp_path, "Place") == (6.0, 0)


@pytest.mark.slow
def test_a_file_that_was_cut_off_is_written_anew(tmp_path: Path) -> None:
    write(tmp_path, "Point")
    assert ask(tmp_path, "Point") == (6.0, 1)
    for kind in ("nbi", "nbc"):
        (file,) = (tmp_path / "cache").rglob(f"*.{kind}")
        file.write_bytes(file.read_bytes()[:40])
        assert ask(tmp_path, "Point") == (6.0, 1), kind
    assert ask(tmp_path, "Point") == (6.0, 0)
