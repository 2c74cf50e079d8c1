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


def of_floor(floor: str) -> list[Path]:
    return [path for path in SOURCES if path.is_relative_to(ROOT / floor)]


@pytest.mark.parametrize("floor", [floor for floor in FLOORS if floor != "tests"])
def test_imports_only_go_down(floor: str) -> None:
    for path in of_floor(floor):
        for module, _ in imports_of(path):
            there = module.split(".")[0]
            if there in FLOORS and there != floor:
                assert FLOORS[there] < FLOORS[floor], f"{named(path)} must not import {module}"
                if (floor, there) == ("drivers", "safety"):
                    assert module in MAY_BE_IMPORTED_BY_DRIVERS, f"{named(path)} imports {module}"


@pytest.mark.parametrize("here", INSIDE_DAEMON)
def test_imports_only_go_down_inside_daemon(here: str) -> None:
    for path in of_floor("daemon"):
        if path.relative_to(ROOT / "daemon").with_suffix("").parts[0] != here:
            continue
        for module, name in imports_of(path):
            if module == "daemon":
                module = f"daemon.{name}"
            if module.startswith("daemon."):
                there = module.split(".")[1]
                assert here == there or INSIDE_DAEMON.index(there) < INSIDE_DAEMON.index(here), (
                    f"{named(path)} must not import {module}"
                )


def test_all_of_the_daemon_has_a_floor() -> None:
    parts = {
        path.relative_to(ROOT / "daemon").with_suffix("").parts[0] for path in of_floor("daemon")
    }
    assert parts == {"__init__", *INSIDE_DAEMON}


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


def test_every_package_says_what_it_is_for() -> None:
    for path in SOURCES:
        if path.name == "__init__.py":
            assert ast.get_docstring(ast.parse(path.read_text())), f"{named(path)}: no docstring"


def test_only_the_clocks_ask_what_time_it_is() -> None:
    for path in SOURCES:
        if named(path) not in KNOWS_WHAT_TIME_IS:
            modules = {module for module, _ in imports_of(path)}
            assert not modules & {"time", "datetime"}, f"{named(path)}: take a Clock instead"


def test_only_the_gate_gives_permits() -> None:
    permits = {("safety.permit", name) for name in ("permit", "permit_homing", "_SEAL")}
    for path in SOURCES:
        if named(path) != "safety/gate.py":
            assert not permits & set(imports_of(path)), named(path)


def test_what_is_sans_io_stays_so() -> None:
    sans_io = {"safety", "codec", "plants"}
    for path in SOURCES:
        if sans_io & set(path.relative_to(ROOT).parts[:-1]):
            modules = {module.split(".")[0] for module, _ in imports_of(path)}
            assert not modules & {"asyncio", "socket", "os", "threading", "subprocess"}, named(path)
