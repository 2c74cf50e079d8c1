"""Test the tests of `safety`: `python -m tests.mutation`.

Puts small faults into safety/, one at a time and only in memory, and runs tests/safety against
each. A fault that no test notices is a hole in the tests, or it changes nothing: then it stands in
`equivalent.txt` with the reason. Ends with exit code 1 where a fault is neither, or where the list
names one that does not exist or is noticed after all.
"""

import argparse
import importlib.util
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Final

import hypothesis.strategies  # noqa: F401  loaded here once, and not by each copy
import pytest

from tests.mutation.mutants import Mutant, mutants_of, names_of

ROOT: Final = Path(__file__).parents[2]
EQUIVALENT: Final = Path(__file__).with_name("equivalent.txt")
TIP_CONSISTENCY: Final = ROOT / "safety" / "risk" / "tip_consistency.py"
_LONGEST_S: Final = 120
_PYTEST: Final = (
    *("-x", "-q", "--no-header", "--hypothesis-seed=0"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),
    *("-p", "no:cacheprovider", "-p", "no:cov", "-p", "no:xdist", "-p", "no:rerunfailures"),
)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=__doc__)
    parser.add_argument("--only", metavar="TEXT", default="", help="faults whose name has this")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="at the same time")
    arguments = parser.parse_args()
    known = read_equivalent(EQUIVALENT.read_text())
    sound = [(path, str(path), Mutant("", 0, path.read_text())) for path in _sources()]
    if any(noticed for _, noticed in _run_all(sound, arguments.jobs)):
        print("tests/safety fails without any fault: there is nothing to learn from faults")
        return 1
    faults = [fault for fault in all_faults() if arguments.only in fault[1]]
    lines = {name: mutant.line for _, name, mutant in faults}
    survived = []
    for number, (name, noticed) in enumerate(_run_all(faults, arguments.jobs), start=1):
        if not noticed:
            survived.append(name)
            if name not in known:
                print(f"\rnot noticed: {name} (line {lines[name]})", flush=True)
        if sys.stdout.isatty():
            print(f"\r{number} of {len(faults)} ", end="", flush=True)
    holes = [name for name in survived if name not in known]
    stale = [name for name in known if name not in survived and arguments.only in name]
    for name in stale:
        print(f"listed as equivalent, but noticed or gone: {name}")
    print(
        f"{len(faults)} faults: {len(faults) - len(survived)} noticed, {len(holes)} not, "
        f"{len(survived) - len(holes)} change nothing"
    )
    return 1 if holes or stale else 0


def read_equivalent(text: str) -> dict[str, str]:
    """Names of faults, each with why it changes nothing: the indented lines that follow it."""
    reasons: dict[str, str] = {}
    name = ""
    for line in text.splitlines():
        if line.startswith(" "):
            reasons[name] += f"{line.strip()} "
        elif line.strip() and not line.startswith("#"):
            name = line.strip()
            reasons[name] = ""
    unexplained = [name for name, reason in reasons.items() if not reason]
    if unexplained:
        raise ValueError(f"{EQUIVALENT.name}: no reason is given for {unexplained[0]}")
    return reasons


def all_faults() -> list[tuple[Path, str, Mutant]]:
    """Of all files of safety/, each with its full name."""
    return [
        (path, _full(path, mutant.name), mutant)
        for path in _sources()
        for mutant in mutants_of(path.read_text())
    ]


def all_names() -> set[str]:
    """The full names of `all_faults`."""
    return {_full(path, name) for path in _sources() for name in names_of(path.read_text())}


def _full(path: Path, name: str) -> str:
    return f"{path.relative_to(ROOT).as_posix()}: {name}"


def _sources() -> list[Path]:
    """What decides. The numerics of safety/risk are held by their references and by quadrature."""
    return [*sorted((ROOT / "safety").glob("*.py")), TIP_CONSISTENCY]


def _run_all(faults: Sequence[tuple[Path, str, Mutant]], jobs: int) -> Iterator[tuple[str, bool]]:
    """Each fault's name, and whether a test noticed it."""
    running: dict[int, str] = {}
    waiting = iter(faults)
    while True:
        while len(running) < jobs and (fault := next(waiting, None)) is not None:
            path, name, mutant = fault
            running[_start(path, mutant)] = name
        if not running:
            return
        pid, status = os.wait()
        yield running.pop(pid), status != 0


def _start(path: Path, mutant: Mutant) -> int:
    """A copy of this process, with the tests loaded already, that meets one fault."""
    pid = os.fork()
    if pid:
        return pid
    signal.alarm(_LONGEST_S)  # a fault may make a loop endless: it ends the process, and counts
    quiet = os.open(os.devnull, os.O_WRONLY)
    os.dup2(quiet, 1)
    os.dup2(quiet, 2)
    module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
    sys.meta_path.insert(0, _Faulty(module, path, mutant.source))
    code = 1
    try:
        code = int(pytest.main([*_PYTEST, *_tests_for(path)]))
    finally:
        os._exit(code)


def _tests_for(path: Path) -> list[str]:
    """All of tests/safety, those that are about this file first; a part of the risk has its own."""
    if path.parent.name == "risk":
        return [str(ROOT / "tests" / "safety" / "risk" / f"test_{path.name}")]
    tests = sorted((ROOT / "tests" / "safety").glob("test_*.py"))
    tests.sort(key=lambda test: not test.stem.startswith(f"test_{path.stem}"))
    return [str(test) for test in tests]


class _Faulty:
    """Loads one module from other source than its file's."""

    def __init__(self, module: str, path: Path, source: str) -> None:
        self._module, self._path, self._source = module, path, source

    def find_spec(self, name: str, path: object = None, target: object = None) -> ModuleSpec | None:
        if name != self._module:
            return None
        return importlib.util.spec_from_loader(name, self)  # type: ignore[arg-type]

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        module.__file__ = str(self._path)
        exec(compile(self._source, self._path, "exec"), module.__dict__)


if __name__ == "__main__":
    sys.exit(main())
