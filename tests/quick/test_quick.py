"""The quick tests are cheap, and of every package; and the list of what tests cost is true."""

from pathlib import Path

import pytest

from tests.quick.__main__ import moved, of_report
from tests.quick.selection import (
    BUDGET_S,
    MEASURED,
    NEW_FILE_S,
    ROOT,
    all_test_files,
    chosen,
    imported_packages,
    packages,
    quick_files,
    read_measured,
    written,
)

RENEW = "`python -m tests.quick --moved` follows files, `--measure` measures anew"
MEASURED_ALREADY = read_measured(MEASURED.read_text())
UNTESTED = {
    *("config.coupling", "daemon.commands.body_model"),
    *("daemon.commands.bridge", "daemon.commands.client", "daemon.commands.recordings"),
    *("daemon.commands.shell", "daemon.commands.terminal", "daemon.commands.workbench"),
}
"""Packages that no quick test imports itself: commands are tested as processes, and what checks a
part of a robot file by loading whole ones."""


def test_what_is_listed_exists() -> None:
    gone = [file for file in MEASURED_ALREADY if not (ROOT / file).exists()]
    assert not gone, RENEW


def test_few_files_were_never_measured() -> None:
    new = [file for file in all_test_files() if file not in MEASURED_ALREADY]
    assert len(new) <= 40, f"{RENEW}: {new}"


def test_what_is_run_is_cheap() -> None:
    spent_s = sum(MEASURED_ALREADY.get(file, NEW_FILE_S) for file in quick_files())
    assert spent_s <= 1.2 * BUDGET_S, "one file of each package costs too much"


def test_every_package_is_covered() -> None:
    known = packages()
    covered = set().union(*(imported_packages(ROOT / file, known) for file in quick_files()))
    assert known - covered <= UNTESTED


def test_the_cheapest_file_of_each_package_is_run_and_then_what_there_is_time_for() -> None:
    seconds = {"a": 1.0, "b": 30.0, "c": 2.0, "d": 20.0, "e": 4.0}
    covers = {"a": {"p"}, "b": {"q"}, "c": {"p"}, "d": {"q"}, "e": set[str]()}
    assert chosen(seconds, "abcde", covers, budget_s=25.0) == ["a", "c", "d"]
    assert chosen(seconds, "abcde", covers, budget_s=30.0) == ["a", "c", "d", "e"]
    assert chosen(seconds, "abcde", covers, budget_s=1.0) == ["a", "d"], "every package, always"
    assert chosen({}, ["new"], {"new": set()}, budget_s=NEW_FILE_S) == ["new"]
    assert chosen({}, [], {}) == []
    always = chosen(seconds, "abcde", covers, budget_s=22.0, always=["c"])
    assert always == ["c", "d"], "what is always run covers its package, and counts"


def test_imports_are_read_from_the_test(tmp_path: Path) -> None:
    path = tmp_path / "test_it.py"
    path.write_text("import low.deep.one\nfrom low import two\nfrom high.three import f\n")
    known = {"low", "low.deep", "high", "other"}
    assert imported_packages(path, known) == {"low", "low.deep", "high"}


def test_a_report_is_shared_out_to_files() -> None:
    report = """<testsuites><testsuite>
    <testcase classname="tests.low.test_a" name="one" time="2.0"/>
    <testcase classname="tests.low.test_a.TestClass" name="two" time="4.0"/>
    <testcase classname="tests.low.test_gone" name="three" time="8.0"/>
    <testcase classname="tests.low.test_b" name="four" time="0.001"/>
    </testsuite></testsuites>"""
    files = ["tests/low/test_a.py", "tests/low/test_b.py", "tests/low/test_only_slow.py"]
    assert of_report(report, files, share=0.5) == {
        "tests/low/test_a.py": 3.0,
        "tests/low/test_b.py": 0.01,
        "tests/low/test_only_slow.py": 0.0,
    }


def test_a_file_that_has_moved_keeps_its_seconds() -> None:
    measured = {"tests/old/test_a.py": 1.0, "tests/old/test_b.py": 2.0, "tests/test_c.py": 3.0}
    files = ["tests/new/test_a.py", "tests/test_c.py", "tests/test_d.py"]
    assert moved(measured, files) == {"tests/new/test_a.py": 1.0, "tests/test_c.py": 3.0}


@pytest.mark.parametrize("seconds", [{}, {"tests/test_a.py": 1.25, "tests/test_b.py": 0.0}])
def test_what_is_written_is_read(seconds: dict[str, float]) -> None:
    assert read_measured(written(seconds)) == seconds
