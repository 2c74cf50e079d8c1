"""Studies and collections on a cluster of this machine: a scheduler and workers as processes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from daemon.workbench.studies.grid import Grid
from daemon.workbench.studies.run import plan
from daemon.workbench.studies.study_file import load_study
from tests.daemon.workbench.studies.made_up import write_study
from tests.hil.processes import command

pytest.importorskip("distributed", reason="pip install '.[cluster]'")
pytestmark = [pytest.mark.hil, pytest.mark.long]

WITHIN_S = 240.0
SEEDS = 3
STUDY = """
study: small
tables:
  - title: Table 1
    rows: [{experiment: calm.yaml, label: no load}]
figures:
  - {figure: path, title: Path, experiments: [calm]}
variants:
  - {variant: arcs, label: arcs, controller: {kind: constant_curvature}}
  - {variant: stubborn, label: stubborn, controller: {kind: broyden, posture: [1.0, 2.0]}}
  - {variant: measured, label: measured Jacobian}
seeds: 1
plants: 1
"""


class Cluster:
    """A scheduler, and workers that are not started again when they die."""

    def __init__(self, folder: Path, workers: int) -> None:
        self.folder = folder
        self._file = folder / "scheduler.json"
        local = ["--host", "127.0.0.1", "--no-dashboard"]
        self.processes = [self._start("scheduler", "--port", "0", *local)]
        deadline_s = time.monotonic() + WITHIN_S
        while not self._file.exists():
            assert time.monotonic() < deadline_s, "the scheduler has not come"
            time.sleep(0.05)
        for _ in range(workers):
            self.add_worker()

    @property
    def address(self) -> str:
        return str(json.loads(self._file.read_text())["address"])

    def add_worker(self, **environment: str) -> "subprocess.Popen[bytes]":
        number = len(self.processes)
        words = ["--nthreads", "1", "--no-nanny", "--no-dashboard", "--host", "127.0.0.1"]
        place = ["--local-directory", str(self.folder / f"worker-{number}")]
        one = self._start("worker", *words, *place, **environment)
        self.processes.append(one)
        return one

    def leave(self) -> None:
        for one in reversed(self.processes):
            one.kill()
            one.wait()

    def _start(self, what: str, *words: str, **environment: str) -> "subprocess.Popen[bytes]":
        """In a folder of its own: nothing that a worker leaves there is found by another."""
        program = [sys.executable, "-m", "dask", what, *words, "--scheduler-file", str(self._file)]
        return subprocess.Popen(
            program,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            cwd=self.folder,
            env={**os.environ, **environment},
        )


@pytest.fixture
def cluster(tmp_path: Path) -> Iterator[Cluster]:
    folder = tmp_path / "cluster"
    folder.mkdir()
    one = Cluster(folder, 2)
    try:
        yield one
    finally:
        one.leave()


def outcomes(path: Path, out: Path) -> list[object]:
    """What tables are made of."""
    return [
        (o.experiment, o.variant, o.seed, o.failure, o.result and (o.result.cycles, o.result.holds))
        for o in Grid(plan(load_study(path), SEEDS, 1), out).outcomes()
    ]


def test_a_worker_that_is_killed_in_a_study_loses_nothing(cluster: Cluster, tmp_path: Path) -> None:
    path = write_study(tmp_path / "study", STUDY, 3.0)
    words = ["compare", "--study", str(path), "--seeds", str(SEEDS), "--plants", "1", "--out"]
    away, here = tmp_path / "away", tmp_path / "here"
    study = subprocess.Popen(
        command(*words, str(away), "--scheduler", cluster.address), stdout=subprocess.DEVNULL
    )
    deadline_s = time.monotonic() + WITHIN_S
    try:
        while not list(away.glob("runs/*/*/*/outcome.json")):
            assert study.poll() is None and time.monotonic() < deadline_s
            time.sleep(0.02)
        cluster.processes[1].send_signal(signal.SIGKILL)
        done = len(list(away.glob("runs/*/*/*/outcome.json")))
        assert done < 3 * SEEDS, "it was killed in the middle"
        code = study.wait(WITHIN_S)
    finally:
        study.kill()
        study.wait()
    alone = subprocess.run(command(*words, str(here)), capture_output=True, check=False)
    assert code == alone.returncode == 0, alone.stderr
    found = outcomes(path, away)
    assert len(found) == 3 * SEEDS and found == outcomes(path, here)
    assert sorted(one.name for one in away.iterdir()) == sorted(one.name for one in here.iterdir())
    names = {one.name for one in away.glob("runs/calm/arcs/plant-1-seed-1/*")}
    assert names == {"outcome.json", "result.json", "steps.npz", "robot.yaml", "provenance.json"}


def test_a_collection_of_a_cluster_is_the_same_data(cluster: Cluster, tmp_path: Path) -> None:
    words = ["mdn", "collect", "builtin:soft_arm", "--configurations", "30", "--starts", "1"]
    made = []
    for name, more in (("away", ["--scheduler", cluster.address]), ("here", [])):
        out = tmp_path / f"{name}.npz"
        told = subprocess.run(
            command(*words, "--points", "64", "--out", str(out), *more),
            capture_output=True,
            text=True,
            check=False,
        )
        assert told.returncode == 0, told.stderr
        with np.load(out, allow_pickle=False) as content:
            made.append({name: content[name] for name in content.files})
    away, here = made
    assert away.keys() == here.keys()
    for name in ("clouds_mm", "centrelines_mm", "configurations"):
        assert np.array_equal(away[name], here[name]), name


def test_a_worker_of_another_version_is_refused_by_what_differs(
    cluster: Cluster, tmp_path: Path
) -> None:
    """A copy of the program with another model, in front of the installed one."""
    copy = tmp_path / "copy"
    root = Path(__file__).parents[2]
    for package in ("config", "daemon", "drivers", "safety", "sim_backends"):
        shutil.copytree(
            root / package, copy / package, ignore=shutil.ignore_patterns("__pycache__")
        )
    (copy / "config" / "models" / "soft_arm.npz").write_bytes(b"another")
    cluster.add_worker(PYTHONPATH=str(copy))
    path = write_study(tmp_path / "study", STUDY, 3.0)
    words = ["compare", "--study", str(path), "--seeds", "1", "--plants", "1"]
    deadline_s = time.monotonic() + WITHIN_S
    while True:
        told = subprocess.run(
            command(*words, "--out", str(tmp_path / "out"), "--scheduler", cluster.address),
            capture_output=True,
            text=True,
            check=False,
        )
        if told.returncode != 0 or time.monotonic() > deadline_s:
            break
        shutil.rmtree(tmp_path / "out")  # that worker was not there yet
    assert told.returncode == 76, told.stderr
    assert "shipped models is " in told.stderr and "tcp://127.0.0.1:" in told.stderr
