"""Imports only go down: daemon, sim_backends, drivers, safety, config; and so inside daemon."""

import ast
import sys
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path
from subprocess import run

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = {"config": 1, "safety": 2, "drivers": 3, "sim_backends": 4, "daemon": 5, "tests": 6}
INSIDE_DAEMON = (
    *("messages", "files", "array_files", "host", "robot", "estimation", "learning", "reference"),
    *("control", "controllers", "risk", "supervision", "loop", "recording", "service", "remote"),
    *("steering", "workbench", "dashboard", "bridges", "testing", "api", "commands"),
)
"""Lowest first."""
NOT_AT_RUN_TIME = {"torch", "matplotlib", "daemon.workbench"}
"""What no module of the running daemon may import, nor have imported for it."""
MAY_BE_IMPORTED_BY_DRIVERS = {"safety.permit", "safety.limits"}
KNOWS_WHAT_TIME_IS = {"daemon/host/clock.py", "sim_backends/virtual_time.py"}
SOURCES = sorted(
    path for floor in FLOORS if floor != "tests" for path in (ROOT / floor).rglob("*.py")
)


@cache
def imports_of(path: Path) -> tuple[tuple[str, str], ...]:
    """Every module a file imports, with the names it takes from it."""
    found: list[tuple[str, str]] = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found += [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            found += [(node.module or "", alias.name) for alias in node.names]
    return tuple(found)


def named(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_imports_only_go_down(path: Path) -> None:
    here = path.relative_to(ROOT).parts[0]
    for module, _ in imports_of(path):
        there = module.split(".")[0]
        if there in FLOORS and there != here:
            assert FLOORS[there] < FLOORS[here], f"{here} must not import {module}"
            if (here, there) == ("drivers", "safety"):
                assert module in MAY_BE_IMPORTED_BY_DRIVERS, f"drivers must not import {module}"


@pytest.mark.parametrize(
    "path", [path for path in SOURCES if path.is_relative_to(ROOT / "daemon")], ids=named
)
def test_imports_only_go_down_inside_daemon(path: Path) -> None:
    here = path.relative_to(ROOT / "daemon").with_suffix("").parts[0]
    if here == "__init__":
        return
    for module, name in imports_of(path):
        if module == "daemon":
            module = f"daemon.{name}"
        if module.startswith("daemon."):
            there = module.split(".")[1]
            assert here == there or INSIDE_DAEMON.index(there) < INSIDE_DAEMON.index(here), (
                f"daemon/{here} must not import {module}"
            )


def test_no_imports_go_in_a_circle() -> None:
    """Neither of modules nor of packages, and those for types alone count too."""
    modules = {named(path).removesuffix(".py").replace("/", "."): path for path in SOURCES}
    imports = {
        module: {
            wanted
            for of, name in imports_of(path)
            for wanted in (f"{of}.{name}", of)
            if wanted in modules and wanted != module
        }
        for module, path in modules.items()
    }
    packages: dict[str, set[str]] = {}
    for module, wanted in imports.items():
        home = module.rpartition(".")[0]
        packages.setdefault(home, set()).update(one.rpartition(".")[0] for one in wanted)
        packages[home].discard(home)
    for graph in (imports, packages):
        TopologicalSorter(graph).prepare()  # raises CycleError, which names the circle


def test_the_running_daemon_imports_nothing_of_the_workbench() -> None:
    code = (
        "import sys, daemon.commands.host.run\n"
        f"print([name for name in sys.modules if name.startswith({tuple(NOT_AT_RUN_TIME)!r})])"
    )
    found = run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("path", [p for p in SOURCES if p.name == "__init__.py"], ids=named)
def test_every_package_says_what_it_is_for(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text())), "a package has a docstring"


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_only_the_clocks_ask_what_time_it_is(path: Path) -> None:
    if named(path) not in KNOWS_WHAT_TIME_IS:
        modules = {module for module, _ in imports_of(path)}
        assert not modules & {"time", "datetime"}, "take a Clock instead"


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_only_the_gate_gives_permits(path: Path) -> None:
    taken = {(module, name) for module, name in imports_of(path)}
    if named(path) != "safety/gate.py":
        for name in ("permit", "permit_homing", "_SEAL"):
            assert ("safety.permit", name) not in taken


@pytest.mark.parametrize(
    "path",
    [p for p in SOURCES if {"safety", "codec", "plants"} & set(p.relative_to(ROOT).parts[:-1])],
    ids=named,
)
def test_what_is_sans_io_stays_so(path: Path) -> None:
    modules = {module.split(".")[0] for module, _ in imports_of(path)}
    assert not modules & {"asyncio", "socket", "os", "threading", "subprocess"}
