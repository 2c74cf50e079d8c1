"""Workers that need the same kernel at the same time: one of them compiles it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNEL = """
from numba import njit

@njit(cache=True)
def inner(x):
    return x + 1.0

@njit(cache=True)
def outer(x):
    return inner(x) * 2.0
"""
WORKER = """
import json, sys
sys.path.insert(0, sys.argv[1])
from numba.core import event
from tests.compile_once import compile_once
import kernels
compile_once()
with event.install_recorder("numba:compile") as compiled:
    print("ready", flush=True)
    sys.stdin.readline()
    value = kernels.outer(3.0)
names = [e.data["dispatcher"].py_func.__name__ for _, e in compiled.buffer if e.is_start]
print(json.dumps([value, names]))
"""


@pytest.mark.slow
def test_three_who_need_a_kernel_at_once_compile_it_once(tmp_path: Path) -> None:
    (tmp_path / "kernels.py").write_text(KERNEL)
    workers = [
        subprocess.Popen(
            [sys.executable, "-c", WORKER, str(tmp_path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")},
            cwd=Path(__file__).parents[1],
        )
        for _ in range(3)
    ]
    for worker in workers:
        assert worker.stdout is not None
        assert worker.stdout.readline() == "ready\n"
    for worker in workers:
        assert worker.stdin is not None
        worker.stdin.write("go\n")
        worker.stdin.flush()
    told = [json.loads(worker.communicate(timeout=120.0)[0]) for worker in workers]
    assert [value for value, _ in told] == [8.0] * 3
    assert sorted(name for _, names in told for name in names) == ["inner", "outer"]
