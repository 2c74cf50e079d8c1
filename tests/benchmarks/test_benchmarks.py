"""Every part of `make bench` runs, and one that fails is reported without taking others along."""

import json
import subprocess
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks import timing
from tests.benchmarks.__main__ import PARTS, PLOTTED, _measured, apart, failed
from tests.benchmarks.timing import Figures, pieces, reference_ms

REAL_TIME = {"aurora", "can_cycle", "daemon", "emulation", "page", "recording", "remote"}
"""Parts with processes, ptys or sockets of their own."""


def broken() -> Figures:
    raise ValueError("the drives are on strike")


LONG = (
    "aurora",
    "can_cycle",
    "concentric_tubes",
    "control_step",
    "daemon",
    "emulation",
    "experiment",
    "local_controllers",
    "memory",
    "recording",
    "remote",
    "risk",
    "start_up",
)
"""However short they are asked to be, what they measure takes its time to be made."""


def _marks(name: str) -> list[pytest.MarkDecorator]:
    """What opens a browser goes with the other tests that do."""
    marks = [pytest.mark.hil] * (name in REAL_TIME) + [pytest.mark.page] * (name == "page")
    return marks + [pytest.mark.long] * (name in LONG)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=_marks(name)) for name in PARTS],
)
def test_a_part_runs_as_short_as_it_can(name: str) -> None:
    # A part without processes of its own needs none to be measured in: starting it takes longest.
    figures = apart(name, tiny=True) if name in REAL_TIME else _measured(name, tiny=True)
    assert not list(failed(figures, name)), json.dumps(figures, indent=1)
    measured = [piece for piece in figures.values() if isinstance(piece, dict)]
    assert measured
    for piece in measured:
        assert piece["reference_loop"]["times_slower"] > 0.0
        assert len(piece) > 1  # there is something beside the reference


def test_every_module_that_measures_is_a_part() -> None:
    modules = {path.stem for path in Path(__file__).parent.glob("*.py")}
    assert modules - {"__init__", "__main__", "timing", "test_benchmarks"} == set(PARTS)
    assert set(PLOTTED) <= set(PARTS)


def test_a_piece_that_fails_is_reported_and_the_others_go_on(
    capsys: pytest.CaptureFixture[str],
) -> None:
    figures = pieces({"first": broken, "second": lambda: {"ms": 1.0}})
    assert figures["first"]["failed"] == "ValueError: the drives are on strike"
    assert any("def broken" in line or "broken" in line for line in figures["first"]["traceback"])
    assert figures["second"]["ms"] == 1.0
    assert "first failed: ValueError" in capsys.readouterr().err
    assert list(failed(figures, "daemon")) == ["daemon.first: ValueError: the drives are on strike"]


def test_a_part_that_cannot_even_begin_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    part = ModuleType("tests.benchmarks.struck")
    monkeypatch.setitem(sys.modules, part.__name__, part)
    assert "measure" in _measured("struck", tiny=True)["failed"]
    assert "No module named" in _measured("unheard_of", tiny=True)["failed"]


def test_a_part_whose_process_dies_or_prints_nothing_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for script, said in (
        ("#!/bin/sh\nkill -9 $$\n", "ended with -9"),
        ("#!/bin/sh\nexit 0\n", "no figures"),
        ("#!/bin/sh\necho '{}'\n", "no figures"),
    ):
        program = tmp_path / "python"
        program.write_text(script)
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))
        assert said in apart("lwpr")["failed"]


def test_a_part_that_hangs_is_ended_with_its_children(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = tmp_path / "python"
    program.write_text(f"#!/bin/sh\nsleep 1000 &\necho $! > {tmp_path}/child\nwait\n")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    monkeypatch.setattr(benchmarks, "LONGEST_S", 0.5)
    assert "not done in 0.5 s" in apart("lwpr")["failed"]
    child = (tmp_path / "child").read_text().strip()
    end_s = time.monotonic() + 30.0
    while _runs(int(child)):
        assert time.monotonic() < end_s
        time.sleep(0.05)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


def test_the_exit_code_tells_and_the_others_are_measured(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(name: str, *, tiny: bool) -> Figures:
        return pieces({"one": broken if name == "can_cycle" else lambda: {"ms": float(tiny)}})

    monkeypatch.setattr(benchmarks, "apart", measured)
    monkeypatch.setattr(benchmarks, "machine", dict)
    monkeypatch.setattr(timing, "reference_ms", lambda: (1.0, 1.0))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--tiny"])
    assert benchmarks.main() == 1
    printed = capsys.readouterr()
    figures = json.loads(printed.out)
    assert set(figures) == {"machine", "failed", *PARTS}
    assert figures["failed"] == ["can_cycle.one: ValueError: the drives are on strike"]
    assert "failed: can_cycle.one" in printed.err
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--tiny", "lwpr"])
    assert benchmarks.main() == 0


def test_what_was_measured_is_printed_when_somebody_interrupts(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def measured(name: str, *, tiny: bool) -> Figures:
        if name == PARTS[2]:
            raise KeyboardInterrupt
        return {}

    monkeypatch.setattr(benchmarks, "apart", measured)
    monkeypatch.setattr(benchmarks, "machine", dict)
    monkeypatch.setattr(sys, "argv", ["benchmarks"])
    assert benchmarks.main() == 130
    assert set(json.loads(capsys.readouterr().out)) == {"machine", "failed", *PARTS[:2]}


def test_a_picture_of_what_was_not_measured_is_left_out(tmp_path: Path) -> None:
    figures = pieces({"one": broken})
    benchmarks._plot("risk", figures, tmp_path / "plots")
    assert not (tmp_path / "plots").exists()


def test_the_reference_loop_tells_a_busy_machine_from_a_slow_one() -> None:
    wall_ms, cpu_ms = reference_ms(10_000)
    assert cpu_ms > 0.0
    assert wall_ms > 0.0
    stated = timing.STATED_REFERENCE_MS
    figures = timing.reference_figures([(3 * stated, stated), (3 * stated, stated)])
    assert figures["times_slower"] == 3.0
    assert figures["times_slower_without_other_programs"] == 1.0


def test_a_process_that_does_not_end_is_ended() -> None:
    process = subprocess.Popen(["sleep", "1000"], stdin=subprocess.PIPE)
    timing.end_process(process, within_s=0.1)
    assert process.returncode == -9
