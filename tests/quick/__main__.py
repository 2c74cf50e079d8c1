"""Lint, types and the quick tests: `python -m tests.quick`, or `make quick`.

`--list` prints the test files, `--measure` measures all of them anew, and `--moved` follows files
that have another folder now.
"""

import argparse
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from tests.quick.selection import (
    MEASURED,
    ROOT,
    all_test_files,
    quick_files,
    read_measured,
    written,
)

_WORKERS: Final = 2
_FAST: Final = "not long and not slow and not hil and not page"


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.quick", description=__doc__)
    parser.add_argument("--list", action="store_true", help="only print the test files")
    parser.add_argument("--measure", action="store_true", help="measure all test files anew")
    parser.add_argument("--moved", action="store_true", help="follow files to their new folders")
    arguments = parser.parse_args()
    if arguments.list:
        print("\n".join(quick_files()))
        return 0
    if arguments.measure:
        MEASURED.write_text(written(measure()))
        return 0
    if arguments.moved:
        measured = read_measured(MEASURED.read_text())
        MEASURED.write_text(written(moved(measured, all_test_files())))
        return 0
    return run()


def run() -> int:
    """Lint, then types beside the tests; whatever fails is told, and the seconds of each."""
    began_s = time.monotonic()
    for words in (("format", "--check", "--quiet", "."), ("check", "--quiet", ".")):
        code = subprocess.run([_program("ruff"), *words], cwd=ROOT).returncode
        if code:
            return code
    linted_s = time.monotonic()
    # Starting workers and collecting leave a core idle now and then: mypy takes it.
    with subprocess.Popen([_program("mypy")], cwd=ROOT, stdout=subprocess.PIPE, text=True) as types:
        tests = ("-n", str(_WORKERS), "--dist", "loadfile", "-m", _FAST, *quick_files())
        tested = subprocess.run([_program("pytest"), *tests], cwd=ROOT).returncode
        tested_s = time.monotonic()
        said, _ = types.communicate()
    print(said, end="")
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    print(
        f"lint {linted_s - began_s:.0f} s, tests {tested_s - linted_s:.0f} s beside types, "
        f"{time.monotonic() - began_s:.0f} s in all; {used.ru_utime + used.ru_stime:.0f} s of CPU"
    )
    return tested or types.returncode


def measure() -> dict[str, float]:
    """CPU seconds by file, from one run of all that is neither slow nor in real time.

    With as many workers as the quick tests have: alone on two cores, for it takes minutes.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        words = ["pytest", "-n", str(_WORKERS), "--dist", "loadfile", "-m", _FAST]
        words.append(f"--junitxml={report}")
        began_s = time.monotonic()
        subprocess.run([_program(words[0]), *words[1:]], cwd=ROOT)
        wall_s = time.monotonic() - began_s
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        # Beside other programs a test takes longer by its clock, and not of the processor.
        share = min(1.0, (used.ru_utime + used.ru_stime) / (_WORKERS * wall_s))
        return of_report(report.read_text(), all_test_files(), share)


def of_report(report: str, files: Sequence[str], share: float) -> dict[str, float]:
    """Seconds by file, from a report in JUnit's format. share: of CPU time in the clock's."""
    totals: defaultdict[str, float] = defaultdict(float)
    by_module = {file.removesuffix(".py").replace("/", "."): file for file in files}
    for case in ET.fromstring(report).iter("testcase"):
        module = case.get("classname", "")
        while module and module not in by_module:
            module = module.rpartition(".")[0]  # a test in a class
        if module:
            totals[by_module[module]] += float(case.get("time", "0")) * share
    return {file: max(0.01, round(totals[file], 2)) if file in totals else 0.0 for file in files}


def moved(measured: dict[str, float], files: Sequence[str]) -> dict[str, float]:
    """Files that are gone, under the one new place that has their name."""
    found = {file: measured[file] for file in files if file in measured}
    gone = [file for file in measured if file not in found]
    for file in files:
        if file in found:
            continue
        same = [one for one in gone if Path(one).name == Path(file).name]
        if len(same) == 1:
            found[file] = measured[same[0]]
    return found


def _program(name: str) -> str:
    return str(Path(sys.executable).with_name(name))


if __name__ == "__main__":
    sys.exit(main())
