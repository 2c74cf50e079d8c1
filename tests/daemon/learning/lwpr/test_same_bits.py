"""What is learnt is the same to the last bit, whatever lay in the cache of compiled kernels."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

_LEARN = """
import hashlib
import numpy as np
from daemon.learning.lwpr.model import Lwpr
from daemon.learning.lwpr.settings import LwprSettings

model = Lwpr(LwprSettings(
    3, 2, (8.0, 6.0, 3.0), diagonal_only=False, adapt_metric=True, meta=True, penalty=1e-4,
    init_learning_rate=100.0,
))
random = np.random.default_rng(1)
digest = hashlib.sha256()
for x in random.uniform(-1.0, 1.0, (600, 3)):
    digest.update(model.update(x, np.array([np.sin(2.0 * x[0]) * x[1], x[2] ** 2])).tobytes())
for name, array in sorted(model.to_arrays().items()):
    digest.update(array.tobytes())
print(model.count, digest.hexdigest())
"""


def _learnt(cache: Path) -> str:
    done = subprocess.run(
        [sys.executable, "-c", _LEARN],
        capture_output=True,
        text=True,
        env={**os.environ, "NUMBA_CACHE_DIR": str(cache)},
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_kernels_from_a_cache_give_the_same_bits_as_new_ones(tmp_path: Path) -> None:
    """And so does a kernel that is compiled where those which it calls are in the cache already."""
    fresh = _learnt(tmp_path)
    assert int(fresh.split()[0]) > 10
    assert _learnt(tmp_path) == fresh
    kept = [path for path in tmp_path.rglob("*.nb?") if "learning_kernels.adapt-" in path.name]
    assert len(kept) == 2
    for path in kept:
        path.unlink()
    assert _learnt(tmp_path) == fresh
