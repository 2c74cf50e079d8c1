"""Which test files are run after each change: cheap ones, of every package.

`measured.txt` has the CPU seconds of each test file, without what is marked slow, hil or long.
"""

import ast
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[2]
MEASURED: Final = Path(__file__).with_name("measured.txt")
BUDGET_S: Final = 20.0
"""CPU time of tests; on two cores half of it, besides starting, lint and types."""
NEW_FILE_S: Final = 1.0
"""What a file is taken for that nobody has measured."""
ALWAYS: Final = ("tests/docs/reference/test_reference.py",)
"""Run after each change whatever they cost: pages that are made from the code, which a change of an
option leaves behind unseen."""
_NOT_PRODUCT: Final = "tests"


def all_test_files(root: Path = ROOT) -> list[str]:
    """All that pytest collects, relative to the root."""
    folder = root / _NOT_PRODUCT
    return sorted(path.relative_to(root).as_posix() for path in folder.rglob("test_*.py"))


def read_measured(text: str) -> dict[str, float]:
    """Seconds by file."""
    lines = (line.split(maxsplit=1) for line in text.splitlines() if line[:1].isdigit())
    return {path: float(seconds) for seconds, path in lines}


def written(seconds: Mapping[str, float]) -> str:
    """As `read_measured` reads it, the cheapest first."""
    head = "# CPU seconds of each test file. Renewed by `python -m tests.quick --measure`.\n"
    ordered = sorted(seconds.items(), key=lambda item: (item[1], item[0]))
    return head + "".join(f"{value:.2f} {path}\n" for path, value in ordered)


def packages(root: Path = ROOT) -> set[str]:
    """The product's, with a module in them."""
    tops = [path.parent for path in root.glob("*/__init__.py") if path.parent.name != _NOT_PRODUCT]
    return {
        ".".join(path.parent.relative_to(root).parts)
        for top in tops
        for path in top.rglob("*.py")
        if path.name != "__init__.py"
    }


def imported_packages(path: Path, known: set[str]) -> set[str]:
    """Packages of which a test imports something itself."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        for name in names:
            found |= {package for package in (name, name.rpartition(".")[0]) if package in known}
    return found


def chosen(
    seconds: Mapping[str, float],
    files: Iterable[str],
    covers: Mapping[str, set[str]],
    budget_s: float = BUDGET_S,
    always: Iterable[str] = (),
) -> list[str]:
    """What is always run; of every package the cheapest test file that imports it; then the
    cheapest of the others.

    covers: packages, by file. What was never measured counts as `NEW_FILE_S`.
    """
    ordered = sorted(files, key=lambda file: (seconds.get(file, NEW_FILE_S), file))
    missing = set().union(*covers.values()) if covers else set()
    taken = list(always)
    missing -= set().union(*(covers.get(file, set()) for file in taken))
    for file in ordered:
        if covers.get(file, set()) & missing:
            taken.append(file)
            missing -= covers[file]
    spent_s = sum(seconds.get(file, NEW_FILE_S) for file in taken)
    for file in ordered:
        cost_s = seconds.get(file, NEW_FILE_S)
        if file not in taken and spent_s + cost_s <= budget_s:
            taken.append(file)
            spent_s += cost_s
    return sorted(taken)


def quick_files(root: Path = ROOT) -> list[str]:
    """What `make quick` runs."""
    files, known = all_test_files(root), packages(root)
    covers = {file: imported_packages(root / file, known) for file in files}
    measured = read_measured(MEASURED.read_text())
    # A file that has only slow tests has no seconds, and covers nothing here.
    usable = [file for file in files if measured.get(file, NEW_FILE_S) > 0.0]
    return chosen(measured, usable, {file: covers[file] for file in usable}, always=ALWAYS)
