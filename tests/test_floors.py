"""Imports only go down: daemon, sim_backends, drivers, safety, config."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FLOORS = {"config": 1, "safety": 2, "drivers": 3, "sim_backends": 4, "daemon": 5, "tests": 6}
MAY_BE_IMPORTED_BY_DRIVERS = {"safety.permit", "safety.limits"}
KNOWS_WHAT_TIME_IS = {"daemon/host/clock.py", "sim_backends/virtual_time.py"}
SOURCES = sorted(
    path for floor in FLOORS if floor != "tests" for path in (ROOT / floor).rglob("*.py")
)


def imports_of(path: Path) -> Iterator[tuple[str, str]]:
    """Every module a file imports, with the names it takes from it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, "") for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from ((node.module or "", alias.name) for alias in node.names)


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


@pytest.mark.parametrize("path", SOURCES, ids=named)
def test_what_is_sans_io_stays_so(path: Path) -> None:
    floor = path.relative_to(ROOT).parts[0]
    if floor == "safety" or "codec" in path.parts or "plants" in path.parts:
        modules = {module.split(".")[0] for module, _ in imports_of(path)}
        assert not modules & {"asyncio", "socket", "os", "threading", "subprocess"}
