"""Who may compute with us: what differs is named, and nothing else is refused."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from daemon.workbench.cluster.cluster_workers import (
    ClusterError,
    ClusterMismatchError,
    check_sameness,
    checked,
    cluster_workers,
)
from daemon.workbench.cluster.sameness import differences, facts
from tests.docs.blocks import ROOT

_HERE = {"python": "3.11.7", "numpy": "2.4.6", "shipped models": "abc"}


def test_what_is_the_same_everywhere_is_let_through() -> None:
    assert differences(facts(), dict(facts())) == []
    assert checked(facts(), max, 3, 4) == 4


def test_all_that_differs_is_named_with_the_worker() -> None:
    there = {"python": "3.12.1", "shipped models": "abc"}
    with pytest.raises(ClusterMismatchError) as refused:
        check_sameness("tcp://there:1", _HERE, there)
    assert str(refused.value) == (
        "tcp://there:1: python is 3.12.1 there and 3.11.7 here; "
        "numpy is not told there and 2.4.6 here"
    )
    with pytest.raises(ClusterMismatchError, match="does not work there: No module named 'daemon'"):
        check_sameness("tcp://there:1", _HERE, ModuleNotFoundError("No module named 'daemon'"))


def test_a_task_of_somebody_else_is_not_done() -> None:
    with pytest.raises(ClusterMismatchError, match=r"numpy is .* there and 0.0 here"):
        checked({**facts(), "numpy": "0.0"}, max, 3, 4)


def test_facts_do_not_depend_on_where_it_is_installed_but_on_what(tmp_path: Path) -> None:
    """Of the installation here, and of two copies: one as it is, one with another model."""
    assert {"python", "tentacled", "numba", "tentacled's code", "shipped models"} <= set(facts())

    def told(root: Path) -> dict[str, str]:
        code = (
            "import json, sys; sys.path.insert(0, sys.argv[1])\n"
            "from daemon.workbench.cluster.sameness import facts\n"
            "print(json.dumps(facts()))"
        )
        process = subprocess.run(
            [sys.executable, "-c", code, str(root)],
            capture_output=True,
            text=True,
            cwd=tmp_path,
            check=True,
        )
        found: dict[str, str] = json.loads(process.stdout)
        return found

    copy = tmp_path / "elsewhere"
    ignored = shutil.ignore_patterns("__pycache__")
    for package in ("config", "daemon", "drivers", "safety", "sim_backends"):
        shutil.copytree(ROOT / package, copy / package, ignore=ignored)
    assert told(copy) == facts()
    (copy / "config" / "models" / "soft_arm.npz").write_bytes(b"another")
    (different,) = differences(facts(), told(copy))
    assert different.startswith("shipped models is ")


def test_without_a_scheduler_it_is_told_at_once() -> None:
    pytest.importorskip("distributed", reason="pip install '.[cluster]'")
    code = (
        "import daemon.workbench.cluster.cluster_workers as cluster\n"
        "cluster._ANSWERS_WITHIN_S = 0.5\n"
        "from daemon.commands.terminal.command_line import main\n"
        "import sys; sys.exit(main(sys.argv[1:]))"
    )
    words = ["mdn", "collect", "builtin:soft_arm", "--out", "x.npz"]
    told = subprocess.run(
        [sys.executable, "-c", code, *words, "--scheduler", "tcp://127.0.0.1:9"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 69, told.stderr
    assert "no scheduler answers at tcp://127.0.0.1:9" in told.stderr


def test_without_the_library_it_is_told_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("daemon.workbench.cluster.cluster_workers.find_spec", lambda _: None)
    with (
        pytest.raises(ClusterError, match=r"pip install 'tentacled\[cluster\]'"),
        cluster_workers("tcp://127.0.0.1:9"),
    ):
        pass
